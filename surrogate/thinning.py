"""A part of the runs, where all of them take too long."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def part_of_runs(n: int, n_rows: int, most: int) -> npt.NDArray[np.int64]:
    """Places (ascending) of so many of n runs that about `most` of their `n_rows` rows are left.

    They are drawn, always the same: of every so manieth run of a design whose levels take turns
    a single level might be left.
    """
    n_left = -(-n // max(1, -(-n_rows // most)))
    return np.sort(np.random.default_rng(0).permutation(n)[:n_left])
