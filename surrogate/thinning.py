"""A part of the runs, where all of them take too long."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def part_of_runs(x: Array, n_rows: int, most: int) -> npt.NDArray[np.int64]:
    """Places (ascending) of so many of runs at x (n, d) that about `most` of `n_rows` are left.

    They are drawn, always the same: of every so manieth run of a design whose levels take turns
    a single level might be left. To them comes a run for each input that does not vary in them.
    """
    n = len(x)
    drawn = np.random.default_rng(0).permutation(n)
    part = drawn[: -(-n // max(1, -(-n_rows // most)))]
    for values in x.T:
        if not np.ptp(values[part]) and np.ptp(values):
            part = np.append(part, drawn[np.argmax(values[drawn] != values[part[0]])])
    return np.sort(part)
