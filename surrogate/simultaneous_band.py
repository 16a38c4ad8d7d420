"""Where a run's whole field lies among fields drawn from its prediction."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

N_DRAWS = 400
"""fields drawn: the share of them below a level of 95 % has a standard error of 1.1 %"""


def rank_of_largest(
    error: Array, std: Array, modes: Array, weight_variance: Array, factor: Array
) -> Array:
    """(n,) share of drawn fields whose largest standardised error is below that of each run.

    `error` and `std` (n, n_obs) in mm; `modes` (n_obs, k), `weight_variance` (n, k) and `factor`
    (n_obs, q) make the covariance of a prediction's errors: modes @ diag(weight_variance[i])
    @ modes.T + factor @ factor.T. A run lies within the simultaneous band of level p, in which a
    share p of all fields lies with every value, where its rank is at most p. Unlike the
    Mahalanobis distance it needs no inverse, which a covariance of low rank does not have.
    Draws are the same for all runs and calls.
    """
    rng = np.random.default_rng(0)
    by_mode = rng.standard_normal((modes.shape[1], N_DRAWS))
    shared = factor @ rng.standard_normal((factor.shape[1], N_DRAWS))
    rank = np.zeros(len(error))
    for run, (own, spread) in enumerate(zip(error, std, strict=True)):
        varies = spread > 0.0  # what is the same in all runs has no error
        drawn = modes @ (np.sqrt(weight_variance[run])[:, None] * by_mode) + shared
        sizes = np.abs(drawn[varies]) / spread[varies, None]
        largest = np.max(np.abs(own[varies]) / spread[varies], initial=0.0)
        rank[run] = np.mean(sizes.max(axis=0, initial=0.0) < largest)
    return rank
