"""The few directions of the runs' information that a predicted variance depends on.

The variance at x is 1 - |w(x)|^2 + nugget with w(x) = L^-1 k(x), one number for each row of the
covariance L @ L.T of the runs.  Over the box of the design w(x) keeps close to a space of far fewer
dimensions, as k is smooth and noise hides its finest parts.  With orthonormal directions U,
1 - |U.T w(x)|^2 is never below the variance.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh

Array = npt.NDArray[np.float64]

TOLERANCE = 0.01
"""largest share by which a variance may be stated too large where it is checked"""


def variance_directions(whitened: Array, variance: Array, tolerance: float = TOLERANCE) -> Array:
    """(n_rows, q) fewest directions U that leave each variance too large by the tolerance at most.

    `whitened` (m, n_rows) are w at sample points, `variance` (m,) 1 - |w|^2 + nugget > 0 there.
    Directions are the principal ones of w / sqrt(variance), so that points count by their need.
    """
    relative = whitened / np.sqrt(variance)[:, None]
    directions = eigh(relative.T @ relative)[1][:, ::-1]
    # What all directions from the j-th on add to the variance of each point, over that variance.
    added = np.cumsum(((relative @ directions) ** 2)[:, ::-1], axis=1)[:, ::-1]
    enough = np.append(added.max(axis=0), 0.0) <= tolerance
    kept: Array = directions[:, : int(np.argmax(enough))]
    return kept
