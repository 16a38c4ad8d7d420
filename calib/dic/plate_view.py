"""What one camera sees of a flat calibration plate: points of the plate and their pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.dic.distortion import Array

LEAST_POINTS = 8


@dataclass(frozen=True)
class PlateView:
    """One image of a plate. Raises ValueError with too few points."""

    name: str
    """of the image"""
    places: Array
    """(n, 2) on the plate, mm"""
    pixels: Array
    """(n, 2) px"""
    radius: float = 0.0
    """of the dots, mm; 0 where the points are corners, which perspective does not shift"""

    def __post_init__(self) -> None:
        if len(self.places) < LEAST_POINTS:
            raise ValueError(
                f"{self.name}: found {len(self.places)} points of the plate, "
                f"expected {LEAST_POINTS} or more"
            )


def map_plane(homography: Array, points: Array) -> Array:
    """(n, 2) points mapped by a homography (3, 3)."""
    mapped = points @ homography[:, :2].T + homography[:, 2]
    flat: Array = mapped[:, :2] / mapped[:, 2:]
    return flat


def fit_homography(places: Array, pixels: Array) -> Array:
    """(3, 3) from the plate to the image: normalised direct linear fit (Hartley, section 4.4)."""
    to_places, to_pixels = _normalising(places), _normalising(pixels)
    x, u = map_plane(to_places, places), map_plane(to_pixels, pixels)
    one = np.column_stack([x, np.ones(len(x))])
    nothing = np.zeros_like(one)
    rows = np.vstack(
        [
            np.hstack([one, nothing, -u[:, :1] * one]),
            np.hstack([nothing, one, -u[:, 1:] * one]),
        ]
    )
    normalised = np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, 3)
    found = np.linalg.inv(to_pixels) @ normalised @ to_places
    scaled: Array = found / found[2, 2]
    return scaled


def _normalising(points: Array) -> Array:
    """(3, 3) that brings points to mean 0 and a mean distance of the root of 2."""
    middle = points.mean(axis=0)
    scale = np.sqrt(2.0) / np.linalg.norm(points - middle, axis=1).mean()
    return np.array([[scale, 0.0, -scale * middle[0]], [0.0, scale, -scale * middle[1]], [0, 0, 1]])
