"""Noise of a field from frames in which nothing moves, or from samples that should be alike."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve, cholesky
from scipy.optimize import fmin, least_squares
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from calib.data.noise_shape import correlation_at
from fe.response import Array

FARTHEST = 2.0
"""mm, beyond which the correlation is not looked at"""
MOST_POINTS = 1500
LEAST_POINTS = 10
MOST_FITTED = 150
"""points of the likelihood of a length"""
LENGTHS = (0.01, 5.0)
"""mm, between which a length is looked for"""
MOST_SMOOTH, MOST_ROUGH = 3.0, 0.9
"""lengths that noise is smoothed over, and nugget"""
FREE_MEAN = 100.0
"""variance of a frame's mean, which was taken off"""
TINY = 1e-6


class NoiseFloor(NamedTuple):
    """Noise of one frame's field against its reference."""

    std: Array
    """(3,) SD of each component at one point, mm"""
    correlation_length: float
    """mm"""
    nugget: float
    """share of the variance that is not correlated between points"""
    reference_share: float
    """share of the variance that the reference frame gives to all frames alike"""
    n_frames: int
    distance: Array
    """(n_bin,) mm, at which the correlation was measured"""
    correlation: Array
    """(n_bin,) measured correlation"""
    smoothing: float = 0.0
    """mm, of `correlation_at`: 0 for exp(-d / length)"""

    def correlation_at(self, distance: Array) -> Array:
        """Correlation at distances [mm] of what is correlated between points."""
        return correlation_at(distance, self.correlation_length, self.smoothing)

    def effective_number(self, points: Array, n_step: int) -> float:
        """Number of independent values that as much noise of `n_step` frames at `points` holds.

        (tr C)^2 / tr C^2 of its covariance C, over points (n, 2) [mm], frames and components.
        """
        apart = (1 - self.nugget) * self.correlation_at(cdist(points, points))
        np.fill_diagonal(apart, 1.0)
        frames = n_step / (1 + (n_step - 1) * self.reference_share**2)
        variance = self.std**2
        components = float(variance.sum() ** 2 / (variance**2).sum())
        return float(len(points) ** 2 / (apart**2).sum()) * frames * components


class _Pairs(NamedTuple):
    """Pairs of points, by the number of spacings between them."""

    pairs: Array
    distance: Array
    """sum of distances, mm"""
    product: Array
    """sum of the products of their values, mean over frames and components"""


def noise_floor(fields: Array, points: Array) -> NoiseFloor:
    """Noise of fields (n_frame, n, 3) [mm] at points (n, 2) [mm] that all have one reference.

    NaN where nothing was measured. A shift of a whole frame is no noise of its points and is taken
    off. Raises ValueError with fewer than 2 frames or 10 points that all frames have.
    """
    return pooled_noise([fields], points)


def pooled_noise(series: Sequence[Array], points: Array, *, roughly: bool = False) -> NoiseFloor:
    """As `noise_floor`, of several series of frames with one noise and a reference each.

    `roughly`: the length is that of a curve through the correlogram, summed over the series.
    """
    parts = [_at_complete(fields, points) for fields in series]
    n_frame = np.array([len(values) for values, _ in parts], dtype=np.float64)
    weights = n_frame / n_frame.sum()
    variance: Array = np.einsum(
        "s,sc->c", weights, np.array([(values**2).mean(axis=(0, 1)) for values, _ in parts])
    )
    if not np.all(variance > 0):
        raise ValueError("expected frames with noise in all components, found some without")
    scaled = [values / np.sqrt(variance) for values, _ in parts]
    between = sum(_between(values) for values in scaled)
    share = float(np.clip(between / (n_frame * (n_frame - 1)).sum(), 0.0, 0.99))
    places = parts[0][1]
    width = _spacing(places)
    pairs = [_pairs(v, at, width) for v, (_, at) in zip(scaled, parts, strict=True)]
    distance, correlation = _correlation(pairs, weights, len(places))
    length, nugget = fit_length(distance, correlation)
    smoothing = 0.0
    if roughly:
        # the mean that was taken off had a share of a correlated field's variance
        lost = (1 - nugget) * float(np.exp(-cdist(places, places) / length).mean())
        factor = 1 / max(1 - lost, 0.2)
    else:
        at_points = [(values, at) for values, (_, at) in zip(scaled, parts, strict=True)]
        length, smoothing, nugget, factor = likeliest(at_points, share, (length, nugget))
    std, n = np.sqrt(variance * factor), int(n_frame.sum())
    return NoiseFloor(std, length, nugget, share, n, distance, correlation, smoothing)


