"""Where a sample stands: its plane, its base, its middle, and the pin, found from the DIC points.

Our frame has its origin at the bottom of the front face below the pin, x along the width, y up and
z out of the face. Thesis, section 4.3: the pin is where the displacement is largest, the base is
the first row of zeros, the angle is that of the face seen from above.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from calib.data.qc.lattice import Lattice
from fe.response import Array

WINDOW = 3.0
"""mm on each side of the pin over which the field is held against its mirror image"""
LARGEST_SHIFT = 1.5
"""mm around the largest displacement in which the pin is looked for"""
LARGEST_EDGE = 0.5
"""mm that points may end before the edge of a sample"""
MOST_POINTS = 3000
"""of the fit of a plane"""


class Placement(NamedTuple):
    """Where a sample stands in the axes of the DIC files (turned to x right, y up)."""

    rotation: Array
    """(3, 3) rows are the axes of our frame: ours = rotation @ (theirs - origin)"""
    origin: Array
    """(3,) place of our origin, mm"""
    angle_deg: float
    """angle of the face about the height, seen from above: atan dz/dx"""
    tilt_deg: float
    """angle of the face about its width: atan dz/dy"""
    roll_deg: float
    """angle of the base in the plane of the face"""
    x_shift: float
    """mm from the sample's middle to the pin, along x"""
    width: float
    """mm between the outermost points seen"""
    plane_rms: float
    """mm, points about the fitted plane"""

    def points(self, places: Array) -> Array:
        """(n, 2) x, y in the DIC file's axes of places (n, 2) on the face in our frame, mm."""
        flat = np.column_stack([places, np.zeros(len(places))])
        found: Array = (flat @ self.rotation + self.origin)[:, :2]
        return found


def place(
    lattice: Lattice,
    frames: list[int],
    width: float,
    edge: float | None = None,
    base: float | None = None,
) -> Placement:
    """Placement of a sample of `width` [mm]; `frames` are those with load, the deepest last.

    Points end half a subset before the edge. How far, in mm, is `edge`, or what the points seen
    lack of the width on each side. `base` is the height of the base in the file's axes [mm] where
    it is known.
    Raises ValueError when the points do not show a face and a pin.
    """
    present = lattice.present()
    cloud = lattice.position[present]
    slope_x, slope_y, rms = _plane(cloud)
    upright = _axes(slope_x, slope_y, 0.0)
    low = _lowest(lattice.position @ upright.T)
    roll = float(np.arctan(np.polyfit(low[:, 0], low[:, 1], 1)[0]))
    rotation = _axes(slope_x, slope_y, roll)
    turned = lattice.position @ rotation.T
    left, right = _sides(turned, lattice.spacing)
    if edge is None:
        edge = float(np.clip(0.5 * (width - (right - left)), 0.0, LARGEST_EDGE))
    bottom = float(np.median(_lowest(turned)[:, 1])) - edge
    pin = _pin(lattice, turned, rotation, frames)
    z = float(np.median(turned[present][:, 2]))
    origin = rotation.T @ np.array([pin, bottom, z])
    if base is not None:
        below = (base - origin[1]) / rotation[1, 1]
        origin = origin + below * rotation[1]
    return Placement(
        rotation=rotation,
        origin=origin,
        angle_deg=float(np.degrees(np.arctan(slope_x))),
        tilt_deg=float(np.degrees(np.arctan(slope_y))),
        roll_deg=float(np.degrees(roll)),
        x_shift=pin - 0.5 * (left + right),
        width=right - left,
        plane_rms=rms,
    )


