"""Latin hypercubes that grow by doubling, their points spread by maximin exchange."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

FIRST_SIZE = 8
"""points of the first hypercube; each next one has twice as many and holds it"""
N_EXCHANGES = 400
"""exchanges tried for each hypercube, a coordinate of two of its new points each"""
_TIE = 1e-9


def latin_hypercube(n: int, d: int, seed: int) -> Array:
    """(n, d) first points of an endless nested design in the unit box.

    Its first 8, 16, 32, ... points have one point in each of as many slices of every axis (nested
    Latin hypercubes: Qian 2009, Biometrika 96, 957). Within that freedom the least distance between
    points is made large by exchanging coordinates (maximin: Johnson, Moore & Ylvisaker 1990,
    J. Stat. Plan. Infer. 26, 131; Morris & Mitchell 1995, ibid. 43, 381), and the points of each
    doubling come in the order that fills the largest holes first.
    """
    rng = np.random.default_rng(seed)
    points = np.zeros((0, d))
    while len(points) < n:
        size = max(2 * len(points), FIRST_SIZE)
        new = _exchanged(_in_free_slices(points, size, rng), points, rng)
        points = np.vstack([points, new[farthest_order(new, points)]])
    return points[:n]


def farthest_order(points: Array, given: Array) -> npt.NDArray[np.int64]:
    """Order of points (n, d) in which each is the farthest from those before and `given` (m, d).

    The first of equally far ones is taken; without given points, the first point starts.
    """
    left = np.full(len(points), np.inf)
    for other in given:
        left = np.minimum(left, np.sum((points - other) ** 2, axis=1))
    order = np.empty(len(points), dtype=np.int64)
    for position in range(len(points)):
        order[position] = int(np.argmax(left > left.max() - _TIE))
        chosen = points[order[position]]
        left = np.minimum(left, np.sum((points - chosen) ** 2, axis=1))
        left[order[position]] = -np.inf
    return order


def _in_free_slices(points: Array, size: int, rng: np.random.Generator) -> Array:
    """As many new points as are missing, one in each slice (of `size`) without a point."""
    n_new, d = size - len(points), points.shape[1]
    new = np.empty((n_new, d))
    for axis in range(d):
        taken = np.floor(points[:, axis] * size).astype(np.int64)
        free = np.setdiff1d(np.arange(size), taken)
        new[:, axis] = (rng.permutation(free) + rng.random(n_new)) / size
    return new


def _exchanged(new: Array, points: Array, rng: np.random.Generator) -> Array:
    """Exchange one coordinate of two new points wherever their holes become more even."""
    both, n_new = np.vstack([new, points]), len(new)
    terms = _crowding(both, np.arange(n_new))
    score = float(np.sum(terms))
    for _ in range(N_EXCHANGES):
        pair = rng.choice(n_new, 2, replace=False)
        axis = int(rng.integers(new.shape[1]))
        both[pair, axis] = both[pair[::-1], axis]
        before = terms[pair].copy()
        _set(terms, pair, _crowding(both, pair))
        if (crowding := float(np.sum(terms))) < score:
            score = crowding
        else:
            both[pair, axis] = both[pair[::-1], axis]
            _set(terms, pair, before)
    return both[:n_new]


def _crowding(both: Array, rows: npt.NDArray[np.int64]) -> Array:
    """(k, n) terms of Morris and Mitchell's criterion with power 10 of some rows with all (n, d).

    Large where two points are close; none of a point with itself.
    """
    squared = np.sum((both[rows, None] - both) ** 2, axis=2)
    squared[np.arange(len(rows)), rows] = np.inf
    terms: Array = np.maximum(squared, 1e-12) ** -5.0
    return terms


def _set(terms: Array, pair: npt.NDArray[np.int64], found: Array) -> None:
    """Put terms (2, n) of two new points with all into those of all new points with all."""
    terms[pair] = found
    terms[:, pair] = found[:, : len(terms)].T
