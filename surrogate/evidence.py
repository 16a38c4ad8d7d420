"""Evidence of shared covariance parameters given values and derivatives, and its maximum.

Output j of a group has the covariance A_j (R + delta_j D): a common correlation R and shape D of
the noise, diagonal, with its own amplitude A_j and nugget delta_j, so that strong outputs may be
exact where weak ones are mostly noise. With B.T @ R @ B = diag(w) and B.T @ D @ B = 1 the inverse
is B diag(1 / (w + delta_j)) B.T: one decomposition serves all outputs. Amplitudes have a closed
form and nuggets are searched one by one, so that only what is shared, lengths and D, is searched
together (profile likelihood: Santner, Williams & Notz 2018, 4.3).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import LinAlgError, eigh
from scipy.optimize import minimize

from surrogate.covariance import Rows, covariance, prior_variance, rows_of, slopes_by_length
from surrogate.thinning import part_of_runs

Array = npt.NDArray[np.float64]

LENGTH_BOUNDS = (0.05, 20.0)
"""correlation lengths, in extents of the training inputs"""
NUGGET_BOUNDS = (1e-10, 1e2)
"""nugget as a share of the amplitude: from exact data to little but noise"""
ROUGHNESS_BOUNDS = (10.0, 1e9)
"""share of noise in the derivatives over that in the values. What a smooth covariance takes for
noise is a roughness of short length, whose derivatives are larger by the ratio of the lengths: a
run's derivatives are never to be trusted more than its values."""
_STARTING_LENGTH, _STARTING_ROUGHNESS = 1.0, 1e3
_COARSE_ROWS = 200
"""rows of the part of the runs on which the search starts"""
_COARSE_ITERATIONS, _FINE_ITERATIONS = 30, 3
_PER_DECADE, _HALVINGS = 2, 24
_NO_EVIDENCE = 1e25


class Hyperparameters(NamedTuple):
    """What the outputs of a group share."""

    length: Array
    """(d,) correlation lengths"""
    roughness: float
    """noise of derivatives over their prior variance, as a share of the nugget of the values"""


class Spectrum(NamedTuple):
    """Correlation R and noise D of the rows, both diagonal in one basis."""

    values: Array
    """(n_rows,) w >= 0"""
    basis: Array
    """(n_rows, n_rows) B with B.T @ R @ B = diag(w), B.T @ D @ B = 1"""
    noise: Array
    """(n_rows,) diagonal of D"""


class Fitted(NamedTuple):
    """Maximum of the evidence of a group of outputs."""

    family: int
    hyperparameters: Hyperparameters
    nugget: Array
    """(k,) noise variance of values over the amplitude"""
    log_evidence: float
    part: npt.NDArray[np.int64]
    """runs whose evidence it is"""
    n_rows: int
    """their values and derivatives"""


def noise_shape(family: int, parameters: Hyperparameters, rows: Rows) -> Array:
    """(n_rows,) diagonal of D: noise variance of each row over that of values."""
    slopes = parameters.roughness * prior_variance(family, parameters.length, rows)
    shape: Array = np.where(rows.is_slope, slopes, 1.0)
    return shape


def spectrum(family: int, parameters: Hyperparameters, x: Array, rows: Rows) -> Spectrum:
    """Decomposition for rows at x (n, d), at unit amplitude.

    Raises ValueError where LAPACK does not converge, as with numbers that are not finite.
    """
    noise = noise_shape(family, parameters, rows)
    root = 1.0 / np.sqrt(noise)
    matrix = covariance(family, parameters.length, x, rows, x, rows)
    matrix *= root
    matrix *= root[:, None]
    try:
        values, vectors = eigh(matrix, overwrite_a=True, driver="evd")
    except LinAlgError as error:
        raise ValueError(f"y: no covariance of the runs can be decomposed ({error})") from error
    return Spectrum(np.maximum(values, 0.0), root[:, None] * vectors, noise)


