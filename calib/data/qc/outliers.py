"""Outliers of a field by robust local statistics: the normalised median test on a lattice.

Westerweel & Scarano, Exp. Fluids 39 (2005) 1096: a value is compared with the median of its
neighbours, and the difference with the median of such differences around it. Here the neighbours
are means of opposite pairs, which a gradient leaves alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calib.data.readers.frames import BoolArray
from fe.response import Array, IntArray

PASSES = 3
"""after which what is left of outliers next to each other stays"""
_PAIRS = ((0, 1), (1, 0), (1, 1), (1, -1))
_WAYS = (*_PAIRS, *((-down, -right) for down, right in _PAIRS))


class Cleaned(NamedTuple):
    """A field without its outliers."""

    displacement: Array
    """(..., n_row, n_column, 3) mm; outliers replaced by the median of their neighbours' means"""
    is_outlier: BoolArray
    """(..., n_row, n_column)"""
    threshold: float
    """in local median deviations"""
    median_deviation: float
    """mm, usual local median deviation"""


def without_outliers(displacement: Array, threshold: float, floor: float) -> Cleaned:
    """Replace values off their neighbours by more than threshold (local median deviation + floor).

    displacement (..., n_row, n_column, 3) in mm, NaN where nothing was measured; floor in mm.
    Points with no complete pair of opposite neighbours, as at an edge beside a lost one, are
    compared with straight lines through two neighbours on one side; there is no value to put in
    place of such an outlier. Points without these either are left as they are.
    """
    shape = displacement.shape
    displacement = displacement.reshape(-1, *shape[-3:])
    left, deviation = displacement, float("nan")
    for _ in range(PASSES):
        predicted = _median(_opposite_means(left))
        lone = np.nonzero(np.isfinite(left[..., 0]) & np.isnan(predicted[..., 0]))
        predicted[lone] = _median(2 * _gather(left, lone) - _gather(left, lone, 2))
        off = np.abs(left - predicted)
        around = _neighbours(off)
        usual = _median(around)
        # few neighbours, predicted by the point itself: what is usual around these
        usual[lone] = _median(_gather(usual, lone))
        # a wild value makes its neighbours look wild: only the worst of them goes at a time
        worst = np.nan_to_num(around).max(axis=(0, -1))
        with np.errstate(invalid="ignore"):
            excess = np.any(off > threshold * (usual + floor), axis=-1)
            is_wild = (excess & (off.max(axis=-1) >= worst))[..., None]
        if np.isnan(deviation):
            known = usual[np.isfinite(usual)]
            deviation = float(np.median(known)) if known.size else 0.0
        if not is_wild.any():
            break
        left = np.where(is_wild, np.nan, left)
    is_outlier = np.isnan(left[..., 0]) & np.isfinite(displacement[..., 0])
    cleaned = np.where(is_outlier[..., None], _median(_opposite_means(left)), left)
    return Cleaned(cleaned.reshape(shape), is_outlier.reshape(shape[:-1]), threshold, deviation)


def _shifted(values: Array, down: int, right: int) -> Array:
    """Values of the neighbour `down` rows and `right` columns on; NaN beyond the edge."""
    padded = np.pad(
        values, [(0, 0)] * (values.ndim - 3) + [(1, 1), (1, 1), (0, 0)], constant_values=np.nan
    )
    rows, columns = values.shape[-3], values.shape[-2]
    return padded[..., 1 + down : 1 + down + rows, 1 + right : 1 + right + columns, :]


def _opposite_means(values: Array) -> Array:
    return np.stack([0.5 * (_shifted(values, *p) + _shifted(values, -p[0], -p[1])) for p in _PAIRS])


def _gather(values: Array, at: tuple[IntArray, ...], times: int = 1) -> Array:
    """(8, n, 3) values `times` steps to each way from places (frame, row, column); NaN outside."""
    padded = np.pad(values, [(0, 0), (2, 2), (2, 2), (0, 0)], constant_values=np.nan)
    frame, row, column = at
    ways = [(2 + times * down, 2 + times * right) for down, right in _WAYS]
    return np.stack([padded[frame, row + down, column + right] for down, right in ways])


def _neighbours(values: Array) -> Array:
    return np.stack([_shifted(values, *way) for way in _WAYS])


def _median(values: Array) -> Array:
    """Median over the first axis without NaN; NaN where there is nothing."""
    ordered = np.sort(values, axis=0)
    count = np.count_nonzero(np.isfinite(values), axis=0)
    low = np.take_along_axis(ordered, np.maximum(count - 1, 0)[None] // 2, axis=0)[0]
    high = np.take_along_axis(ordered, count[None] // 2 % len(values), axis=0)[0]
    middle: Array = np.where(count % 2 == 1, low, 0.5 * (low + high))
    return np.where(count > 0, middle, np.nan)
