"""Bars that show how far one image has come, for whoever runs a study."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

from calib.dic.progress import Progress

Bars = Callable[[str], AbstractContextManager[Progress]]
"""a bar with this label, for as long as its context lasts"""


def no_bars(label: str) -> AbstractContextManager[Progress]:
    """For runs that nobody watches."""
    del label
    return nullcontext(_nothing)


def _nothing(done: int, total: int) -> None:
    """Show nothing."""
