"""The few directions of the runs' information that a predicted variance depends on.

In the basis of `surrogate.evidence` the variance at x is 1 - sum_i c_i(x)^2 / (w_i + nugget) +
nugget, one term for each row of the runs, all of them positive. Where the eigenvalue w_i is far
below the nugget, noise hides the direction and its term is next to nothing: leaving it out makes
the variance larger, never smaller.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

TOLERANCE = 0.01
"""largest share by which a variance may be stated too large where it is checked"""


def unneeded(squared: Array, shares: Array, nugget: Array, tolerance: float = TOLERANCE) -> int:
    """How many of the first directions every variance may be computed without.

    `squared` (n_rows, m) are c^2 at m points, eigenvalues ascending, `shares` (k, n_rows)
    1 / (w + nugget), `nugget` (k,). No variance of any process at any of the points then gets
    larger by more than the tolerance.
    """
    few = len(squared)
    for share, own in zip(shares, nugget, strict=True):
        terms = share[:, None] * squared
        variance = np.maximum(1.0 - terms.sum(axis=0), 0.0) + own
        added = np.cumsum(terms, axis=0) / variance
        few = min(few, int(np.count_nonzero(added.max(axis=1) <= tolerance)))
    return few
