"""How far a correlation has come, for those who wait for it."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int], None]
"""called with (points looked at, all points) now and then, from the thread that correlates"""


def in_turn(progress: Progress | None, least: int = 0) -> Callable[[], Progress | None]:
    """Progress of several correlations after one another as of one.

    Each call of what is returned begins the next. The total grows with them, from `least` points.
    """
    totals: list[int] = []

    def following() -> Progress | None:
        """Of the next correlation."""
        if progress is None:
            return None
        before, number = sum(totals), len(totals)
        totals.append(0)

        def report(done: int, total: int) -> None:
            totals[number] = total
            progress(before + done, max(before + total, least))

        return report

    return following
