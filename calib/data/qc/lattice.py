"""The points of one sample as rows and columns, the same in all frames.

DIC programs evaluate on a regular lattice of the reference image, but leave points out, and not
the same ones in every frame. On the lattice neighbours are next to each other in an array.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from calib.data.readers import PointFrame
from calib.data.readers.frames import BoolArray
from fe.response import Array, IntArray

LARGEST_SPAN = 4000
"""rows or columns; more means that the points are no lattice"""
SPARSEST = 100
"""places of the lattice for each point; more means that a point lies astray"""
OFF_LATTICE = 0.3
"""of a spacing that a point may lie beside its place, root mean square"""


class Lattice(NamedTuple):
    """Positions and displacements in rows (up) and columns (right), NaN where there is no point."""

    position: Array
    """(n_row, n_column, 3) reference position, mm"""
    displacement: Array
    """(n_frame, n_row, n_column, 3) mm; NaN where the point was not measured in that frame"""
    origin: Array
    """(2,) x, y of row 0, column 0, mm"""
    steps: Array
    """(2, 2) mm along x, y for one column (first row) and one row (second)"""

    @property
    def spacing(self) -> float:
        """Mean distance of neighbours, mm."""
        return float(np.sqrt(np.abs(np.linalg.det(self.steps))))

    def coordinates(self, points: Array) -> Array:
        """(n, 2) column and row, not whole, of points (n, 2) x, y in mm."""
        return _places(points, self.origin, self.steps)

    def present(self) -> BoolArray:
        """(n_row, n_column) places that have a point."""
        found: BoolArray = np.isfinite(self.position[..., 0])
        return found


def _places(points: Array, origin: Array, steps: Array) -> Array:
    """(n, 2) column and row of points (n, 2) in mm."""
    return np.asarray(np.linalg.solve(steps.T, (points - origin).T).T, dtype=np.float64)


def lattice_of(
    frames: Sequence[PointFrame], axes: Array, keep: Callable[[Array], BoolArray] | None = None
) -> Lattice:
    """Order the points of frames by rows and columns, in our axes (`axes` as in `Axes.matrix`).

    `keep` says which points (n, 2) x, y [mm] are the sample's. Only points that were measured in a
    frame after the first are taken: in the reference frame nothing has moved, and what is no sample
    looks as if it were.
    Raises ValueError when there are too few points or they lie on no lattice.
    """
    position = [frame.position @ axes.T for frame in frames]
    moved = [np.where(f.valid[:, None], f.displacement @ axes.T, np.nan) for f in frames]
    valid = [_wanted(f.valid, place, keep) for f, place in zip(frames, position, strict=True)]
    later = range(1, len(frames)) if len(frames) > 1 else range(1)
    if _same_points(frames):
        seen = np.any([valid[k] for k in later], axis=0)
        cloud = position[0][seen & np.isfinite(position[0]).all(axis=1)]
        fullest = cloud
    else:
        cloud = np.concatenate([position[k][valid[k]] for k in later])
        fullest = max((position[k][valid[k]] for k in later), key=len)
    if len(cloud) < 9:
        raise ValueError(
            f"expected 9 or more points within [mask] with a displacement, found {len(cloud)}"
        )
    if len(fullest) < 9:
        raise ValueError(f"expected a frame with 9 or more points, found {len(fullest)}")
    # rounding puts a point of two frames at two places next to each other: spacings are of one
    origin, steps = _fit(cloud[:, :2], _spacings(fullest[:, :2]))
    return _fill(position, moved, valid, origin, steps)


def _wanted(
    valid: BoolArray, position: Array, keep: Callable[[Array], BoolArray] | None
) -> BoolArray:
    finite: BoolArray = valid & np.isfinite(position).all(axis=1)
    return finite if keep is None else finite & keep(position[:, :2])


def _same_points(frames: Sequence[PointFrame]) -> bool:
    first = frames[0].position
    return all(
        frame.position.shape == first.shape
        and np.array_equal(frame.position, first, equal_nan=True)
        for frame in frames[1:]
    )


def _fit(points: Array, spacing: Array) -> tuple[Array, Array]:
    """Origin and steps of the lattice nearest to points (n, 2), grown from the middle outwards.

    `spacing` (2,) is that of neighbours along x and y, mm, to begin with.
    """
    points = np.unique(points, axis=0)
    centre = points[np.argmin(np.linalg.norm(points - np.median(points, axis=0), axis=1))]
    origin: Array = centre
    steps: Array = np.diag(spacing)
    distance = np.linalg.norm(points - centre, axis=1)
    radius, largest = 6 * float(spacing.max()), float(distance.max())
    while True:
        near = distance <= radius
        index = np.round(_places(points[near], origin, steps))
        columns = np.column_stack([np.ones(len(index)), index])
        found, *_ = np.linalg.lstsq(columns, points[near], rcond=None)
        if np.linalg.matrix_rank(columns) == 3:
            origin, steps = np.asarray(found[0]), np.asarray(found[1:])
        if radius > largest:
            break
        radius *= 2
    place = _places(points, origin, steps)
    off = float(np.sqrt(np.mean((place - np.round(place)) ** 2)))
    if off > OFF_LATTICE / 2:  # points anywhere are 0.29 beside on average
        raise ValueError(f"expected points in rows and columns, found them {off:.2g} steps beside")
    return origin, steps


def _spacings(points: Array) -> Array:
    """(2,) usual distance to the next point along x and y, mm."""
    found_distance, found_index = KDTree(points).query(points, k=min(9, len(points)))
    distance, index = np.asarray(found_distance), np.asarray(found_index)
    apart = np.abs(points[index[:, 1:]] - points[:, None])
    found = np.full(2, float(np.median(distance[:, 1])))
    for axis in (0, 1):
        along = apart[..., 1 - axis] < 0.3 * apart[..., axis]
        steps = np.where(along, apart[..., axis], np.inf).min(axis=1)
        if np.isfinite(steps).any():
            found[axis] = np.median(steps[np.isfinite(steps)])
    if not np.all(found > 0):
        raise ValueError("expected points at different places, found them on top of each other")
    return found


def _fill(
    position: list[Array], moved: list[Array], valid: list[BoolArray], origin: Array, steps: Array
) -> Lattice:
    wanted = [np.flatnonzero(mask) for mask in valid]
    later = slice(1, None) if len(valid) > 1 else slice(None)
    index: list[IntArray] = [
        np.round(_places(place[rows, :2], origin, steps)).astype(np.int64)
        for rows, place in zip(wanted, position, strict=True)
    ]
    every = np.concatenate(index[later])
    low, high = np.min(every, axis=0), np.max(every, axis=0)
    shape = (high - low + 1)[::-1]
    if shape.max() > LARGEST_SPAN:
        raise ValueError(f"expected at most {LARGEST_SPAN} rows and columns, found {shape.max()}")
    points = max(rows.size for rows in wanted)
    if shape.prod() > SPARSEST * points:
        raise ValueError(
            f"expected points side by side, found {points} in {shape[0]} rows and {shape[1]} "
            f"columns {np.abs(steps[0]).max():.3g} mm apart: some lie far from the others"
        )
    displacement = np.full((len(valid), *shape, 3), np.nan)
    at_rest = np.full((*shape, 3), np.nan)
    for frame in range(len(valid) - 1, -1, -1):
        at = index[frame] - low
        inside = np.all((at >= 0) & (at <= high - low), axis=1)
        rows, row, column = wanted[frame][inside], at[inside, 1], at[inside, 0]
        displacement[frame, row, column] = moved[frame][rows]
        at_rest[row, column] = position[frame][rows]
    if len(valid) > 1:
        seen = np.isfinite(displacement[1:, ..., 0]).any(axis=0)
        at_rest[~seen] = np.nan
        displacement[0, ~seen] = np.nan
    return Lattice(at_rest, displacement, origin + low @ steps, steps)
