"""What the uncertainty of a calibration does to lengths: one common factor.

Its other parts (a bent or sheared space) are smaller in a view of a few mm by the share that the
view has of the distance; the factor is the same in all frames and cannot be seen in any.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from calib.dic.bundle_residual import N_INTRINSIC, Guess, intrinsics_at, pack, pose_at
from calib.dic.camera import Camera, StereoRig
from calib.dic.distortion import Array
from calib.dic.triangulate import triangulate

LEAST_POINTS = 3


def scale_sd(rig: StereoRig, covariance: Array, left: Array, right: Array) -> float:
    """Relative SD of all lengths between points at pixels (n, 2) of both cameras.

    `covariance` (26, 26): of the rig's parameters, intrinsics of both cameras and relative pose, in
    the order of `Calibration.covariance`. To first order: each principal direction of it changes
    the rig by one SD, and with it the RMS distance of the points from their middle. NaN pixels are
    left out. Raises ValueError with fewer than three points.
    """
    good = np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)
    if np.count_nonzero(good) < LEAST_POINTS:
        raise ValueError(
            f"left, right: found {np.count_nonzero(good)} points in both cameras, expected "
            f"{LEAST_POINTS} or more"
        )
    turn, shift = rig.relative
    own = StereoRig(Camera(rig.left.intrinsics), Camera(rig.right.intrinsics, turn, shift))
    values = pack(Guess(own, ()))
    # in units of each parameter's SD, or the large ones drown the small ones
    unit = np.sqrt(np.diag(covariance))
    unit = np.where(unit > 0.0, unit, 1.0)
    sizes, directions = np.linalg.eigh(covariance / np.outer(unit, unit))
    variance = 0.0
    for size, direction in zip(sizes, directions.T, strict=True):
        if size <= 0.0:
            continue
        step = np.sqrt(size) * unit * direction
        up, down = (_extent(values + by * step, left[good], right[good]) for by in (0.5, -0.5))
        variance += float(np.log(up / down)) ** 2
    return float(np.sqrt(variance))


def _extent(values: Array, left: Array, right: Array) -> float:
    """RMS distance of the points from their middle as the rig of these parameters places them."""
    turn, shift = pose_at(values, 0)
    rig = StereoRig(
        Camera(intrinsics_at(values[:N_INTRINSIC])),
        Camera(
            intrinsics_at(values[N_INTRINSIC : 2 * N_INTRINSIC]),
            Rotation.from_rotvec(turn).as_matrix(),
            shift.copy(),
        ),
    )
    points = triangulate(rig, left, right).points
    off = points - np.nanmean(points, axis=0)
    return float(np.sqrt(np.nanmean(np.sum(off**2, axis=1))))
