"""Stereo correlation: points of the left reference image in space, and how they move.

Points are matched between the cameras once, in the reference images, and followed over time in
each camera; errors of the match between the cameras so act on a displacement only by what changes
of them. Source: M. A. Sutton, J.-J. Orteu, H. W. Schreier, "Image Correlation for Shape, Motion
and Deformation Measurements", Springer 2009, chapter 7.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from calib.dic.camera import StereoRig, epipolar_distance
from calib.dic.carried_mask import carried_mask
from calib.dic.correlate import correlate_prepared
from calib.dic.distortion import Array
from calib.dic.follow import State, next_state
from calib.dic.pose_check import check_belongs, check_order, check_sides, refine_pose
from calib.dic.prepared import BoolArray, Reference, as_image, deformed_spline, prepare
from calib.dic.progress import Progress, in_turn
from calib.dic.settings import CorrelationSettings
from calib.dic.triangulate import Triangulated, triangulate

IntArray = npt.NDArray[np.int64]


class StereoReason(IntEnum):
    """Why a point has no displacement in space; 0 is valid."""

    VALID = 0
    NO_PARTNER = 1
    LOST_LEFT = 2
    LOST_RIGHT = 3
    OFF_LINE = 4

    @property
    def text(self) -> str:
        """A few words for tables and pictures."""
        return _TEXT[self]


_TEXT = {
    StereoReason.VALID: "valid",
    StereoReason.NO_PARTNER: "not found in the right reference image",
    StereoReason.LOST_LEFT: "lost in the left image",
    StereoReason.LOST_RIGHT: "lost in the right image",
    StereoReason.OFF_LINE: "too far from the epipolar line",
}


class NothingMatched(ValueError):  # noqa: N818 - says what happened
    """No point of the left image was found in the right one."""


@dataclass(frozen=True)
class StereoSettings:
    """How to correlate; lengths in px. Raises ValueError for an impossible number."""

    correlation: CorrelationSettings = field(default_factory=CorrelationSettings)
    max_epipolar: float = 0.5
    """a point farther from its epipolar line is lost"""
    max_median_epipolar: float = 1.0
    """images whose points lie farther, in the median, do not belong to the calibration"""
    refine_pose: bool = False
    """find the relative pose of the cameras again from the reference images"""

    def __post_init__(self) -> None:
        if not (self.max_epipolar > 0 and self.max_median_epipolar > 0):
            raise ValueError(
                f"max_epipolar, max_median_epipolar: expected above 0, found "
                f"{self.max_epipolar}, {self.max_median_epipolar}"
            )


@dataclass(frozen=True)
class StereoReference:
    """Points in the two reference images and in space."""

    rig: StereoRig
    """with which the points were placed: refined if that was asked for"""
    left_ready: Reference
    right_ready: Reference
    left: Array
    """(n, 2) px, as chosen"""
    right: Array
    """(n, 2) px, NaN where there is no partner"""
    sigma: Array
    """(n, 2) SD of `right`, px"""
    space: Triangulated
    epipolar: Array
    """(n,) px"""
    reason: IntArray
    """(n,) codes of StereoReason"""
    turned: float = 0.0
    """degrees by which a refined pose differs from that of the calibration"""


class StereoFrame(NamedTuple):
    """Displacements of the points in one pair of images, in the rig's frame."""

    position: Array
    """(n, 3) reference positions, mm; NaN without a partner"""
    displacement: Array
    """(n, 3) mm; NaN where the point is not valid"""
    covariance: Array
    """(n, 3, 3) of the displacement by the noise of the images and the bias of their interpolation,
    mm^2"""
    reason: IntArray
    """(n,) codes of StereoReason"""
    epipolar: Array
    """(n,) px, in this pair of images"""

    @property
    def valid(self) -> BoolArray:
        """(n,) points that have a displacement."""
        return np.asarray(self.reason == StereoReason.VALID)

    @property
    def sigma(self) -> Array:
        """(n, 3) SD of the displacement along each axis, mm."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


class Tracked(NamedTuple):
    """Where both cameras are in their series of images: a start for the next pair."""

    left: State
    right: State


def place_reference(
    rig: StereoRig,
    left_image: Array,
    right_image: Array,
    points: Array,
    settings: StereoSettings | None = None,
    mask: BoolArray | None = None,
    progress: Progress | None = None,
) -> StereoReference:
    """Match points (n, 2) [px] of the left reference image with the right one and place them.

    `mask` (rows, columns): pixels of the left image that count; it is carried to the right one.
    Raises ValueError when the images do not belong to the calibration or are swapped.
    """
    settings = settings or StereoSettings()
    options = settings.correlation
    left_grey, right_grey = as_image(left_image, "left"), as_image(right_image, "right")
    left_ready = prepare(left_grey, options.degree, mask, options.blur)
    spline = deformed_spline(right_grey, options)
    match = correlate_prepared(left_ready, right_grey, spline, points, options, progress=progress)
    right = points + match.displacement
    if not match.valid.any():
        raise NothingMatched(
            "right: found none of the points of the left image, expected the same view"
        )
    turned = 0.0
    if settings.refine_pose:
        refined = refine_pose(rig, points, right)
        check_order(rig, points, right, refined.rms)
        rig, turned = refined.rig, refined.turned
    check_belongs(rig, points, right, settings.max_median_epipolar)
    distance = epipolar_distance(rig, points, right)
    if not np.any(np.abs(distance) <= settings.max_epipolar):
        raise ValueError(
            f"left, right: found no matched point within {settings.max_epipolar:g} px "
            f"(max_epipolar) of its epipolar line, expected most; the median is "
            f"{np.nanmedian(np.abs(distance)):.2g} px"
        )
    reason = np.where(match.valid, StereoReason.VALID, StereoReason.NO_PARTNER)
    reason[match.valid & ~(np.abs(distance) <= settings.max_epipolar)] = StereoReason.OFF_LINE
    kept = np.where((reason == StereoReason.VALID)[:, None], right, np.nan)
    space = triangulate(rig, points, kept)
    # lines of sight that meet behind the cameras
    lost = (reason == StereoReason.VALID) & ~np.isfinite(space.points).all(axis=1)
    reason[lost], kept[lost] = StereoReason.OFF_LINE, np.nan
    there = None
    if mask is not None and not mask.all():
        shape = (right_grey.shape[0], right_grey.shape[1])
        has = np.isfinite(kept).all(axis=1)
        moved = (points[has], kept[has], match.gradient[has])
        there = carried_mask(mask, *moved, np.arange(has.sum()), options.radius, shape)
    return StereoReference(
        rig, left_ready, prepare(right_grey, options.degree, there, options.blur), points, kept,
        match.total, space, distance, reason.astype(np.int64), turned,
    )  # fmt: skip


def follow_pair(
    reference: StereoReference,
    left_image: Array,
    right_image: Array,
    settings: StereoSettings | None = None,
    before: Tracked | None = None,
    progress: Progress | None = None,
) -> tuple[StereoFrame, Tracked]:
    """Displacements in a later pair of images; `before`: where the pair before it left off.

    Points without a partner are not followed. Raises ValueError for images of another size.
    """
    settings = settings or StereoSettings()
    placed = np.flatnonzero(reference.reason == StereoReason.VALID)
    start = before or Tracked(State(), State())
    states = []
    following = in_turn(progress, 2 * len(placed))
    for side, ready, image, points, state in (
        ("left", reference.left_ready, left_image, reference.left, start.left),
        ("right", reference.right_ready, right_image, reference.right, start.right),
    ):
        if ready.image.shape != image.shape:
            raise ValueError(
                f"{side}: expected an image of {ready.image.shape} px (rows, columns) as the "
                f"reference, found {image.shape}"
            )
        states.append(
            next_state(ready, image, points[placed], settings.correlation, state, following())
        )
    tracked = Tracked(*states)
    return frame_of(reference, tracked, settings), tracked


def frame_of(reference: StereoReference, tracked: Tracked, settings: StereoSettings) -> StereoFrame:
    """Displacements in space at the frame to which both cameras have been followed."""
    assert tracked.left.last is not None and tracked.right.last is not None
    placed = np.flatnonzero(reference.reason == StereoReason.VALID)
    left, right = tracked.left.last.found, tracked.right.last.found
    n = len(reference.left)
    now_left, now_right = _now(reference, tracked)
    distance = epipolar_distance(reference.rig, now_left, now_right)
    of_placed = np.where(left.valid, StereoReason.VALID, StereoReason.LOST_LEFT)
    of_placed = np.where(left.valid & ~right.valid, StereoReason.LOST_RIGHT, of_placed)
    off = (of_placed == StereoReason.VALID) & ~(np.abs(distance) <= settings.max_epipolar)
    of_placed = np.where(off, StereoReason.OFF_LINE, of_placed)
    good = of_placed == StereoReason.VALID
    rows = placed[good]

    displacement, covariance = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
    space = triangulate(reference.rig, now_left[good], now_right[good])
    displacement[rows] = space.points - reference.space.points[rows]
    covariance[rows] = _covariance(
        reference.space.by_pixels[rows], space.by_pixels, left.total[good], right.total[good],
        reference.sigma[rows], right.gradient[good],
    )  # fmt: skip
    reason, epipolar = reference.reason.copy(), np.full(n, np.nan)
    reason[placed], epipolar[placed] = of_placed, distance
    return StereoFrame(reference.space.points, displacement, covariance, reason, epipolar)


def median_distance(reference: StereoReference, tracked: Tracked, subject: str) -> float:
    """Of the points from their epipolar lines in the frame followed to, px; inf for no point.

    Raises ValueError when the images of this frame, which `subject` names, are swapped.
    """
    usual = usual_distance(reference)
    return check_sides(reference.rig, *_now(reference, tracked), usual, subject)


def usual_distance(reference: StereoReference) -> float:
    """Median distance of the placed points from their lines in the reference images, px."""
    placed = reference.reason == StereoReason.VALID
    return float(np.median(np.abs(reference.epipolar[placed])))


def _now(reference: StereoReference, tracked: Tracked) -> tuple[Array, Array]:
    """Where both cameras see the placed points in the frame followed to, (n_placed, 2) px each."""
    assert tracked.left.last is not None and tracked.right.last is not None
    placed = reference.reason == StereoReason.VALID
    return (
        reference.left[placed] + tracked.left.last.found.displacement,
        reference.right[placed] + tracked.right.last.found.displacement,
    )


def _covariance(
    before: Array, now: Array, left: Array, right: Array, match: Array, gradient: Array
) -> Array:
    """(n, 3, 3) of displacements, mm^2, from SDs (n, 2) of the three correlations, px.

    An error of the match between the cameras moves the point that the right camera follows: it
    comes through the deformation gradient into the later image, and leaves its own part in the
    reference position.
    """
    carried = now[:, :, 2:] @ (np.eye(2) + gradient) - before[:, :, 2:]
    total = np.zeros((len(now), 3, 3))
    for by, sigma in ((now[:, :, :2], left), (now[:, :, 2:], right), (carried, match)):
        scaled = by * sigma[:, None, :]
        total += scaled @ scaled.transpose(0, 2, 1)
    return total
