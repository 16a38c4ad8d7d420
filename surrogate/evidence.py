"""Evidence of shared covariance parameters given values and derivatives, and its maximum.

All outputs of a group have the covariance A_j (R + diag(nuggets)), with a common correlation R and
their own amplitudes A_j. The amplitudes have a closed form, so that only lengths and nuggets, given
as shares of the amplitude, are searched (profile likelihood: Santner, Williams & Notz 2018, 4.3).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import lapack
from scipy.optimize import minimize

from surrogate.covariance import Rows, covariance, prior_variance, rows_of, slopes_by_length

Array = npt.NDArray[np.float64]

LENGTH_BOUNDS = (0.05, 20.0)
"""correlation lengths, in extents of the training inputs"""
NUGGET_BOUNDS = (1e-10, 1.0)
"""nugget as a share of the amplitude: from exact data to as much noise as signal"""
ROUGHNESS_BOUNDS = (10.0, 1e9)
"""share of noise in the derivatives over that in the values. What a smooth covariance takes for
noise is a roughness of short length, whose derivatives are larger by the ratio of the lengths: a
run's derivatives are never to be trusted more than its values."""
_STARTING_LENGTH, _STARTING_NUGGET, _STARTING_ROUGHNESS = 1.0, 1e-6, 1e3
_COARSE_ROWS = 280
"""rows of the part of the runs on which the search starts"""
_COARSE_ITERATIONS, _FINE_ITERATIONS = 60, 6
_NO_EVIDENCE = 1e25


class Hyperparameters(NamedTuple):
    """Parameters of one covariance at unit amplitude."""

    length: Array
    """(d,) correlation lengths"""
    nugget: float
    """noise variance of values"""
    slope_nugget: float
    """noise variance of derivatives over their prior variance"""


class Fitted(NamedTuple):
    """Maximum of the evidence of a group of outputs."""

    family: int
    hyperparameters: Hyperparameters
    log_evidence: float
    part: npt.NDArray[np.int64]
    """runs whose evidence it is"""
    n_rows: int
    """their values and derivatives"""


def noise_variance(family: int, parameters: Hyperparameters, rows: Rows) -> Array:
    """(n_rows,) noise variance of each row at unit amplitude."""
    slopes = parameters.slope_nugget * prior_variance(family, parameters.length, rows)
    noise: Array = np.where(rows.is_slope, slopes, parameters.nugget)
    return noise


def noisy_covariance(family: int, parameters: Hyperparameters, x: Array, rows: Rows) -> Array:
    """(n_rows, n_rows) covariance of the noisy rows at x (n, d), at unit amplitude."""
    matrix = covariance(family, parameters.length, x, rows, x, rows)
    matrix[np.diag_indices_from(matrix)] += noise_variance(family, parameters, rows)
    return matrix


def log_evidence(
    family: int, parameters: Hyperparameters, x: Array, rows: Rows, y: Array
) -> tuple[float, Array]:
    """Log evidence of outputs y (n_rows, k) with their best amplitudes, and its slope.

    The slope is by ln of lengths, nugget and slope nugget. A covariance that is not positive
    definite in floating point has the evidence -inf and no slope.
    """
    n, k = y.shape
    matrix = noisy_covariance(family, parameters, x, rows)
    factor, failed = lapack.dpotrf(matrix, lower=1, clean=1)
    if failed:
        return -np.inf, np.zeros(len(parameters.length) + 2)
    alpha = lapack.dpotrs(factor, y, lower=1)[0]
    amplitude = np.maximum(np.einsum("nk,nk->k", y, alpha) / n, np.finfo(float).tiny)
    half_logdet = np.sum(np.log(np.diag(factor)))
    value = -0.5 * n * np.sum(np.log(2.0 * np.pi * amplitude) + 1.0) - k * half_logdet
    inverse = lapack.dpotri(factor, lower=1)[0]
    inverse = inverse + inverse.T  # LAPACK gives the lower half
    inverse[np.diag_indices_from(inverse)] *= 0.5
    weight = 0.5 * ((alpha / amplitude) @ alpha.T - k * inverse)
    by_length = slopes_by_length(family, parameters.length, x, rows, weight)
    by_noise = np.diag(weight) * noise_variance(family, parameters, rows)
    # The noise of derivatives is a share of their prior variance, which falls as length^-2.
    for axis in range(len(by_length)):
        own = rows.of_point[:, 1 + axis]
        by_length[axis] -= 2.0 * by_noise[own[own >= 0]].sum()
    is_slope = rows.is_slope
    slope = [*by_length, by_noise[~is_slope].sum(), by_noise[is_slope].sum()]
    return float(value), np.array(slope)


