"""From the lattice of a sample to given points: linear, cubic, or the nearest DIC point itself.

Thesis, section 4.4.2: a point is interpolated linearly between its four neighbours, three of which
suffice; with two missing it is not used.
"""

from __future__ import annotations

import numpy as np

from calib.data.qc.experiment_file import Mapping
from calib.data.readers.frames import BoolArray
from fe.response import Array, IntArray

ENOUGH = 9
"""of 25 points, for the six coefficients of a parabola"""
CLOSE, WIDE = 1.2, 4.0
"""spacings over which a fitted parabola looks: as close as it can, and twice as far"""
RIDGE = 1e-12
"""for points all in two lines, which tell no parabola across them"""


def map_field(values: Array, at: Array, method: Mapping) -> Array:
    """(n_frame, n, 3) values at lattice coordinates `at` (n, 2) [column, row]; NaN where none.

    values (n_frame, n_row, n_column, 3) with NaN where nothing was measured. "linear": between
    four neighbours; "cubic": cubic convolution (Keys 1981) over 4 x 4, linear where one of them is
    missing; "shape": the nearest point, carried over the rest of the way (half a spacing at most)
    by the parabola through it and its eight neighbours; where one of them is missing, by the one
    that fits those known of 25, as a line would be off by the field's curvature, on the same side
    in all samples. An FE field is then evaluated there by its shape functions.
    """
    linear = _linear(values, at)
    if method == "linear":
        return linear
    if method == "cubic":
        other = _cubic(values, at)
    else:
        other = _nearest(values, at)
        missing = np.isnan(other[..., 0]) & np.isfinite(linear[..., 0])
        other = np.where(missing[..., None], _fitted(values, at, missing, CLOSE), other)
    return np.where(np.isnan(other), linear, other)


def map_coarsely(values: Array, at: Array) -> Array:
    """As `map_field` by parabolas over twice the distance: what a lattice half as fine would tell.

    The difference of the two is the error of the finer one where the field has an edge, and several
    times as much where it is smooth.
    """
    every: BoolArray = np.ones((len(values), len(at)), dtype=np.bool_)
    return _fitted(values, at, every, WIDE)


def _gather(values: Array, column: IntArray, row: IntArray) -> Array:
    """(n_frame, n, 3) values at whole places; NaN outside the lattice."""
    rows, columns = values.shape[1:3]
    inside: BoolArray = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    found = values[:, row.clip(0, rows - 1), column.clip(0, columns - 1)]
    return np.where(inside[:, None], found, np.nan)


def _split(at: Array, values: Array) -> tuple[IntArray, IntArray, Array, Array]:
    """Whole parts below and what is left, column first; on the last line it is that before it."""
    whole = np.floor(at).astype(np.int64)
    last = np.array(values.shape[2:0:-1]) - 1
    whole = np.where((at == last) & (last > 0), last - 1, whole)
    rest = at - whole
    return whole[:, 0], whole[:, 1], rest[:, :1], rest[:, 1:]


def _linear(values: Array, at: Array) -> Array:
    column, row, right, up = _split(at, values)
    corners = [_gather(values, column + i, row + j) for j in (0, 1) for i in (0, 1)]
    missing = [np.isnan(corner) for corner in corners]
    one = np.sum(missing, axis=0) == 1
    # of three corners: the plane through them gives the fourth
    beside = ((1, 2, 3), (0, 3, 2), (0, 3, 1), (1, 2, 0))
    filled = [
        np.where(missing[k] & one, corners[a] + corners[b] - corners[c], corners[k])
        for k, (a, b, c) in enumerate(beside)
    ]
    low = filled[0] * (1 - right) + filled[1] * right
    high = filled[2] * (1 - right) + filled[3] * right
    mapped: Array = low * (1 - up) + high * up
    return mapped


def _cubic(values: Array, at: Array) -> Array:
    column, row, right, up = _split(at, values)
    across, along = _keys(right), _keys(up)
    total = np.zeros((len(values), len(at), 3))
    for j in range(4):
        for i in range(4):
            weight = across[i] * along[j]
            total += weight * _gather(values, column + i - 1, row + j - 1)
    return total


def _keys(t: Array) -> tuple[Array, Array, Array, Array]:
    """Weights of the four points around a place t in [0, 1) between the middle two."""
    return (
        0.5 * (-t + 2 * t**2 - t**3),
        0.5 * (2 - 5 * t**2 + 3 * t**3),
        0.5 * (t + 4 * t**2 - 3 * t**3),
        0.5 * (-(t**2) + t**3),
    )


def _nearest(values: Array, at: Array) -> Array:
    nearest = np.round(at).astype(np.int64)
    column, row = nearest[:, 0], nearest[:, 1]
    rest = at - nearest
    across, along = _parabola(rest[:, :1]), _parabola(rest[:, 1:])
    total = np.zeros((len(values), len(at), 3))
    for j in range(3):
        for i in range(3):
            weight = across[i] * along[j]
            total += weight * _gather(values, column + i - 1, row + j - 1)
    return total


def _fitted(values: Array, at: Array, chosen: BoolArray, near: float) -> Array:
    """(n_frame, n, 3) parabolas fitted to the known of 25 points, where `chosen` (n_frame, n).

    Weights fall with the distance to exp(-1/2) at `near` spacings.
    """
    frame, point = np.nonzero(chosen)
    centre = np.round(at[point]).astype(np.int64)
    steps = np.arange(-2, 3)
    across, up = (c.ravel() for c in np.meshgrid(steps, steps))
    terms = _terms(across.astype(np.float64), up.astype(np.float64))
    columns, rows = centre[:, :1] + across, centre[:, 1:] + up
    n_row, n_column = values.shape[1:3]
    inside = (rows >= 0) & (rows < n_row) & (columns >= 0) & (columns < n_column)
    found = values[frame[:, None], rows.clip(0, n_row - 1), columns.clip(0, n_column - 1)]
    known = inside & np.isfinite(found[..., 0])
    weights = known * np.exp(-0.5 * (across**2 + up**2) / near**2)
    matrix = weights @ np.einsum("ka,kb->kab", terms, terms).reshape(25, 36)
    matrix = matrix.reshape(-1, 6, 6) + RIDGE * np.eye(6)
    right = np.einsum("nk,ka,nkc->nac", weights, terms, np.nan_to_num(found) * known[..., None])
    fitted = np.linalg.solve(matrix, right)
    values_there = np.einsum("na,nac->nc", _terms(*(at[point] - centre).T), fitted)
    result = np.full((*chosen.shape, 3), np.nan)
    enough = known.sum(axis=1) >= ENOUGH
    result[frame[enough], point[enough]] = values_there[enough]
    return result


def _terms(x: Array, y: Array) -> Array:
    """(n, 6) of a parabola in two directions."""
    return np.stack([np.ones_like(x), x, y, x**2, x * y, y**2], axis=1).astype(np.float64)


def _parabola(t: Array) -> tuple[Array, Array, Array]:
    """Weights of three points in a row for a place t in [-1/2, 1/2] from the middle one."""
    return 0.5 * t * (t - 1), 1 - t**2, 0.5 * t * (t + 1)
