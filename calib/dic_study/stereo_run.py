"""Carry out a study of the images of two cameras: `calib dic` with a section [stereo]."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from calib.data.readers import PointFrame, write_points
from calib.dic import GreyImage, State, read_image
from calib.dic.calibration import Calibration
from calib.dic.calibration_files import write_calibration
from calib.dic.progress import Progress
from calib.dic.stereo import (
    StereoFrame,
    StereoReason,
    Tracked,
    follow_pair,
    frame_of,
)
from calib.dic.surface_strain import surface_strain
from calib.dic_study import frame_store
from calib.dic_study.bars import Bars, no_bars
from calib.dic_study.camera_files import check_two_views, pairs, view_doubt
from calib.dic_study.exposure import (
    check_series_found,
    empty_frame,
    no_strain,
    weak_frame,
)
from calib.dic_study.named_files import check_files, number_doubt
from calib.dic_study.pictures import save_png
from calib.dic_study.plates import calibration_of
from calib.dic_study.repeated import Seen, repeats
from calib.dic_study.stale_frames import finite, remove_following, remove_stale
from calib.dic_study.stereo_config import StereoStudy
from calib.dic_study.stereo_pictures import stereo_overlay
from calib.dic_study.stereo_prepared import Prepared, as_used, lengths_sd, prepare_pair
from calib.dic_study.stereo_summary import sentence, summary
from calib.stereo_points import error_length, point_frame, reference_frame
from fe.atomic_file import replacing, write_text
from fe.response import Array

Say = Callable[[str], None]
POINTS, PICTURES, STORE = "points", "pictures", "frames"
CALIBRATION = "calibration.json"


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
    ready = prepare_pair(study, folder, calibration, say, bars)
    check_files(ready.left, left + right)
    used = as_used(calibration, ready)
    scale = lengths_sd(ready, used)
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
