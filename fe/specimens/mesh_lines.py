"""Lines of a mesh along one axis: from densities, or closer to each other towards an end."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

N_DENSITY = 4001
"""places at which densities of mesh lines are tabulated"""
MIDDLE = 0.2, 0.8
"""shares of the lines on either side of a place between which the middle line is pinned there"""
SLIVER = 1e-3
"""of the length: nearer to an end than this no line is pinned"""


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


class Pinned(NamedTuple):
    """A mesh line that is to be at a certain place."""

    line: int
    at: float
    """mm"""


def line_for(x: Array, density: Array, n: int, at: float) -> int | None:
    """Which of n + 1 lines to pin at the place `at`, mm; None for an end or beside the lines.

    The middle line, of an even number the one before the middle, for all places that are not far
    from the middle in numbers of lines, else the nearest: all elements on one side of the middle
    line would lie within a sliver.  The choice jumps where a dimension varies, lines do not as long
    as it stays the same.
    """
    sliver = SLIVER * (x[-1] - x[0])
    if n < 2 or not x[0] + sliver < at < x[-1] - sliver:
        return None
    share = float(np.interp(at, x, _shares(density)))
    if MIDDLE[0] <= share <= MIDDLE[1]:
        return n // 2
    return min(max(round(share * n), 1), n - 1)


def lines_of_density(x: Array, density: Array, n: int, pinned: Pinned | None = None) -> Array:
    """(n + 1,) mesh lines from x[0] to x[-1], mm, spaced as the inverse of the density at x.

    One of them may be `pinned` at a place between the ends; its neighbours move with it.
    """
    share = _shares(density)
    at = np.linspace(0.0, 1.0, n + 1)
    if pinned is not None:
        wanted = float(np.interp(pinned.at, x, share))
        at = np.interp(at, [0.0, pinned.line / n, 1.0], [0.0, wanted, 1.0])
    lines = np.interp(at, share, x)
    lines[[0, -1]] = x[0], x[-1]
    return lines


def _shares(density: Array) -> Array:
    """Share of the lines before each place, from 0 to 1."""
    share = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2.0)])
    shares: Array = share / share[-1]
    return shares


def is_grid(vertices: Array) -> bool:
    """Whether vertices (n_dim, n), mm, are all that planes across the axes have in common."""
    return bool(np.prod([np.unique(x).size for x in vertices]) == vertices.shape[1])
