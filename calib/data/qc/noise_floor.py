"""Noise of a field from frames in which nothing moves, or from samples that should be alike."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.distance import cdist

from fe.response import Array

FARTHEST = 2.0
"""mm, beyond which the correlation is not looked at"""
MOST_POINTS = 1500


class NoiseFloor(NamedTuple):
    """Noise of one frame's field against its reference."""

    std: Array
    """(3,) SD of each component at one point, mm"""
    correlation_length: float
    """mm, of exp(-d / length)"""
    nugget: float
    """share of the variance that is not correlated between points"""
    reference_share: float
    """share of the variance that the reference frame gives to all frames alike"""
    n_frames: int
    distance: Array
    """(n_bin,) mm, at which the correlation was measured"""
    correlation: Array
    """(n_bin,) measured correlation"""


def noise_floor(fields: Array, points: Array) -> NoiseFloor:
    """Noise of fields (n_frame, n, 3) [mm] at points (n, 2) [mm] that all have one reference.

    NaN where nothing was measured. A shift of a whole frame is no noise of its points and is taken
    off. Raises ValueError with fewer than 2 frames or 10 points that all frames have.
    """
    if len(fields) < 2:
        raise ValueError(f"expected 2 or more frames beside the reference, found {len(fields)}")
    complete = np.isfinite(fields).all(axis=(0, 2))
    if np.count_nonzero(complete) < 10:
        raise ValueError(
            f"expected 10 or more points in all frames, found {np.count_nonzero(complete)}"
        )
    values, places = fields[:, complete], points[complete]
    if len(places) > MOST_POINTS:
        chosen = np.linspace(0, len(places) - 1, MOST_POINTS).astype(int)
        values, places = values[:, chosen], places[chosen]
    values = values - values.mean(axis=1, keepdims=True)
    variance = (values**2).mean(axis=(0, 1))
    if not np.all(variance > 0):
        raise ValueError("expected frames with noise in all components, found some without")
    scaled = values / np.sqrt(variance)
    between = np.einsum("fpc,gpc->fg", scaled, scaled) / scaled[0].size
    n = len(fields)
    share = (between.sum() - np.trace(between)) / (n * (n - 1))
    distance, correlation = correlogram(scaled, places)
    length, nugget = fit_length(distance, correlation)
    # the mean that was taken off had a share of a correlated field's variance
    lost = (1 - nugget) * float(np.exp(-cdist(places, places) / length).mean())
    std = np.sqrt(variance / max(1 - lost, 0.2))
    share = float(np.clip(share, 0.0, 0.99))
    return NoiseFloor(std, length, nugget, share, n, distance, correlation)


def correlogram(values: Array, points: Array) -> tuple[Array, Array]:
    """Correlation of values (n_frame, n, n_component) of unit variance over the distance [mm].

    Distances with few pairs are left out.
    """
    apart = cdist(points, points)
    product = np.einsum("fpc,fqc->pq", values, values, optimize=True)
    product /= values.shape[0] * values.shape[2]
    nearest = np.where(apart > 0, apart, np.inf).min(axis=1)
    width = float(np.median(nearest))
    bins = np.round(apart / width).astype(np.int64)
    upper = np.triu(np.ones(apart.shape, dtype=np.bool_), 1) & (apart < FARTHEST)
    count = np.bincount(bins[upper])
    kept = (count >= len(points) / 2) & (np.arange(count.size) > 0)
    total = np.bincount(bins[upper], weights=product[upper])[kept]
    distance = np.bincount(bins[upper], weights=apart[upper])[kept] / count[kept]
    return distance, total / count[kept]


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
