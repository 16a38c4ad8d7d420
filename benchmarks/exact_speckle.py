"""Speckle images whose truth is exact: sums of Gaussian spots, evaluated where each pixel looks.

No image is interpolated. The maps have the form X(x), Y(y) (shifts, stretches along the axes, any
u(x)), for which the sum over the spots is a product of two matrices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
CHUNK = 2048


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
        """(h, w) brightness seen by pixels that look at the material's places X (w,), Y (h,)."""
        out = np.zeros((Y.size, X.size))
        for start in range(0, self.radii.size, CHUNK):
            part = slice(start, start + CHUNK)
            (x, y), r = self.centres[part].T, self.radii[part]
            across = np.exp(-0.5 * ((X - x[:, None]) / r[:, None]) ** 2)
            down = np.exp(-0.5 * ((Y - y[:, None]) / r[:, None]) ** 2) * self.heights[part, None]
            out += down.T @ across
        return out


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
