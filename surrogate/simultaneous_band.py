"""Where a run's whole field lies among fields drawn from its prediction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

N_DRAWS = 400
"""fields drawn: the share of them below a level of 95 % has a standard error of 1.1 %"""
SAME = 1e-9
"""SD, as a share of the largest, below which a value is the same in all runs but for rounding"""


class Spread(NamedTuple):
    """Covariances of n predicted fields' errors, never formed.

    That of the i-th is modes @ diag(weight_variance[i]) @ modes.T + factor @ factor.T, mm^2.
    """

    modes: Array
    """(n_obs, k)"""
    weight_variance: Array
    """(n, k)"""
    factor: Array
    """(n_obs, q)"""


def standardised(error: Array, std: Array) -> Array:
    """Errors over their SDs, of the same shape; next to 0 where a value is the same in all runs."""
    least = max(SAME * float(np.max(std, initial=0.0)), np.finfo(np.float64).tiny)
    z: Array = error / np.maximum(std, least)
    return z


def rank_of_largest(error: Array, std: Array, spread: Spread) -> Array:
    """(n,) share of drawn fields whose largest standardised error is below that of each run.

    `error` and `std` (n, n_obs) in mm. A run lies within the simultaneous band of level p, in which
    a share p of all fields lies with every value, where its rank is at most p. Unlike the
    Mahalanobis distance it needs no inverse, which a covariance of low rank does not have.
    Draws are the same for all runs and calls.
    """
    modes, weight_variance, factor = spread
    rng = np.random.default_rng(0)
    by_mode = rng.standard_normal((modes.shape[1], N_DRAWS))
    shared = factor @ rng.standard_normal((factor.shape[1], N_DRAWS))
    rank = np.zeros(len(error))
    for run, (own, sd) in enumerate(zip(error, std, strict=True)):
        drawn = modes @ (np.sqrt(weight_variance[run])[:, None] * by_mode) + shared
        sizes = np.abs(standardised(drawn, sd[:, None]))
        largest = np.abs(standardised(own, sd)).max(initial=0.0)
        rank[run] = np.mean(sizes.max(axis=0, initial=0.0) < largest)
    return rank
