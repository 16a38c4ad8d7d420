"""What all pairs of images of two cameras have in common: the reference pair, placed in space."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from calib.dic import GreyImage, Quality, grid_points, quality, read_image
from calib.dic.calibration import Calibration
from calib.dic.images import check_sizes
from calib.dic.overlap import correlation_length
from calib.dic.pose_error import covariance_of_found
from calib.dic.prepared import BoolArray
from calib.dic.progress import Progress
from calib.dic.scale_error import scale_sd
from calib.dic.stereo import (
    NothingMatched,
    StereoReason,
    StereoReference,
    place_reference,
)
from calib.dic.surface_frame import SurfaceFrame, surface_frame, unturned
from calib.dic_study import frame_store
from calib.dic_study.bars import Bars
from calib.dic_study.camera_files import check_two_views
from calib.dic_study.exposure import (
    check_exposure,
    check_repeat,
    check_speckle,
    check_whole,
)
from calib.dic_study.region_mask import check_room, region_mask
from calib.dic_study.stereo_config import StereoStudy
from fe.response import Array

Say = Callable[[str], None]


class Prepared(NamedTuple):
    """All that the pairs of images have in common."""

    reference: StereoReference
    left: GreyImage
    grid: tuple[int, int]
    axes: SurfaceFrame
    study: StereoStudy
    key: str
    judged: dict[str, Quality]
    """of the reference images, by camera"""


def prepare_pair(
    study: StereoStudy, folder: Path, calibration: Calibration, say: Say, bars: Bars
) -> Prepared:
    """Read and judge the reference images, and place the points of the left one in space.

    Raises ValueError, in one sentence, for images that are of no use, of other sizes than the
    calibration's, or of another set-up.
    """
    left = read_image(folder / study.images.reference)
    right = read_image(folder / study.stereo.right_reference)
    check_two_views(left, right)
    for image in (left, right):
        _check_size(image, calibration)
    mask: BoolArray = region_mask(study.region, folder, left)
    points, grid = grid_points(mask, study.correlation.step_px)
    check_room(mask, points, study.settings.correlation)
    check_exposure(left, mask)
    check_speckle(right)
    repeat = None
    if study.images.repeat is not None:
        repeat = read_image(folder / study.images.repeat)
        check_sizes([left, repeat])
        check_repeat(repeat, left, mask)
    with bars("reference") as bar:
        reference = _placed(calibration, left, right, points, study, mask, bar)
    check_exposure(right, reference.right_ready.mask)
    if study.stereo.refine_pose:
        say(
            f"warning: the relative pose of the cameras was found again; it is turned by "
            f"{reference.turned:.3f} degrees from that of the calibration"
        )
    axes = unturned()
    if study.stereo.axes == "surface":
        axes = surface_frame(reference.rig, reference.space.points)
    found = int(np.count_nonzero(reference.reason == StereoReason.VALID))
    say(
        f"reference: {found} of {len(points)} points in both cameras, epipolar distance "
        f"{np.sqrt(np.nanmean(reference.epipolar**2)):.4f} px RMS"
    )
    subset = study.settings.correlation.subset
    judged = {
        "left": quality(left, mask, subset, repeat),
        "right": quality(right, reference.right_ready.mask, subset),
    }
    for side, one in judged.items():
        for warning in one.warnings:
            say(f"warning: {side}: {warning}")
    key = _first_key(reference, axes, study)
    return Prepared(reference, left, grid, axes, study, key, judged)


def _placed(
    calibration: Calibration,
    left: GreyImage,
    right: GreyImage,
    points: Array,
    study: StereoStudy,
    mask: BoolArray,
    bar: Progress,
) -> StereoReference:
    """The points (n, 2) [px] of the left reference image in space; `mask` is the region of it."""
    images = left.grey, right.grey
    try:
        return place_reference(calibration.rig, *images, points, study.settings, mask, bar)
    except NothingMatched:
        check_whole(right)  # which may be why nothing is found in it
        raise


def as_used(calibration: Calibration, ready: Prepared) -> Calibration:
    """What the points were made with.

    Of a pose found again, how the plates fitted says nothing, and the covariance is its own.
    """
    study, placed = ready.study, ready.reference
    if not study.stereo.refine_pose:
        return calibration
    if calibration.covariance is None:
        return Calibration(placed.rig, calibration.size)
    apart = correlation_length(study.correlation.settings) / study.correlation.step_px
    clump = max(1.0, 2.0 * np.pi * apart**2)  # points whose subsets have one error
    matched = placed.left, placed.right
    covariance = covariance_of_found(placed.rig, calibration.covariance, *matched, clump)
    return Calibration(placed.rig, calibration.size, covariance=covariance)


def _first_key(reference: StereoReference, axes: SurfaceFrame, study: StereoStudy) -> str:
    """Of all that the frames and their pictures follow from."""
    limit = np.array(study.settings.max_epipolar)
    arrays: list[frame_store.Anything] = [
        reference.left, reference.right, axes.rotation, axes.origin, limit
    ]  # fmt: skip
    for ready in (reference.left_ready, reference.right_ready):
        arrays += [ready.image, ready.mask]
    for camera in (reference.rig.left, reference.rig.right):
        lens = camera.intrinsics
        arrays += [lens.matrix, lens.distortion.coefficients, camera.rotation, camera.translation]
    return frame_store.first_key(study.correlation.settings, arrays)


def _check_size(image: GreyImage, calibration: Calibration) -> None:
    size = (image.grey.shape[1], image.grey.shape[0])
    # some files of calibrations do not say it
    if calibration.size != (0, 0) and size != calibration.size:
        raise ValueError(
            f"{image.name}: found {size[0]} x {size[1]} px, expected {calibration.size[0]} x "
            f"{calibration.size[1]} as in the calibration"
        )


def lengths_sd(ready: Prepared, used: Calibration) -> float | None:
    """Relative SD of all lengths; None for a calibration of another program, which states none."""
    if used.covariance is None:
        return None
    placed = ready.reference
    return scale_sd(placed.rig, used.covariance, placed.left, placed.right)
