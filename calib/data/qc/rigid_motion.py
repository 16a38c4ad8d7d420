"""Rigid motion that is no deformation: of the base plate, the camera, or the calibration."""

from __future__ import annotations

import numpy as np

from calib.data.qc.experiment_file import RigidBody
from fe.response import Array

BASE_BAND = 0.3
"""mm above the base that move with it where it sticks"""
SIGNS = np.array([-1.0, 1.0, 1.0])
"""of u_x, u_y, u_z in the mirror plane through the pin"""


def without_rigid_motion(
    right: Array, left: Array, points: Array, how: RigidBody
) -> tuple[Array, Array, Array]:
    """Fields of both halves without rigid motion, and the motion (n_frame, 3) that was taken off.

    right and left (n_frame, n, 3) are in mm at points (n, 2) [mm] and their mirror images (-x, y).
    "symmetry": a shift along x and turns about z and y are what breaks the mirror symmetry of a
    block under a pin. "base": the same three for the points next to a base that sticks, and the
    shifts along y and z with them. The motion is (shift along x [mm], turn about z, turn about y
    [rad]).
    """
    motion = np.zeros((len(right), 3))
    if how == "none":
        return right, left, motion
    x, y = points.T
    shifts = np.zeros((len(right), 3))
    for frame in range(len(right)):
        if how == "symmetry":
            motion[frame] = _by_symmetry(right[frame], left[frame], x, y)
            shifts[frame, 0] = motion[frame, 0]
        else:
            shifts[frame], turns = _by_base(right[frame], left[frame], x, y)
            motion[frame] = shifts[frame, 0], *turns
    sides = []
    for field, along in ((right, x), (left, -x)):
        rigid = np.repeat(shifts[:, None], len(points), axis=1)
        rigid[..., 0] -= motion[:, 1:2] * y
        rigid[..., 1] += motion[:, 1:2] * along
        rigid[..., 2] -= motion[:, 2:3] * along
        sides.append(field - rigid)
    return sides[0], sides[1], motion


def _by_symmetry(right: Array, left: Array, x: Array, y: Array) -> Array:
    """(3,) shift and turns by least squares from the parts of the wrong parity."""
    known = np.isfinite(right[:, 0]) & np.isfinite(left[:, 0])
    n = np.count_nonzero(known)
    if n < 3:
        return np.zeros(3)
    wrong = 0.5 * (right[known] - SIGNS * left[known])
    one, none = np.ones(n), np.zeros(n)
    columns = np.concatenate(
        [
            np.column_stack([one, -y[known], none]),
            np.column_stack([none, x[known], none]),
            np.column_stack([none, none, -x[known]]),
        ]
    )
    found: Array = np.linalg.lstsq(columns, wrong.T.ravel(), rcond=None)[0]
    return found


def _by_base(right: Array, left: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Shifts (3,) and turns (2,) about z and y of the points next to the base."""
    field = np.concatenate([right, left])
    along, height = np.concatenate([x, -x]), np.concatenate([y, y])
    known = np.isfinite(field[:, 0]) & (height <= BASE_BAND)
    n = np.count_nonzero(known)
    if n < 3:
        return np.zeros(3), np.zeros(2)
    one, none = np.ones(n), np.zeros(n)
    columns = np.concatenate(
        [
            np.column_stack([one, none, none, -height[known], none]),
            np.column_stack([none, one, none, along[known], none]),
            np.column_stack([none, none, one, none, -along[known]]),
        ]
    )
    found = np.linalg.lstsq(columns, field[known].T.ravel(), rcond=None)[0]
    return found[:3], found[3:]


def folded(right: Array, left: Array) -> Array:
    """(n_frame, n, 3) mean of one half and the mirror image of the other; NaN where one lacks."""
    half: Array = 0.5 * (right + SIGNS * left)
    return half
