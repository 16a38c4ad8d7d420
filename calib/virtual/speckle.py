"""A speckle pattern in closed form: a sum of smooth spots on the undeformed face.

The brightness at any material point is exact, so that rendering interpolates no picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.response import Array

REACH = 2.6
"""radii beyond which a spot is left out: 1.2e-3 of its paint"""


@dataclass(frozen=True)
class SpeckleSettings:
    """How speckles look. Raises ValueError when a number is impossible."""

    diameter: float = 0.06
    """of a spot where its paint is half as thick as in its middle, mm: 0.74 of where it is half as
    dark"""
    spacing: float = 0.085
    """between neighbouring spots, mm"""
    jitter: float = 0.35
    """largest displacement of a spot from a regular grid, shares of the spacing"""
    bright: float = 0.62
    """share of full scale of the ground"""
    dark: float = 0.12
    """of the middle of overlapping spots"""

    def __post_init__(self) -> None:
        if not (self.diameter > 0 and self.spacing > 0 and 0 <= self.jitter <= 1):
            raise ValueError(
                f"diameter, spacing, jitter: expected above 0, above 0 and 0 to 1, "
                f"found {self.diameter}, {self.spacing}, {self.jitter}"
            )
        if not 0 <= self.dark < self.bright <= 1:
            raise ValueError(
                f"dark, bright: expected 0 <= dark < bright <= 1, found {self.dark}, {self.bright}"
            )


class Speckle(NamedTuple):
    """Spots, sorted into the cells of a regular grid as wide as their reach."""

    centre: Array
    """(n_spot, 2) mm"""
    radius: Array
    """(n_spot,) mm, of exp(-d^2 / radius^2)"""
    first: npt.NDArray[np.int64]
    """(n_x n_y + 1,) first spot of each cell, counted along y first"""
    origin: Array
    """(2,) mm, corner of the cells"""
    cell: float
    """mm"""
    shape: tuple[int, int]
    bright: float
    dark: float


def make_speckle(
    low: tuple[float, float],
    high: tuple[float, float],
    settings: SpeckleSettings,
    rng: np.random.Generator,
) -> Speckle:
    """Spots over the rectangle from `low` to `high`, mm, and a little beyond it."""
    beyond = 2.0 * settings.spacing
    axes = [
        np.arange(a - beyond, b + beyond, settings.spacing) for a, b in zip(low, high, strict=True)
    ]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    grid = grid + settings.jitter * settings.spacing * rng.uniform(-1.0, 1.0, grid.shape)
    half = 0.5 * settings.diameter * rng.uniform(0.8, 1.2, len(grid))
    radius = half / np.sqrt(np.log(2.0))
    cell = REACH * float(radius.max())
    origin = grid.min(axis=0) - 1e-9
    place = np.floor((grid - origin) / cell).astype(np.int64)
    shape = tuple(int(n) for n in place.max(axis=0) + 1)
    number = place[:, 0] * shape[1] + place[:, 1]
    order = np.argsort(number, kind="stable")
    first = np.searchsorted(number[order], np.arange(shape[0] * shape[1] + 1)).astype(np.int64)
    return Speckle(
        grid[order], radius[order], first, origin, cell, (shape[0], shape[1]),
        settings.bright, settings.dark,
    )  # fmt: skip


@kernel(fastmath=False)
def brightness(
    x: float, y: float, centre: Array, radius: Array, first: npt.NDArray[np.int64], origin: Array,
    cell: float,
    shape: tuple[int, int], bright: float, dark: float,
) -> float:  # fmt: skip
    """Share of full scale at one material point, mm: spots darken as layers of paint do."""
    i = int(np.floor((x - origin[0]) / cell))
    j = int(np.floor((y - origin[1]) / cell))
    paint = 0.0
    for a in range(max(i - 1, 0), min(i + 2, shape[0])):
        for b in range(max(j - 1, 0), min(j + 2, shape[1])):
            number = a * shape[1] + b
            for k in range(first[number], first[number + 1]):
                dx, dy = x - centre[k, 0], y - centre[k, 1]
                squared = (dx * dx + dy * dy) / (radius[k] * radius[k])
                if squared < REACH * REACH:
                    paint += np.exp(-squared)
    value: float = dark + (bright - dark) * np.exp(-2.0 * paint)
    return value