def maximise_evidence(
    families: tuple[int, ...],
    x: Array,
    usable: npt.NDArray[np.bool_],
    y: Array,
    rng: np.random.Generator,
    n_restarts: int,
    *,
    coarse_rows: int | None = None,
) -> Fitted:
    """Family and parameters of the largest evidence of outputs y (n_rows, k).

    `usable` (n, d) marks the derivatives among the rows. Each family is searched from a fixed
    point and `n_restarts` random ones, on a part of the runs where all have more than 280 rows;
    the best family is then followed on all of them.  `coarse_rows` takes as many rows instead, and
    stays with them.
    Raises ValueError when no covariance is positive definite.
    """
    part, part_rows, part_y = _thinned(usable, y, coarse_rows or _COARSE_ROWS)
    starts = _starts(x.shape[1], rng, n_restarts)
    found = [
        (family, *_search(family, x[part], part_rows, part_y, start, _COARSE_ITERATIONS))
        for family in families
        for start in starts
    ]
    family, best, value = max(found, key=lambda entry: entry[2])
    if not np.isfinite(value):
        raise ValueError("y: no covariance of the runs is positive definite; are points the same?")
    if len(part) < len(x) and coarse_rows is None:
        part, part_rows = np.arange(len(x)), rows_of(usable)
        best, value = _search(family, x, part_rows, y, best, _FINE_ITERATIONS)
    return Fitted(family, _unpacked(best), value, part, part_rows.n_rows)


def bounds_reached(parameters: Hyperparameters, has_slopes: bool) -> list[str]:
    """Names of the parameters at a bound of the search, with the bound."""
    names = [f"length {axis}" for axis in range(len(parameters.length))]
    values = [*parameters.length, parameters.nugget]
    bounds = [LENGTH_BOUNDS] * len(names) + [NUGGET_BOUNDS]
    names.append("nugget")
    if has_slopes:
        names.append("slope nugget over nugget")
        values.append(parameters.slope_nugget / parameters.nugget)
        bounds.append(ROUGHNESS_BOUNDS)
    reached = []
    for name, value, (low, high) in zip(names, values, bounds, strict=True):
        if value <= low * 1.001:
            reached.append(f"{name} at its lower bound {low:g}")
        if value >= high / 1.001:
            reached.append(f"{name} at its upper bound {high:g}")
    return reached


def _thinned(
    usable: npt.NDArray[np.bool_], y: Array, n_rows: int
) -> tuple[npt.NDArray[np.int64], Rows, Array]:
    """Every so manieth run, so that no more than about `n_rows` rows are left, and its rows."""
    rows = rows_of(usable)
    step = -(-rows.n_rows // n_rows)
    part = np.arange(0, len(usable), step)
    kept = rows.of_point[part]
    order = np.concatenate([kept[:, 0], kept[:, 1:][kept[:, 1:] >= 0]])
    return part, rows_of(usable[part]), y[order]


def _starts(d: int, rng: np.random.Generator, n_restarts: int) -> list[Array]:
    fixed = np.log([*[_STARTING_LENGTH] * d, _STARTING_NUGGET, _STARTING_ROUGHNESS])
    random = [
        np.concatenate([rng.uniform(np.log(0.2), np.log(5.0), d), np.log(10.0) * noise])
        for noise in rng.uniform([-9.0, 1.0], [-3.0, 5.0], (n_restarts, 2))
    ]
    return [fixed, *random]


def _search(
    family: int, x: Array, rows: Rows, y: Array, start: Array, max_iterations: int
) -> tuple[Array, float]:
    def negative(packed: Array) -> tuple[float, Array]:
        value, slope = log_evidence(family, _unpacked(packed), x, rows, y)
        if not np.isfinite(value):
            return _NO_EVIDENCE, slope
        # From ln of both nuggets to ln of the nugget and of the ratio of the two.
        by_nugget = slope[-2] + slope[-1]
        return -value, -np.array([*slope[:-2], by_nugget, slope[-1]])

    limits = [LENGTH_BOUNDS] * x.shape[1] + [NUGGET_BOUNDS, ROUGHNESS_BOUNDS]
    result = minimize(
        negative,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=[(np.log(low), np.log(high)) for low, high in limits],
        options={"maxiter": max_iterations},
    )
    return result.x, -float(result.fun) if result.fun < _NO_EVIDENCE else -np.inf


def _unpacked(packed: Array) -> Hyperparameters:
    values = np.exp(packed)
    return Hyperparameters(values[:-2], float(values[-2]), float(values[-2] * values[-1]))
