"""Covariance of a rig whose relative pose was found again from matched points.

The intrinsics are as uncertain as the calibration says, and the pose follows them: each of their
errors is fitted away as far as epipolar lines show it. What these leave open of the pose is held to
that of the calibration (`calib.dic.pose_check`), and as uncertain as that hold is loose.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from calib.dic.bundle_residual import N_INTRINSIC, N_POSE, intrinsics_at
from calib.dic.camera import Camera, StereoRig, epipolar_distance
from calib.dic.distortion import Array
from calib.dic.pose_check import HELD_RAD, NOISE_PX, moved_rig

N_INNER = 2 * N_INTRINSIC
N_MOVED = 5
STEP_RAD = 1e-6
"""of central differences"""


def covariance_of_found(
    rig: StereoRig, covariance: Array, left: Array, right: Array, clump: float
) -> Array:
    """(26, 26) covariance of the parameters of `rig`, whose pose `refine_pose` found.

    `covariance` (26, 26) is that of the calibration, in the order of `Calibration.covariance`;
    `left` and `right` (n, 2) px are the matched points, NaN left out, of which each `clump` share
    one error (1: none do). The length of the baseline is the calibration's.
    """
    good = np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)
    left, right = left[good], right[good]
    turn, shift = rig.relative
    own = StereoRig(Camera(rig.left.intrinsics), Camera(rig.right.intrinsics, turn, shift))

    def distance(moved: StereoRig) -> Array:
        return epipolar_distance(moved, left, right)

    by_pose = _slopes(lambda x: distance(moved_rig(own, x)), np.full(N_MOVED, STEP_RAD))
    inner = covariance[:N_INNER, :N_INNER]
    by_inner = _slopes(lambda x: distance(_with_inner(own, x)), np.sqrt(np.diag(inner)))
    # what `refine_pose` minimises; its solution for errors of the matches, and of the intrinsics
    held = np.eye(N_MOVED) / HELD_RAD**2
    inverse = np.linalg.inv(by_pose.T @ by_pose / NOISE_PX**2 + held)
    noise = float(np.sum(distance(own) ** 2)) / max(len(left) - N_MOVED, 1)
    matches = clump * noise / NOISE_PX**4 * by_pose.T @ by_pose
    follows = -inverse @ (by_pose.T @ by_inner) / NOISE_PX**2
    to_pose = _slopes(lambda x: _pose(moved_rig(own, x)), np.full(N_MOVED, STEP_RAD))
    along = np.concatenate([np.zeros(3), shift / np.linalg.norm(shift)])
    length = along @ covariance[N_INNER:, N_INNER:] @ along
    shared = covariance[:N_INNER, N_INNER:] @ along  # by intrinsics and baseline
    whole = np.empty((N_INNER + N_POSE, N_INNER + N_POSE))
    whole[:N_INNER, :N_INNER] = inner
    whole[N_INNER:, :N_INNER] = to_pose @ follows @ inner + np.outer(along, shared)
    whole[:N_INNER, N_INNER:] = whole[N_INNER:, :N_INNER].T
    fitted = inverse @ (matches + held) @ inverse + follows @ inner @ follows.T
    both = np.outer(to_pose @ follows @ shared, along)
    baseline = length * np.outer(along, along) + both + both.T
    whole[N_INNER:, N_INNER:] = to_pose @ fitted @ to_pose.T + baseline
    return whole


def _slopes(values: Callable[[Array], Array], steps: Array) -> Array:
    """(n, k) derivatives at 0 by central differences; 0 where a step is."""
    columns = []
    for step in np.diag(steps):
        size = float(step.sum())
        changed = values(step) - values(-step)
        columns.append(changed / (2.0 * size) if size > 0.0 else np.zeros_like(changed))
    return np.array(columns).T


def _pose(rig: StereoRig) -> Array:
    """(6,) rotation vector and translation [mm] of the right camera in the left one's frame."""
    turn, shift = rig.relative
    return np.concatenate([Rotation.from_matrix(turn).as_rotvec(), shift])


def _with_inner(rig: StereoRig, change: Array) -> StereoRig:
    """The rig with its intrinsics changed by (20,), in the order of `pack`."""
    cameras = []
    for camera, by in zip((rig.left, rig.right), np.split(change, 2), strict=True):
        inner = camera.intrinsics
        five = [inner.fx, inner.fy, inner.cx, inner.cy, inner.skew]
        changed = np.array([*five, *inner.distortion.coefficients]) + by
        cameras.append(Camera(intrinsics_at(changed), camera.rotation, camera.translation))
    return StereoRig(*cameras)