def best_nuggets(values: Array, rotated: Array) -> Array:
    """(k,) nuggets of the largest evidence; `rotated` (n_rows, k) are B.T @ y.

    The best of a grid, then its two neighbours closed in by the golden section.
    """
    squared, k = rotated**2, rotated.shape[1]
    low, high = np.log10(NUGGET_BOUNDS)
    grid = np.linspace(low, high, int(_PER_DECADE * (high - low)) + 1)
    each = _profile(values, squared, np.broadcast_to(10.0 ** grid[:, None], (len(grid), k)))
    best = np.argmax(each, axis=0)
    left, right = grid[np.maximum(best - 1, 0)], grid[np.minimum(best + 1, len(grid) - 1)]
    golden = (np.sqrt(5.0) - 1.0) / 2.0
    for _ in range(_HALVINGS):
        first, second = right - golden * (right - left), left + golden * (right - left)
        both = _profile(values, squared, 10.0 ** np.stack([first, second]))
        higher = both[0] > both[1]
        left, right = np.where(higher, left, first), np.where(higher, second, right)
    middle = 0.5 * (left + right)
    # The end of a bracket at a bound of the search is never reached from inside.
    for bound in (low, high):
        middle = np.where(np.abs(middle - bound) < 1e-3, bound, middle)
    nuggets: Array = 10.0**middle
    return nuggets


def _profile(values: Array, squared: Array, nugget: Array) -> Array:
    """Log evidence of each output with its best amplitude, without what is the same for all.

    `squared` (n_rows, k) are the outputs in the basis, squared; `nugget` (..., k), as the result.
    """
    n = len(values)
    total = values[:, None] + nugget[..., None, :]
    amplitude = np.maximum(np.sum(squared / total, axis=-2) / n, np.finfo(float).tiny)
    value: Array = -0.5 * (n * np.log(amplitude) + np.sum(np.log(total), axis=-2))
    return value


def log_evidence(
    family: int,
    parameters: Hyperparameters,
    x: Array,
    rows: Rows,
    y: Array,
    nugget: Array | None = None,
) -> tuple[float, Array]:
    """Log evidence of outputs y (n_rows, k) with their best amplitudes, and its slope.

    `nugget` (k,): by default the best, then the slope is that of the maximum over nuggets.
    The slope is by ln of lengths and of the roughness.
    """
    n, k = y.shape
    found = spectrum(family, parameters, x, rows)
    rotated = found.basis.T @ y
    if nugget is None:
        nugget = best_nuggets(found.values, rotated)
    constant = -0.5 * k * (n * (np.log(2.0 * np.pi) + 1.0) + np.sum(np.log(found.noise)))
    value = float(np.sum(_profile(found.values, rotated**2, nugget)) + constant)
    inverse = 1.0 / (found.values[:, None] + nugget)
    amplitude = np.maximum(np.sum(rotated**2 * inverse, axis=0) / n, np.finfo(float).tiny)
    alpha = found.basis @ (rotated * inverse)
    weight = (alpha / amplitude) @ alpha.T
    weight -= (found.basis * inverse.sum(axis=1)) @ found.basis.T
    by_length = slopes_by_length(family, parameters.length, x, rows, 0.5 * weight)
    explained = found.basis**2 @ (inverse @ nugget)
    by_noise = 0.5 * found.noise * (alpha**2 @ (nugget / amplitude) - explained)
    # The noise of derivatives is a share of their prior variance, which falls as length^-2.
    for axis in range(len(by_length)):
        own = rows.of_point[:, 1 + axis]
        by_length[axis] -= 2.0 * by_noise[own[own >= 0]].sum()
    return value, np.array([*by_length, by_noise[rows.is_slope].sum()])


def nuggets_of(
    family: int, parameters: Hyperparameters, x: Array, rows: Rows, y: Array
) -> tuple[Array, Array]:
    """(k,) best nuggets of outputs y (n_rows, k) under shared parameters, and (k,) log evidences.

    Up to what is the same for all parameters.
    """
    found = spectrum(family, parameters, x, rows)
    rotated = found.basis.T @ y
    nugget = best_nuggets(found.values, rotated)
    evidence = _profile(found.values, rotated**2, nugget) - 0.5 * np.sum(np.log(found.noise))
    return nugget, evidence