def _plane(cloud: Array) -> tuple[float, float, float]:
    """Slopes dz/dx, dz/dy and RMS of the plane most points lie on."""
    if len(cloud) > MOST_POINTS:
        cloud = cloud[:: len(cloud) // MOST_POINTS + 1]
    x, y, z = (cloud - np.median(cloud, axis=0)).T
    columns = np.column_stack([x, y, np.ones_like(x)])
    start = np.linalg.lstsq(columns, z, rcond=None)[0]
    scale = max(1.4826 * float(np.median(np.abs(z - columns @ start))), 1e-6)

    def misfit(p: Array) -> Array:
        off: Array = columns @ p - z
        return off

    found = least_squares(misfit, start, loss="cauchy", f_scale=scale).x
    off = z - columns @ found
    near = np.abs(off) <= 5 * 1.4826 * np.median(np.abs(off)) + 1e-9
    return float(found[0]), float(found[1]), float(off[near].std())


def _axes(slope_x: float, slope_y: float, roll: float) -> Array:
    """(3, 3) rows: along the base, up the face, out of the face z = slope_x x + slope_y y."""
    normal = np.array([-slope_x, -slope_y, 1.0]) / np.sqrt(1 + slope_x**2 + slope_y**2)
    across = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
    across /= np.linalg.norm(across)
    up = np.cross(normal, across)
    c, s = np.cos(roll), np.sin(roll)
    axes: Array = np.stack([c * across + s * up, -s * across + c * up, normal])
    return axes


def _lowest(position: Array) -> Array:
    """(n, 2) x, y of the lowest point of each column that is not much shorter than the others."""
    found = np.where(np.isfinite(position[..., 1]), position[..., 1], np.inf)
    row = found.argmin(axis=0)
    columns = np.flatnonzero(np.isfinite(found.min(axis=0)))
    low = position[row[columns], columns][:, :2]
    middle = np.median(low[:, 1])
    spread = 1.4826 * np.median(np.abs(low[:, 1] - middle))
    kept = np.abs(low[:, 1] - middle) <= max(5 * spread, 0.3)
    if np.count_nonzero(kept) < 3:
        raise ValueError("expected a lower edge of 3 or more columns of points, found none")
    edge: Array = low[kept]
    return edge


def _sides(position: Array, spacing: float) -> tuple[float, float]:
    """Outermost x of the points, mm: means over the rows, whose ends differ by a point at most."""
    x = position[..., 0]
    rows = np.isfinite(x).any(axis=1)
    ends = []
    for found in (np.nanmin(x[rows], axis=1), np.nanmax(x[rows], axis=1)):
        usual = np.abs(found - np.median(found)) <= 1.5 * spacing
        ends.append(float(found[usual].mean()))
    return ends[0], ends[1]


def _pin(lattice: Lattice, turned: Array, rotation: Array, frames: list[int]) -> float:
    """Pin's x, mm: the middle of the field's symmetry next to its largest displacement.

    The thesis takes the column of the largest mean displacement in y and z, which is known to a
    spacing at best. Around it, the x is taken about which u_y and u_z are most nearly even and u_x
    most nearly odd, but for a rigid motion.
    """
    moved = lattice.displacement[frames] @ rotation.T
    with np.errstate(invalid="ignore"):
        size = np.hypot(moved[-1, ..., 1], moved[-1, ..., 2])
    known = np.isfinite(size)
    count = known.sum(axis=0)
    enough = count >= 0.5 * np.median(count[count > 0]) if (count > 0).any() else count > 0
    if not enough.any():
        raise ValueError("expected displacements under load, found none")
    mean = np.where(known, size, 0.0).sum(axis=0) / np.maximum(count, 1)
    column_x = np.array(
        [np.nanmedian(c) if np.isfinite(c).any() else np.nan for c in turned[..., 0].T]
    )
    half_mm = max(round(0.5 / lattice.spacing), 1)
    smooth = np.convolve(np.where(enough, mean, 0.0), np.ones(2 * half_mm + 1), mode="same")
    weight = np.convolve(enough.astype(float), np.ones(2 * half_mm + 1), mode="same")
    profile = np.where(enough, smooth / np.maximum(weight, 1), -np.inf)
    first = int(np.argmax(profile))
    reach = int(np.ceil(LARGEST_SHIFT / lattice.spacing))
    candidates = np.arange(first - reach, first + reach + 0.25, 0.5)
    window = int(np.ceil(WINDOW / lattice.spacing))
    misfit = np.array([_asymmetry(moved, middle, window) for middle in candidates])
    if not np.isfinite(misfit).any():
        raise ValueError("expected points on both sides of the pin, found none")
    best = int(np.nanargmin(misfit))
    middle = candidates[best] + 0.5 * _vertex(misfit, best)
    known_x = np.isfinite(column_x)
    columns = np.arange(column_x.size)[known_x]
    slope, at_zero = np.polyfit(columns, column_x[known_x], 1)
    return float(at_zero + slope * middle)


def _asymmetry(moved: Array, middle: float, window: int) -> float:
    """Mean square difference of a field and its mirror image about a (half) column."""
    twice = round(2 * middle)
    n = moved.shape[2]
    right = np.arange(int(np.floor(middle)) + 1, min(n, int(np.ceil(middle)) + window))
    left = twice - right
    right, left = right[left >= 0], left[left >= 0]
    if right.size < window // 2:
        return float("nan")
    signs = np.array([-1.0, 1.0, 1.0])
    off = moved[:, :, right] - signs * moved[:, :, left]
    return _beside_rigid_motion(off, right - middle)


def _beside_rigid_motion(off: Array, apart: Array) -> float:
    """Mean square of differences (n_frame, n_row, n, 3) but for what a rigid motion explains.

    A shift along x changes u_x alike everywhere; turns about y and z change u_z and u_y with the
    distance `apart` (n,) from the mirror plane.
    """
    known = np.isfinite(off[..., 0])
    count = known.sum(axis=(1, 2))
    if not count.all():
        return float("nan")
    values = np.where(known[..., None], off, 0.0)
    squares = (values**2).sum(axis=(1, 2))
    shift = values[..., 0].sum(axis=(1, 2))
    arm = np.where(known, apart, 0.0)
    turns = (values[..., 1:] * arm[..., None]).sum(axis=(1, 2))
    squares[:, 0] -= shift**2 / count
    squares[:, 1:] -= turns**2 / (arm**2).sum(axis=(1, 2))[:, None]
    return float(squares.sum() / (3 * count.sum()))


def _vertex(values: Array, best: int) -> float:
    """Place of the least value of the parabola through five values around the best, in steps."""
    near = np.arange(max(best - 3, 0), min(best + 4, values.size))
    near = near[np.isfinite(values[near])]
    if near.size < 3:
        return 0.0
    square, linear, _ = np.polyfit(near - best, values[near], 2)
    return float(np.clip(-linear / (2 * square), -1.0, 1.0)) if square > 0 else 0.0