def _at_complete(fields: Array, points: Array) -> tuple[Array, Array]:
    """Deviations of each frame from its mean at the points that all frames have, and these."""
    if len(fields) < 2:
        raise ValueError(f"expected 2 or more frames beside the reference, found {len(fields)}")
    complete = np.isfinite(fields).all(axis=(0, 2))
    if np.count_nonzero(complete) < LEAST_POINTS:
        raise ValueError(
            f"expected {LEAST_POINTS} or more points in all frames, "
            f"found {np.count_nonzero(complete)}"
        )
    values, places = fields[:, complete], points[complete]
    if len(places) > MOST_POINTS:
        chosen = np.linspace(0, len(places) - 1, MOST_POINTS).astype(int)
        values, places = values[:, chosen], places[chosen]
    return values - values.mean(axis=1, keepdims=True), places


def _between(values: Array) -> float:
    """Sum of the correlations of all pairs of different frames of values (n_frame, n, 3)."""
    products = np.einsum("fpc,gpc->fg", values, values) / values[0].size
    return float(products.sum() - np.trace(products))


def correlogram(values: Array, points: Array) -> tuple[Array, Array]:
    """Correlation of values (n_frame, n, n_component) of unit variance over the distance [mm].

    Distances with few pairs are left out.
    """
    return _correlation([_pairs(values, points, _spacing(points))], np.ones(1), len(points))


def _spacing(points: Array) -> float:
    """Median distance of a point to the next one, mm."""
    apart = np.asarray(cKDTree(points).query(points, k=2)[0], dtype=np.float64)
    return float(np.median(apart[:, 1]))


def _pairs(values: Array, points: Array, width: float) -> _Pairs:
    apart = cdist(points, points)
    flat = np.moveaxis(values, 1, 0).reshape(len(points), -1)
    product = flat @ flat.T / flat.shape[1]
    upper = np.triu(apart < FARTHEST, 1)
    bins = np.round(apart[upper] / width).astype(np.int64)
    n_bin = round(FARTHEST / width) + 2
    one = np.ones(bins.size)
    sums = [np.bincount(bins, v, n_bin) for v in (one, apart[upper], product[upper])]
    return _Pairs(*(np.asarray(v, dtype=np.float64) for v in sums))


def _correlation(pairs: Sequence[_Pairs], weights: Array, n_point: int) -> tuple[Array, Array]:
    """Distances and correlations of series that count by `weights`, whose sum is 1."""
    count: Array = weights @ np.array([one.pairs for one in pairs])
    distance: Array = weights @ np.array([one.distance for one in pairs])
    product: Array = weights @ np.array([one.product for one in pairs])
    kept = (count >= n_point / 2) & (np.arange(count.size) > 0)
    return distance[kept] / count[kept], product[kept] / count[kept]


