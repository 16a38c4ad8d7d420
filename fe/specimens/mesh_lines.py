"""Lines of a mesh along one axis: from densities, or closer to each other towards an end."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

N_DENSITY = 4001
"""places at which densities of mesh lines are tabulated"""


class Dense(NamedTuple):
    """Where mesh lines stand closer: their density is 1 + `peak` at a place, 1 far from it."""

    peak: float
    spread: float
    """fraction of the length that it is measured by"""


def thinner(length: float, thinning: float, n: int) -> Array:
    """(n + 1,) lines that stand closer towards the end, mm."""
    at = np.linspace(0.0, length, n + 1)
    return np.asarray(at * (1.0 + thinning * (1.0 - at / length)))


def bump(distance: Array, dense: Dense, unit: float) -> Array:
    """Density of mesh lines above the background at a distance, mm."""
    return dense.peak * np.exp(-((distance / (dense.spread * unit)) ** 2))


def lines_of_density(x: Array, density: Array, n: int, middle: float | None = None) -> Array:
    """(n + 1,) mesh lines from x[0] to x[-1], mm, spaced as the inverse of the density at x.

    The middle line, of an even number the one before the middle, is moved to the place `middle`,
    mm, and its neighbours with it: the same line wherever that is, so that lines move smoothly.
    """
    share = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2.0)])
    share /= share[-1]
    at = np.linspace(0.0, 1.0, n + 1)
    if middle is not None and n > 1 and x[0] < middle < x[-1]:
        wanted = float(np.interp(middle, x, share))
        at = np.interp(at, [0.0, (n // 2) / n, 1.0], [0.0, wanted, 1.0])
    lines = np.interp(at, share, x)
    lines[[0, -1]] = x[0], x[-1]
    return lines


def is_grid(vertices: Array) -> bool:
    """Whether vertices (n_dim, n), mm, are all that planes across the axes have in common."""
    return bool(np.prod([np.unique(x).size for x in vertices]) == vertices.shape[1])
