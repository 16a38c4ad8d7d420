"""Whether two images belong to a calibration, and the pose of the cameras by the images alone.

A rig that has moved since its calibration shows in the distances of matched points from their
epipolar lines, and can be found again from them but for the length of the baseline. Source: R.
Hartley, A. Zisserman, "Multiple View Geometry", 2nd ed., 2003, section 11.4 (Sampson's error).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from calib.dic.camera import Camera, StereoRig, epipolar_distance
from calib.dic.distortion import Array
from calib.dic.triangulate import triangulate

LEAST_POINTS = 12
ROBUST_PX = 0.1
HELD_RAD = 0.01
"""SD by which a pose is held to that of the calibration: what a narrow view does not show of it
stays as it was"""
NOISE_PX = 0.02
"""of an epipolar distance, against which it is held"""
AS_USUAL = 2.0
"""times the median distance in the reference images: what images of the right cameras stay below"""
SWAPPED = 0.5
"""of the distances as given: below this the cameras are swapped"""
MOST_BEFORE = 0.9
"""share of the points that a right pose has before both cameras"""


class Refined(NamedTuple):
    """A rig whose relative pose fits matched points."""

    rig: StereoRig
    turned: float
    """degrees by which the right camera was turned"""
    rms: float
    """px, of the points' epipolar distances"""


def check_belongs(rig: StereoRig, left: Array, right: Array, limit: float) -> None:
    """Raise ValueError unless matched pixels (n, 2) lie near their epipolar lines.

    `limit` px for the median. Says so when the two cameras are swapped.
    """
    distance = _median(rig, left, right)
    swapped = _median(_exchanged(rig), left, right)
    # of two cameras alike the swapped lines are close too, but not as close as the true ones
    if swapped < SWAPPED * min(distance, limit):
        raise _swapped("left, right: the images, or those of the calibration,", distance, swapped)
    if distance <= limit:
        return
    raise ValueError(
        f"calibration: points matched between the cameras lie {distance:.1f} px from their "
        f"epipolar lines, expected below {limit:g}; it is of another set-up, or the cameras have "
        "moved (refine_pose finds their pose again)"
    )


def check_sides(rig: StereoRig, left: Array, right: Array, usual: float, subject: str) -> float:
    """Median distance of matched pixels (n, 2) from their epipolar lines, px; inf for no point.

    Raises ValueError when the two images, which `subject` names, are exchanged: then points lie as
    near the exchanged lines as they usually do, `usual` px, near their own. Not by few points, nor
    where a camera has moved, which can bring points of nearly parallel cameras nearer to the wrong
    line.
    """
    distance, swapped = _median(rig, left, right), _median(_exchanged(rig), left, right)
    n = int(np.isfinite(left + right).all(axis=1).sum())
    if n >= LEAST_POINTS and swapped < SWAPPED * distance and swapped < AS_USUAL * usual:
        raise _swapped(subject, distance, swapped)
    return distance


def _exchanged(rig: StereoRig) -> StereoRig:
    return StereoRig(rig.right, rig.left)


def _swapped(subject: str, distance: float, swapped: float) -> ValueError:
    return ValueError(
        f"{subject} are swapped; points lie {distance:.2g} px from their epipolar lines, and "
        f"{swapped:.2g} px with left and right exchanged"
    )


def check_order(rig: StereoRig, left: Array, right: Array, found: float) -> None:
    """Raise ValueError when a new pose fits matched pixels (n, 2) better with swapped cameras.

    `found` is the RMS distance from the epipolar lines as given, px, by `refine_pose`.
    """
    try:
        swapped = refine_pose(_exchanged(rig), left, right).rms
    except ValueError:
        return
    if swapped < SWAPPED * found:
        raise ValueError(
            "left, right: the images, or those of the calibration, are swapped; with the pose "
            f"found again points lie {found:.2g} px from their epipolar lines, and "
            f"{swapped:.2g} px with left and right exchanged"
        )


def _median(rig: StereoRig, left: Array, right: Array) -> float:
    found = np.abs(epipolar_distance(rig, left, right))
    found = found[np.isfinite(found)]
    return float(np.median(found)) if found.size else np.inf


def refine_pose(rig: StereoRig, left: Array, right: Array) -> Refined:
    """The relative pose that brings matched pixels (n, 2) to their epipolar lines.

    Intrinsics and the length of the baseline are kept, and of the pose what the points leave
    open. Raises ValueError with too few points, and when the points come to lie behind a camera.
    """
    good = np.all(np.isfinite(left) & np.isfinite(right), axis=1)
    if np.count_nonzero(good) < LEAST_POINTS:
        raise ValueError(
            f"refine_pose: found {np.count_nonzero(good)} matched points, expected "
            f"{LEAST_POINTS} or more"
        )

    def distance(x: Array) -> Array:
        return epipolar_distance(moved_rig(rig, x), left[good], right[good])

    def residual(x: Array) -> Array:
        return np.concatenate([distance(x), NOISE_PX / HELD_RAD * x])

    # from far off the robust loss is flat: a plain fit brings it near
    start = least_squares(residual, np.zeros(5), x_scale="jac", xtol=1e-12, ftol=1e-12).x
    fit = least_squares(
        residual, start, loss="soft_l1", f_scale=ROBUST_PX, x_scale="jac", xtol=1e-12, ftol=1e-12
    )
    found = moved_rig(rig, fit.x)
    space = triangulate(found, left[good], right[good]).points
    if not np.isfinite(space).all(axis=1).mean() > MOST_BEFORE:
        raise ValueError(
            "refine_pose: found a pose with points behind the cameras, expected all before them; "
            "the calibration is of another set-up"
        )
    rms = float(np.sqrt(np.mean(distance(fit.x) ** 2)))
    in_place = StereoRig(
        rig.left,
        Camera(
            found.right.intrinsics,
            found.right.rotation @ rig.left.rotation,
            found.right.rotation @ rig.left.translation + found.right.translation,
        ),
    )
    return Refined(in_place, float(np.degrees(np.linalg.norm(fit.x[:3]))), rms)


def moved_rig(rig: StereoRig, x: Array) -> StereoRig:
    """The rig, left camera at the origin, turned by the vector x[:3], its baseline by x[3:] [rad].

    The baseline turns along two directions at right angles to it and keeps its length.
    """
    turn, shift = rig.relative
    length = float(np.linalg.norm(shift))
    across = np.linalg.svd(shift[None, :])[2][1:]
    direction = shift / length + x[3:] @ across
    right_camera = Camera(
        rig.right.intrinsics,
        Rotation.from_rotvec(x[:3]).as_matrix() @ turn,
        length * direction / np.linalg.norm(direction),
    )
    return StereoRig(Camera(rig.left.intrinsics), right_camera)
