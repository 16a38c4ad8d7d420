"""Speckle images whose truth is exact: sums of Gaussian spots, evaluated where each pixel looks.

No image is interpolated. The maps have the form X(x), Y(y) (shifts, stretches along the axes, any
u(x)), for which the sum over the spots is a product of two matrices, tile by tile.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
TILE = 48
"""px of a square that is summed at once"""
REACH = 6.5


@dataclass(frozen=True)
class Speckle:
    """Spots on the material; lengths in px of the reference image."""

    centres: Array
    """(k, 2) x, y"""
    radii: Array
    """(k,) standard deviation"""
    heights: Array
    """(k,)"""

    def __call__(self, X: Array, Y: Array) -> Array:
        """(h, w) brightness seen by pixels that look at the material's places X (w,), Y (h,).

        X and Y grow along the array. A spot counts to REACH of its radii (1e-9 of its height).
        """
        out = np.empty((Y.size, X.size))
        reach = REACH * float(self.radii.max())
        for top in range(0, Y.size, TILE):
            rows = slice(top, top + TILE)
            near = np.abs(self.centres[:, 1] - _middle(Y[rows])) < _half(Y[rows]) + reach
            strip = Speckle(self.centres[near], self.radii[near], self.heights[near])
            for left in range(0, X.size, TILE):
                columns = slice(left, left + TILE)
                across = np.abs(strip.centres[:, 0] - _middle(X[columns]))
                part = across < _half(X[columns]) + reach
                (x, y), r = strip.centres[part].T, strip.radii[part, None]
                along = np.exp(-0.5 * ((X[columns] - x[:, None]) / r) ** 2)
                down = np.exp(-0.5 * ((Y[rows] - y[:, None]) / r) ** 2)
                out[rows, columns] = (down * strip.heights[part, None]).T @ along
        return out


def _middle(places: Array) -> float:
    return float(places[0] + places[-1]) / 2


def _half(places: Array) -> float:
    return float(places[-1] - places[0]) / 2


def speckle(
    width: float, height: float, rng: np.random.Generator, radius: float = 1.5, margin: float = 10
) -> Speckle:
    """Bright and dark spots at random places over width x height px and a margin around.

    Radii within 20 % of `radius`; as many that a point is covered by some six spots.
    """
    area = (width + 2 * margin) * (height + 2 * margin)
    k = int(area / radius**2)
    centres = rng.uniform([-margin, -margin], [width + margin, height + margin], (k, 2))
    radii = radius * rng.uniform(0.8, 1.2, k)
    return Speckle(centres, radii, rng.choice([-1.0, 1.0], k))


def exposed(
    brightness: Array,
    rng: np.random.Generator,
    noise: float = 2.55,
    contrast: float = 45.0,
    spread: float = 1.0,
    full_scale: float = 255.0,
) -> Array:
    """A camera's image: grey levels about half of full scale, noise after sampling, rounding.

    contrast: SD in grey levels that a brightness of SD `spread` becomes.
    """
    grey = full_scale / 2 + brightness * contrast / spread
    return np.clip(np.round(grey + rng.normal(0.0, noise, grey.shape)), 0.0, full_scale)
