"""Designs of experiments: corners and faces of a box, then Sobol points or a Latin hypercube."""

from __future__ import annotations

from numbers import Integral
from typing import Literal

import numpy as np
import numpy.typing as npt

from surrogate.latin_hypercube import latin_hypercube
from surrogate.sobol import sobol_points

Array = npt.NDArray[np.float64]
Sequence = Literal["sobol", "latin"]


def sobol_design(
    n: int, bounds: Array, seed: int, *, n_corners: int | None = None, n_faces: int = 0
) -> Array:
    """(n, d) points of the box `bounds` (d, 2): its 2^d corners first, then Sobol points.

    The corners come first because a Gaussian process errs most where it extrapolates; where there
    are many, `n_corners` takes a well-spread part of them (0: none), and `n_faces` adds as many
    centres of faces. The rest is a Sobol sequence with Owen's scrambling (Owen 1998, J. Complexity
    14, 466). Designs are nested: the first n points of a larger design with the same other
    arguments are this design.
    Raises ValueError for an n that is no whole number from 1 on, bounds that are not finite pairs
    low < high, or more corners or faces than the box has.
    """
    return _boxed(n, bounds, seed, "sobol", n_corners, n_faces)


def maximin_design(
    n: int, bounds: Array, seed: int, *, n_corners: int | None = None, n_faces: int = 0
) -> Array:
    """As `sobol_design`, with a nested maximin Latin hypercube after corners and faces.

    Of the points after corners and faces, the first 8, 16, 32, ... are Latin hypercubes.
    """
    return _boxed(n, bounds, seed, "latin", n_corners, n_faces)


def check_count(n: int) -> None:
    """Raise ValueError for a number of points that is not whole and at least 1."""
    if not (isinstance(n, Integral) and not isinstance(n, bool) and n >= 1):
        raise ValueError(f"n: must be a whole number of at least 1, got {n!r}")


def _boxed(
    n: int, bounds: Array, seed: int, sequence: Sequence, n_corners: int | None, n_faces: int
) -> Array:
    bounds = np.asarray(bounds, dtype=np.float64)
    check_count(n)
    if bounds.ndim != 2 or bounds.shape[1] != 2 or not len(bounds):
        raise ValueError(f"bounds: must be (d, 2) pairs low, high, got shape {bounds.shape}")
    if not np.isfinite(bounds).all() or not (bounds[:, 0] < bounds[:, 1]).all():
        raise ValueError(f"bounds: must be finite with low < high, got {bounds.tolist()}")
    low, high = bounds.T
    first = np.vstack([_corners(bounds, n_corners, n), _face_centres(bounds, n_faces)])[:n]
    n_inside = n - len(first)
    if n_inside == 0:
        return first
    return np.vstack([first, low + (high - low) * _inside(n_inside, len(bounds), seed, sequence)])


def unit_design(
    n: int,
    d: int,
    seed: int,
    *,
    sequence: Sequence = "sobol",
    n_corners: int | None = None,
    n_faces: int = 0,
) -> Array:
    """(n, d) points of the unit box: `sobol_design` or `maximin_design` by name of sequence.

    Raises ValueError for an unknown sequence and as these do.
    """
    if sequence not in ("sobol", "latin"):
        raise ValueError(f"sequence: expected 'sobol' or 'latin', found {sequence!r}")
    box = np.tile([0.0, 1.0], (d, 1))
    return _boxed(n, box, seed, sequence, n_corners, n_faces)


def _inside(n: int, d: int, seed: int, sequence: Sequence) -> Array:
    if sequence == "latin":
        return latin_hypercube(n, d, seed)
    # A whole power of two, cut: the same sequence without a warning about its balance.
    return sobol_points(d, int(n - 1).bit_length(), seed)[:n]


def _corners(bounds: Array, n_corners: int | None, n: int) -> Array:
    """The first n corners in the order of counting, or of the given number far from each other."""
    d = len(bounds)
    if n_corners is None:
        places = np.arange(min(n, 2**d))
    elif 0 <= n_corners <= 2**d:
        places = _far_corners(d, min(n, n_corners))
    else:
        raise ValueError(f"n_corners: expected 0 to {2**d}, found {n_corners}")
    is_high = places[:, None] >> np.arange(d - 1, -1, -1) & 1
    corners: Array = bounds[np.arange(d), is_high]
    return corners


def _far_corners(d: int, n: int) -> npt.NDArray[np.int64]:
    """Places, in the order of counting, of n corners, each the farthest from those before.

    The first of equally far ones is taken, and the first of all starts.
    """
    chosen = np.zeros(n, dtype=np.int64)
    if n < 2:
        return chosen  # no table of all corners, of which a box of many inputs has too many
    n_high = np.zeros(1, dtype=np.int8)
    for _ in range(d):
        n_high = np.concatenate([n_high, n_high + np.int8(1)])
    corner, left = np.arange(2**d), n_high  # squared distances: inputs in which corners differ
    for position in range(1, n):
        chosen[position] = np.argmax(left)
        left = np.minimum(left, n_high[corner ^ chosen[position]])
    return chosen


def _face_centres(bounds: Array, n_faces: int) -> Array:
    """The first centres of faces, in the order low, high of each axis."""
    d = len(bounds)
    if not 0 <= n_faces <= 2 * d:
        raise ValueError(f"n_faces: expected 0 to {2 * d}, found {n_faces}")
    centres = np.tile(bounds.mean(axis=1), (2 * d, 1))
    centres[np.arange(2 * d), np.arange(2 * d) // 2] = bounds.ravel()
    return centres[:n_faces]
