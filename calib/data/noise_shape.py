"""How the noise of a field is correlated over its points."""

from __future__ import annotations

import numpy as np

from fe.response import Array


def correlation_at(distance: Array, length: float, smoothing: float) -> Array:
    """Correlation of noise at a distance, exp(-(sqrt(d^2 + b^2) - b) / length), all in mm.

    With `smoothing` b = 0 it is exp(-d / length), whose cusp says that noise changes by chance over
    any distance. What is interpolated between points, or correlated over subsets, does not: b
    rounds the cusp off, and far beyond b leaves exp(-d / length) times exp(b / length). With b much
    larger than the length it is exp(-d^2 / (2 b length)). It is a correlation in any number of
    dimensions (Shkarofsky, Can. J. Phys. 46, 1968, for nu = 1/2).
    """
    rounded = np.sqrt(distance**2 + smoothing**2) - smoothing
    correlation: Array = np.exp(-rounded / length)
    return correlation


def fall_off(length: float, smoothing: float) -> float:
    """Distance at which `correlation_at` is 1/e, mm: the length itself without smoothing."""
    return float(np.sqrt((length + smoothing) ** 2 - smoothing**2))
