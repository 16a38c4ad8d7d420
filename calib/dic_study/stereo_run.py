"""Carry out a study of the images of two cameras: `calib dic` with a section [stereo]."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from calib.data.readers import PointFrame, write_points
from calib.dic import GreyImage, Quality, State, grid_points, quality, read_image
from calib.dic.calibration import Calibration
from calib.dic.calibration_files import write_calibration
from calib.dic.images import check_sizes
from calib.dic.overlap import correlation_length
from calib.dic.pose_error import covariance_of_found
from calib.dic.prepared import BoolArray
from calib.dic.progress import Progress
from calib.dic.scale_error import scale_sd
from calib.dic.stereo import (
    StereoFrame,
    StereoReason,
    StereoReference,
    Tracked,
    follow_pair,
    frame_of,
    place_reference,
)
from calib.dic.surface_frame import SurfaceFrame, surface_frame, unturned
from calib.dic.surface_strain import surface_strain
from calib.dic_study import frame_store
from calib.dic_study.bars import Bars, no_bars
from calib.dic_study.camera_files import check_two_views, pairs, view_doubt
from calib.dic_study.exposure import (
    check_exposure,
    check_repeat,
    check_series_found,
    check_speckle,
    check_whole,
    empty_frame,
    no_strain,
    weak_frame,
)
from calib.dic_study.named_files import check_files, number_doubt
from calib.dic_study.pictures import save_png
from calib.dic_study.plates import calibration_of
from calib.dic_study.region_mask import check_room, region_mask
from calib.dic_study.repeated import Seen, repeats
from calib.dic_study.stale_frames import finite, remove_following, remove_stale
from calib.dic_study.stereo_config import StereoStudy
from calib.dic_study.stereo_pictures import stereo_overlay
from calib.dic_study.stereo_summary import sentence, summary
from calib.stereo_points import error_length, point_frame, reference_frame
from fe.atomic_file import replacing, write_text
from fe.response import Array

Say = Callable[[str], None]
POINTS, PICTURES, STORE = "points", "pictures", "frames"
CALIBRATION = "calibration.json"


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


def run_stereo(study: StereoStudy, folder: Path, out: Path, say: Say, bars: Bars = no_bars) -> Path:
    """Measure all pairs of images of a study in `folder`; returns the folder of the results.

    Pairs that are done, from the same images with the same calibration, are not done again, nor is
    a calibration from the same images of a plate.
    Raises ValueError, in one sentence, for wrong input: no calibration that fits, swapped cameras,
    images of different sizes or numbers.
    """
    left, right = pairs(study, folder)
    first_pair = Path(study.images.reference), Path(study.stereo.right_reference)
    shifted = number_doubt((first_pair[0], *left), (first_pair[1], *right))
    if doubt := number_doubt(left, right) or shifted:  # a reference may have another name
        say(f"warning: {doubt}")
    calibration = calibration_of(study, folder, out / STORE, say)
    ready = _prepare(study, folder, calibration, say, bars)
    check_files(ready.left, left + right)
    used = _as_used(calibration, ready)
    scale = _scale_sd(ready, used)
    length = error_length(ready.reference, study.correlation.settings)
    times = study.images.times_s
    _begin(out, ready, used, {path.stem for path in left}, (scale, length), say)
    before, key = Tracked(State(), State()), ready.key
    seen: Seen = ({}, {})
    repeats(seen, (ready.left, read_image(folder / study.stereo.right_reference)))
    frames = []
    for number, paths in enumerate(zip(left, right, strict=True)):
        images = [read_image(path) for path in paths]
        check_two_views(*images)
        key, stem = frame_store.next_key(key, images), paths[0].stem
        with bars(paths[0].name) as bar:
            store = out / STORE / f"{stem}.npz"
            stored = frame_store.load(store, key, before, images)
            if again := stored is None:
                remove_following(out, [path.stem for path in left[number:]])
            before = Tracked(*stored) if stored else _pair(store, key, images, ready, before, bar)
        for doubt in _doubts(ready, before, images, seen):
            say(f"warning: {doubt}")
        found = frame_of(ready.reference, before, study.settings)
        frames.append(summary(paths[0], found))
        frame = point_frame(
            found, stem, None if times is None else times[number], ready.grid, ready.axes
        )
        frame = replace(frame, scale_sd=scale, correlation_length=length)
        has_strain = _write(out, stem, frame, ready, again)
        done = "measured" if again else "kept"
        say(f"{number + 1}/{len(left)} {paths[0].name}: {sentence(found, ready.axes)} ({done})")
        if lack := _lack(found, has_strain, images):
            say(f"warning: {lack}")
    _report(out, ready, calibration, scale, frames)
    check_series_found(frames, ready.left.name)
    say(f"wrote {out}")
    return out


def _begin(
    out: Path,
    ready: Prepared,
    calibration: Calibration,
    stems: set[str],
    errors: tuple[float | None, float | None],
    say: Say,
) -> None:
    """Make the folders, write calibration and reference, take away what frames of before left.

    `stems` are the frames' names; `errors` the relative SD of all lengths and the length over
    which errors of points go together [mm].
    """
    for name in (POINTS, PICTURES, STORE):
        (out / name).mkdir(parents=True, exist_ok=True)
    write_calibration(out / CALIBRATION, calibration)
    first = Path(ready.study.images.reference).stem
    remove_stale(out, ready.key, {first, *stems}, say)
    rest = reference_frame(ready.reference, first, None, ready.grid, ready.axes)
    rest = replace(rest, scale_sd=errors[0], correlation_length=errors[1])
    write_points(out / POINTS / f"{first}.csv", rest)


def _doubts(
    ready: Prepared, tracked: Tracked, images: list[GreyImage], seen: Seen
) -> Iterator[str]:
    """What is doubtful of a pair of images that was followed to."""
    yield from repeats(seen, images)
    limit = ready.study.settings.max_median_epipolar
    if doubt := view_doubt(ready.reference, tracked, limit, *images):
        yield doubt
    for image, state in zip(images, tracked, strict=True):
        if state.last is not None and (doubt := weak_frame(image, state.last.found)):
            yield doubt


def _lack(found: StereoFrame, has_strain: bool, images: list[GreyImage]) -> str | None:
    """What a pair of images was to give and has not."""
    if not found.valid.any():
        return empty_frame(*images)
    return None if has_strain else no_strain("stereo.strain_radius_mm")


def _pair(
    store: Path,
    key: str,
    images: list[GreyImage],
    ready: Prepared,
    before: Tracked,
    bar: Progress,
) -> Tracked:
    """Both cameras after one more pair of images, which is kept."""
    left, right = (image.grey for image in images)
    _, tracked = follow_pair(ready.reference, left, right, ready.study.settings, before, bar)
    frame_store.save(store, key, tracked)
    return tracked


def _as_used(calibration: Calibration, ready: Prepared) -> Calibration:
    """What the points were made with: of a pose found again, how the plates fitted says nothing."""
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


def _prepare(
    study: StereoStudy, folder: Path, calibration: Calibration, say: Say, bars: Bars
) -> Prepared:
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
    except ValueError:
        check_whole(right)  # which may be why nothing is found in it
        raise


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


def _scale_sd(ready: Prepared, used: Calibration) -> float | None:
    """Relative SD of all lengths; None for a calibration of another program, which states none."""
    if used.covariance is None:
        return None
    placed = ready.reference
    return scale_sd(placed.rig, used.covariance, placed.left, placed.right)


def _write(out: Path, stem: str, frame: PointFrame, ready: Prepared, again: bool) -> bool:
    """Points and strain each time; the picture where it is missing or was measured now.

    Returns False where a strain was wanted and there is none at any point.
    """
    write_points(out / POINTS / f"{stem}.csv", frame)
    picture = out / PICTURES / f"{stem}.png"
    if again or not picture.exists():
        save_png(stereo_overlay(ready.left, ready.reference.left, frame.displacement), picture)
    radius, strained = ready.study.stereo.strain_radius_mm, out / f"{stem}-strain.csv"
    if radius is None:
        strained.unlink(missing_ok=True)  # of a study that wanted it
        return True
    return _write_strain(strained, frame.position, frame.displacement, radius)


def _write_strain(path: Path, position: Array, displacement: Array, radius: float) -> bool:
    strain = surface_strain(position, displacement, radius)
    columns = np.column_stack([position, strain.xx, strain.yy, strain.xy])
    head = "x_mm,y_mm,z_mm,green_xx,green_yy,green_xy"
    with replacing(path) as temporary:
        np.savetxt(temporary, columns, delimiter=",", header=head, comments="", fmt="%.9g")
    return bool(np.isfinite(strain.xx).any())


def _report(
    out: Path,
    ready: Prepared,
    calibration: Calibration,
    scale: float | None,
    frames: list[dict[str, Any]],
) -> None:
    rig = ready.reference.rig
    content = {
        "reference": ready.left.name,
        "quality": {side: finite(one) for side, one in ready.judged.items()},
        "stereo_angle_deg": rig.angle,
        "baseline_mm": rig.baseline,
        "scale_sd": scale,
        "pose_turned_deg": ready.reference.turned,
        "reprojection_px": None if np.isnan(calibration.rms) else calibration.rms,
        "axes": {"rotation": ready.axes.rotation.tolist(), "origin_mm": ready.axes.origin.tolist()},
        "stereo": asdict(ready.study.stereo),
        "correlation": asdict(ready.study.correlation),
        "reasons": {reason.name.lower(): reason.text for reason in StereoReason},
        "frames": frames,
    }
    write_text(out / "dic.json", json.dumps(content, indent=1) + "\n")
