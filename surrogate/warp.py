"""Coordinates in which a Gaussian process works: the unit box, stretched near some of its edges.

A response that changes fast near the low edge of an input and slowly elsewhere (of C11 near zero,
of a bulk modulus) is stationary in a logarithm of it: w(u) = ln(1 + c u) / ln(1 + c) for u >= 0
maps the unit interval to itself, c = 0 being the identity; below 0 it goes on along its tangent.
A negative strength -c stretches near the high edge: 1 - w(1 - u).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

STRENGTHS = (0.0, 10.0, 100.0, -10.0)
"""values to choose from"""


def warped(u: Array, strength: Array) -> Array:
    """Coordinates w (..., d) of points u (..., d) for strengths (d,)."""
    c = np.where(strength != 0.0, np.abs(strength), 1.0)
    turned = np.where(strength < 0.0, 1.0 - u, u)
    inside = np.log1p(c * np.maximum(turned, 0.0)) + c * np.minimum(turned, 0.0)
    stretched = inside / np.log1p(c)
    stretched = np.where(strength < 0.0, 1.0 - stretched, stretched)
    coordinates: Array = np.where(strength != 0.0, stretched, u)
    return coordinates


def warp_slope(u: Array, strength: Array) -> Array:
    """(..., d) derivative dw/du > 0."""
    c = np.where(strength != 0.0, np.abs(strength), 1.0)
    turned = np.where(strength < 0.0, 1.0 - u, u)
    slope = c / (1.0 + c * np.maximum(turned, 0.0)) / np.log1p(c)
    derivative: Array = np.where(strength != 0.0, slope, np.ones_like(u))
    return derivative
