"""The band in which a whole field lies with every value, by fields drawn from its prediction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from surrogate.field_prediction import FieldPrediction
from surrogate.run_scale import RunScale

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


def largest_of_drawn(std: Array, spread: Spread, rest: Array | None = None) -> Array:
    """(n, N_DRAWS) largest standardised error of fields drawn from each prediction.

    `std` (n, n_obs) in mm; `rest` (n_obs,) mm^2 are variances of independent errors in it. Unlike
    the Mahalanobis distance it needs no inverse, which a covariance of low rank does not have.
    Draws are the same for all runs and calls.
    """
    modes, weight_variance, factor = spread
    rng = np.random.default_rng(0)
    by_mode = rng.standard_normal((modes.shape[1], N_DRAWS))
    shared = factor @ rng.standard_normal((factor.shape[1], N_DRAWS))
    if rest is not None:
        shared += np.sqrt(rest)[:, None] * rng.standard_normal((len(rest), N_DRAWS))
    largest = np.empty((len(std), N_DRAWS))
    for run, sd in enumerate(std):
        drawn = modes @ (np.sqrt(weight_variance[run])[:, None] * by_mode) + shared
        largest[run] = np.abs(standardised(drawn, sd[:, None])).max(axis=0, initial=0.0)
    return largest


def field_band(prediction: FieldPrediction, level: float, scale: RunScale | None = None) -> Array:
    """(m, n_step, n_point, 3) half width, mm, of the band that holds a whole field.

    With probability `level` a new run lies with every value within it about the mean, if its errors
    have the `scale` that runs left out tell (`leave_one_out_residuals(...).told_scales.field`), by
    default if they are normal.
    Raises ValueError for a level that is no probability.
    """
    if not 0.0 < level < 1.0:
        raise ValueError(f"level: expected a probability between 0 and 1, found {level:g}")
    scale = RunScale() if scale is None else scale
    std = prediction.std.reshape(len(prediction.mean), -1)
    spread = Spread(prediction.modes, prediction.weight_variance, prediction.truncation)
    largest = largest_of_drawn(std, spread, prediction.rest)
    factors = [scale.level(drawn, level) for drawn in largest]
    half: Array = (np.array(factors)[:, None] * std).reshape(prediction.mean.shape)
    return half
