"""Progress bars with the time left, on the standard error stream."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from tqdm import tqdm

T = TypeVar("T")
Progress = Callable[[int, int], None]
"""called with (done, total) after each piece of work"""


class _Bar(tqdm):  # type: ignore[type-arg]
    """A bar without a thread that watches it: that thread would be given a Ctrl-C which is blocked
    while workers start."""

    monitor_interval = 0


@contextmanager
def progress_bar(
    label: str, unit: str, *, shown: bool = True, leave: bool = True
) -> Iterator[Progress]:
    """A bar that is told (done, total); it starts at the first call and estimates the time left.

    Work found finished when the bar starts counts as done but not as speed, so the time left is
    right when an interrupted campaign goes on. `leave`: whether the bar stays on the terminal.
    """
    bar: tqdm[Any] | None = None

    def report(done: int, total: int) -> None:
        """Move the bar to `done` of `total` pieces."""
        nonlocal bar
        if bar is None:
            bar = _Bar(
                total=total,
                initial=done,
                desc=label,
                unit=unit,
                disable=not shown,
                leave=leave,
                file=sys.stderr,
                dynamic_ncols=True,
                mininterval=0.5,
                smoothing=0.1,
            )
            return
        bar.total = total
        bar.update(done - bar.n)

    try:
        yield report
    finally:
        if bar is not None:
            bar.close()


def told_one_by_one(label: str, pieces: Sequence[T]) -> Iterator[T]:
    """The pieces of a work that takes minutes for each, with a bar on a terminal."""
    with progress_bar(label, "part", shown=sys.stderr.isatty()) as report:
        for done, piece in enumerate(pieces):
            report(done, len(pieces))
            yield piece
        report(len(pieces), len(pieces))