def likeliest(
    series: Sequence[tuple[Array, Array]], share: float, start: tuple[float, float]
) -> tuple[float, float, float, float]:
    """Length, smoothing [mm], nugget and variance of greatest (restricted) likelihood.

    series are values (n_frame, n, 3) of unit variance without each frame's mean, at points (n, 2)
    [mm]; frames have `share` in common. A curve through a correlogram knows the length to a tenth,
    and the variance of what neighbours differ by, which weighs most in a likelihood, goes with its
    inverse: length and variance are to be taken together. Of many points those nearest to one
    another are used. Noise has a nugget, or is smooth, or neither: see `_shape`.
    """
    used = [_near_each_other(values, points) for values, points in series]
    scatter = [(_scatter(values, share), cdist(at, at), 3 * len(values)) for values, at in used]

    def variance_and_misfit(p: Array) -> tuple[float, float]:
        """Variance of greatest likelihood at the shape p; the misfit there, -2 ln L a value."""
        length, smoothing, nugget = _shape(p)
        total, logs, freedom = 0.0, 0.0, 0
        for product, apart, n_value in scatter:
            matrix = (1 - nugget) * correlation_at(apart, length, smoothing) + FREE_MEAN
            matrix[np.diag_indices_from(matrix)] += nugget + TINY
            factor = cholesky(matrix, lower=True)
            total += float(np.trace(cho_solve((factor, True), product)))
            logs += n_value * 2 * float(np.log(np.diag(factor)).sum())
            freedom += n_value * (len(apart) - 1)
        variance = total / freedom
        return variance, logs / freedom + float(np.log(variance))

    def misfit(p: Array) -> float:
        return variance_and_misfit(p)[1]

    first = np.array([np.log(start[0]), start[1]])
    found: Array = fmin(
        misfit,
        first,
        xtol=0.003,
        ftol=1e-6,
        maxfun=100,
        disp=False,
        initial_simplex=first + np.array([[0.0, 0.0], [0.1, 0.0], [0.0, -0.05]]),
    )
    return *_shape(found), variance_and_misfit(found)[0]


def _shape(p: Array) -> tuple[float, float, float]:
    """Length, smoothing [mm] and nugget of p: logarithm of the length, and how rough noise is.

    The second is the nugget where it is positive, and minus the smoothing over the length where it
    is negative: a little of either changes what neighbours have in common by as much.
    """
    length = float(np.clip(np.exp(p[0]), *LENGTHS))
    rough = float(np.clip(p[1], -MOST_SMOOTH, MOST_ROUGH))
    return length, max(-rough, 0.0) * length, max(rough, 0.0)


def _near_each_other(values: Array, points: Array) -> tuple[Array, Array]:
    """At most MOST_FITTED points, those nearest to their middle."""
    away = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    chosen = np.sort(np.argsort(away, kind="stable")[:MOST_FITTED])
    near = values[:, chosen]
    return near - near.mean(axis=1, keepdims=True), points[chosen]


def _scatter(values: Array, share: float) -> Array:
    """(n, n) products of values (n_frame, n, 3), over components and frames freed of their share.

    That is, with the inverse of the frames' correlation (1 - q) I + q 1 1^T between them.
    """
    n_frame, n = values.shape[:2]
    total = values.sum(axis=0)
    flat = np.moveaxis(values, 1, 0).reshape(n, -1)
    common = share / (1 + (n_frame - 1) * share)
    product: Array = (flat @ flat.T - common * total @ total.T) / (1 - share)
    return product


def fit_length(distance: Array, correlation: Array) -> tuple[float, float]:
    """Length [mm] and nugget of (1 - nugget) exp(-d / length) + offset through a correlogram.

    The offset is what taking off each frame's mean leaves.
    """
    if distance.size < 3:
        return max(float(distance.min(initial=0.1)), 1e-3) / 3, 0.0
    shortest = distance.min() / 5

    def misfit(p: Array) -> Array:
        off: Array = (1 - p[1]) * (np.exp(-distance / p[0]) - p[2]) / (1 - p[2]) - correlation
        return off

    best = None
    for start in (2 * shortest, 0.3, 1.0):
        bounds = ([shortest, 0.0, 0.0], [5.0, 0.9, 0.8])
        first = np.clip([start, 0.05, 0.05], bounds[0], bounds[1])
        found = least_squares(misfit, first, bounds=bounds)
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    return float(best.x[0]), float(best.x[1])