def maximise_evidence(
    families: tuple[int, ...],
    x: Array,
    usable: npt.NDArray[np.bool_],
    y: Array,
    rng: np.random.Generator,
    n_restarts: int,
    *,
    start: Hyperparameters | None = None,
    max_iterations: int = _COARSE_ITERATIONS,
) -> Fitted:
    """Family and parameters of the largest evidence of outputs y (n_rows, k).

    `usable` (n, d) marks the derivatives among the rows. Each family is searched from a fixed
    point, the best one also from `n_restarts` random ones, on a part of the runs where all have
    more than 200 rows; what is found is then followed on all of them. `start` takes the place of
    the fixed point. Raises ValueError where nothing can be decomposed.
    """
    part, part_rows, part_y = _thinned(x, usable, y, _COARSE_ROWS)
    fixed, *random = _starts(x.shape[1], rng, n_restarts)
    if start is not None:
        fixed = np.log([*start.length, start.roughness])

    def searched(family: int, at: Array) -> tuple[int, Array, float]:
        return family, *_search(family, x[part], part_rows, part_y, at, max_iterations)

    found = [searched(family, fixed) for family in families]
    family = max(found, key=lambda entry: entry[2])[0]
    found += [searched(family, point) for point in random]
    family, best, value = max(found, key=lambda entry: entry[2])
    if len(part) < len(x):
        part, part_rows, part_y = np.arange(len(x)), rows_of(usable), y
        best, value = _search(family, x, part_rows, y, best, _FINE_ITERATIONS)
    parameters = _unpacked(best)
    decomposed = spectrum(family, parameters, x[part], part_rows)
    nugget = best_nuggets(decomposed.values, decomposed.basis.T @ part_y)
    return Fitted(family, parameters, nugget, value, part, part_rows.n_rows)


def bounds_reached(parameters: Hyperparameters, nugget: Array, has_slopes: bool) -> list[str]:
    """Names of the parameters at a bound of the search, with the bound."""
    checked = [(f"length {i}", v, LENGTH_BOUNDS) for i, v in enumerate(parameters.length)]
    checked += [("nugget", value, NUGGET_BOUNDS) for value in nugget]
    if has_slopes:
        checked.append(("slope nugget over nugget", parameters.roughness, ROUGHNESS_BOUNDS))
    reached = []
    for name, value, (low, high) in checked:
        if value <= low * 1.001:
            reached.append(f"{name} at its lower bound {low:g}")
        if value >= high / 1.001:
            reached.append(f"{name} at its upper bound {high:g}")
    return list(dict.fromkeys(reached))


def _thinned(
    x: Array, usable: npt.NDArray[np.bool_], y: Array, n_rows: int
) -> tuple[npt.NDArray[np.int64], Rows, Array]:
    """Runs drawn so that no more than about `n_rows` rows are left, and their rows."""
    rows = rows_of(usable)
    part = part_of_runs(x, rows.n_rows, n_rows)
    kept = rows.of_point[part]
    order = np.concatenate([kept[:, 0], kept[:, 1:][kept[:, 1:] >= 0]])
    return part, rows_of(usable[part]), y[order]


def _starts(d: int, rng: np.random.Generator, n_restarts: int) -> list[Array]:
    fixed = np.log([*[_STARTING_LENGTH] * d, _STARTING_ROUGHNESS])
    random = [
        np.append(rng.uniform(np.log(0.2), np.log(5.0), d), np.log(10.0) * rng.uniform(1.0, 5.0))
        for _ in range(n_restarts)
    ]
    return [fixed, *random]


def _search(
    family: int, x: Array, rows: Rows, y: Array, start: Array, max_iterations: int
) -> tuple[Array, float]:
    def negative(packed: Array) -> tuple[float, Array]:
        value, slope = log_evidence(family, _unpacked(packed), x, rows, y)
        return (-value, -slope) if np.isfinite(value) else (_NO_EVIDENCE, slope)

    limits = [LENGTH_BOUNDS] * x.shape[1] + [ROUGHNESS_BOUNDS]
    result = minimize(
        negative,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=[(np.log(low), np.log(high)) for low, high in limits],
        options={"maxiter": max_iterations},
    )
    return result.x, -float(result.fun)


def _unpacked(packed: Array) -> Hyperparameters:
    values = np.exp(packed)
    return Hyperparameters(values[:-1], float(values[-1]))
