"""Cumulative distributions of weighted points, which may be few: they go straight between these."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.inference.moments import Moments
from fe.response import Array


def furthest_apart(first: Moments, second: Moments) -> Array:
    """(d,) largest difference of the cumulative distributions of each column of two posteriors."""
    columns = zip(first.x.T, second.x.T, strict=True)
    return np.array([_apart(a, first.weights, b, second.weights) for a, b in columns])


def quantiles(values: Array, weights: Array, levels: Sequence[float]) -> Array:
    """(k,) quantiles of weighted values (n,) at levels (k,) between 0 and 1."""
    places, below = _cumulative(values, weights)
    found: Array = np.interp(levels, below, places)
    return found


def _apart(first: Array, weights: Array, second: Array, others: Array) -> float:
    at = np.unique(np.concatenate([first, second]))
    return float(np.max(np.abs(_below(at, first, weights) - _below(at, second, others))))


def _below(at: Array, values: Array, weights: Array) -> Array:
    """Share of weighted values below each place."""
    places, below = _cumulative(values, weights)
    found: Array = np.interp(at, places, below, left=0.0, right=1.0)
    return found


def _cumulative(values: Array, weights: Array) -> tuple[Array, Array]:
    """Places of weighted values, and the share below each, half of that at it."""
    places, which = np.unique(values, return_inverse=True)
    own = np.bincount(which, weights / weights.sum())
    return places, np.cumsum(own) - 0.5 * own
