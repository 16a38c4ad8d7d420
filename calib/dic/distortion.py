"""Lens distortion: radial and tangential, its derivatives and its inverse.

Coordinates are those of the image plane at distance 1 in front of the camera (no unit). Source:
D. C. Brown, "Close-range camera calibration", Photogrammetric Engineering 37 (1971) 855-866.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
BROWN = (2, 4, 6)
"""powers of the radius in the factor 1 + k1 r^2 + k2 r^4 + k3 r^6"""
N_COEFFICIENT = 5
INVERSE_STEPS = 30
SMALLEST_RADIUS = 1e-12
CONVERGED = 1e-13
"""of the inverse: 1e-9 px with a focal length of 10,000 px"""


@dataclass(frozen=True)
class Distortion:
    """x (1 + k1 r^a + k2 r^b + k3 r^c) and Brown's tangential part with p1, p2 in OpenCV's order.

    Raises ValueError when a coefficient is not finite.
    """

    radial: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tangential: tuple[float, float] = (0.0, 0.0)
    powers: tuple[int, int, int] = BROWN
    """a, b, c: files of other programs have other ones than Brown's"""

    def __post_init__(self) -> None:
        if not np.all(np.isfinite(self.coefficients)):
            raise ValueError(f"distortion: expected finite numbers, found {self.coefficients}")

    @property
    def coefficients(self) -> Array:
        """(5,) k1, k2, k3, p1, p2."""
        return np.array([*self.radial, *self.tangential], dtype=np.float64)


class Distorted(NamedTuple):
    """Distorted points and what they depend on."""

    points: Array
    """(n, 2)"""
    by_point: Array
    """(n, 2, 2) derivative by the undistorted point"""
    by_coefficient: Array
    """(n, 2, 5) derivative by k1, k2, k3, p1, p2"""


def distort(distortion: Distortion, points: Array) -> Distorted:
    """Where the lens shows undistorted points (n, 2), with exact derivatives."""
    x, y = points[:, 0], points[:, 1]
    squared = x * x + y * y
    radius = np.maximum(np.sqrt(squared), SMALLEST_RADIUS)
    powers = np.stack([radius**power for power in distortion.powers], axis=1)
    k, (p1, p2) = np.array(distortion.radial), distortion.tangential
    factor = 1.0 + powers @ k
    # d factor / d x = slope x, likewise y
    slope = (powers * np.array(distortion.powers)) @ k / radius**2
    moved = np.empty_like(points)
    moved[:, 0] = factor * x + 2.0 * p1 * x * y + p2 * (squared + 2.0 * x * x)
    moved[:, 1] = factor * y + p1 * (squared + 2.0 * y * y) + 2.0 * p2 * x * y
    by_point = np.empty((len(points), 2, 2))
    by_point[:, 0, 0] = factor + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
    by_point[:, 0, 1] = by_point[:, 1, 0] = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
    by_point[:, 1, 1] = factor + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
    by_coefficient = np.empty((len(points), 2, N_COEFFICIENT))
    by_coefficient[:, :, :3] = points[:, :, None] * powers[:, None, :]
    by_coefficient[:, 0, 3] = by_coefficient[:, 1, 4] = 2.0 * x * y
    by_coefficient[:, 0, 4] = squared + 2.0 * x * x
    by_coefficient[:, 1, 3] = squared + 2.0 * y * y
    return Distorted(moved, by_point, by_coefficient)


def undistort(distortion: Distortion, points: Array) -> Array:
    """The inverse of `distort` by Newton's method; NaN where it has none.

    Beyond the radius at which a lens folds the image over, the polynomial has solutions that no
    lens shows: on the other side of the middle, or turned inside out.
    """
    found = points.copy()
    if not np.any(distortion.coefficients):
        return found
    is_open = np.all(np.isfinite(points), axis=1)
    found[~is_open] = np.nan
    for _ in range(INVERSE_STEPS):
        if not is_open.any():
            break
        now = distort(distortion, found[is_open])
        error = now.points - points[is_open]
        found[is_open] -= np.linalg.solve(now.by_point, error[..., None])[..., 0]
        is_open[is_open] = np.abs(error).max(axis=1) > CONVERGED
    found[is_open] = np.nan
    known = np.isfinite(found).all(axis=1)
    slopes = np.linalg.det(distort(distortion, found[known]).by_point)
    is_shown = (slopes > 0.0) & ((found[known] * points[known]).sum(axis=1) >= 0.0)
    found[np.flatnonzero(known)[~is_shown]] = np.nan
    return found
