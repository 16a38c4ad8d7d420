"""What a long solve tells while it goes on: one line for each accepted step."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import NamedTuple

LOGGER = logging.getLogger("fe")


class StepReport(NamedTuple):
    """An accepted step, which need not be one that was asked for."""

    travel: float
    """mm"""
    force: float
    """N"""
    iterations: int
    """of the equilibrium"""
    negative_pivots: int
    """> 0 is an unstable equilibrium"""

    def __str__(self) -> str:
        line = (
            f"travel {self.travel:.4f} mm, force {self.force:.5g} N, {self.iterations} iterations"
        )
        if self.negative_pivots == 0:
            return line
        return f"{line}, unstable: {self.negative_pivots} negative pivots"


Progress = Callable[[StepReport], None]
"""called after each accepted step, as `print` may be"""


def listener(progress: Progress | None, symmetry: float) -> Progress:
    """Log a step of the modelled part at level info (logger "fe") and pass it on to `progress`.

    Forces become those of the whole sample, of `symmetry` such parts.
    """

    def listen(step: StepReport) -> None:
        whole = step._replace(force=symmetry * step.force)
        LOGGER.info("%s", whole)
        if progress is not None:
            progress(whole)

    return listen
