"""Carry out a study of images: `calib dic`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from calib.data.readers import write_points
from calib.dic import (
    Correlation,
    CorrelationSettings,
    GreyImage,
    Quality,
    Reason,
    Reference,
    State,
    correlation_length,
    grid_points,
    next_state,
    prepare,
    quality,
    read_image,
    strain,
)
from calib.dic.images import check_sizes
from calib.dic.progress import Progress
from calib.dic_study import frame_store
from calib.dic_study.bars import Bars, no_bars
from calib.dic_study.config import DicStudy, read_study
from calib.dic_study.exposure import (
    check_exposure,
    check_repeat,
    check_series_found,
    empty_frame,
    no_strain,
    weak_frame,
)
from calib.dic_study.named_files import check_files, check_series, named_files
from calib.dic_study.pictures import lost_points, overlay, save_png
from calib.dic_study.point_frame import point_frame
from calib.dic_study.region_mask import check_room, region_mask
from calib.dic_study.repeated import Seen, repeats
from calib.dic_study.stale_frames import finite, remove_following, remove_stale
from calib.dic_study.stereo_config import StereoStudy, has_stereo
from calib.dic_study.stereo_run import run_stereo
from calib.toml_file import Contradiction
from fe.atomic_file import replacing, write_text
from fe.response import Array

Say = Callable[[str], None]
POINTS, PICTURES, STORE = "points", "pictures", "frames"


class Prepared(NamedTuple):
    """All that frames have in common."""

    reference: GreyImage
    ready: Reference
    points: Array
    grid: tuple[int, int]
    judged: Quality
    settings: CorrelationSettings
    key: str


def run(path: Path, out: Path | None, say: Say, bars: Bars = no_bars) -> Path:
    """Measure all images of the study at `path`; returns the folder of the results.

    Frames that are done, from the same images with the same settings, are not done again. `say`
    gets a line for each, `bars` shows how far one has come.
    Raises ValueError, in one sentence, for wrong input.
    """
    document, folder = read_study(path), path.parent
    out = out or folder / f"{path.stem}-dic"
    if out.exists() and not out.is_dir():
        raise ValueError(f"--out: found the file {out}, expected a folder or a new name")
    try:
        if has_stereo(document):
            return run_stereo(document.checked(StereoStudy), folder, out, say, bars)
        return _run_one_camera(document.checked(DicStudy), folder, out, say, bars)
    except Contradiction as error:
        raise document.refuse(error.refusal()) from error


def _run_one_camera(study: DicStudy, folder: Path, out: Path, say: Say, bars: Bars) -> Path:
    images = study.images
    paths = named_files(
        images.deformed, folder, "images.deformed", {images.reference, images.repeat}
    )
    check_series("images.deformed", paths, images.times_s)
    ready = _prepare(study, folder)
    check_files(ready.reference, paths)
    for name in (POINTS, PICTURES, STORE):
        (out / name).mkdir(parents=True, exist_ok=True)
    remove_stale(out, ready.key, {path.stem for path in paths}, say)
    for warning in ready.judged.warnings:
        say(f"warning: {warning}")
    frames = []
    state, key = State(), ready.key
    seen: Seen = ({},)
    repeats(seen, (ready.reference,))
    for number, file in enumerate(paths):
        image = read_image(file)
        key = frame_store.next_key(key, [image])
        with bars(file.name) as bar:
            store = out / STORE / f"{file.stem}.npz"
            stored = frame_store.load(store, key, [state], [image])
            if again := stored is None:
                remove_following(out, [path.stem for path in paths[number:]])
            state = stored[0] if stored else _measure(store, key, image, ready, state, bar)
        assert state.last is not None
        found = state.last.found
        frames.append(_summary(file, found))
        time = None if images.times_s is None else images.times_s[number]
        has_strain = _write(out, file.stem, image, found, ready, study, time, again)
        done = "kept" if not again else "measured"
        say(f"{number + 1}/{len(paths)} {file.name}: {_sentence(found)} ({done})")
        for doubt in _doubts(image, found, has_strain, seen):
            say(f"warning: {doubt}")
    _report(out, study, ready, frames)
    check_series_found(frames, ready.reference.name)
    say(f"wrote {out}")
    return out


def _doubts(image: GreyImage, found: Correlation, has_strain: bool, seen: Seen) -> Iterator[str]:
    """What is doubtful of an image that was measured, and what it was to give and has not."""
    yield from repeats(seen, (image,))
    if not found.valid.any():
        yield empty_frame(image)
    elif not has_strain:
        yield no_strain("strain.radius_px")
    if doubt := weak_frame(image, found):
        yield doubt


def _prepare(study: DicStudy, folder: Path) -> Prepared:
    reference = read_image(folder / study.images.reference)
    mask = region_mask(study.region, folder, reference)
    settings = study.correlation.settings
    points, grid = grid_points(mask, study.correlation.step_px)
    check_room(mask, points, settings)
    check_exposure(reference, mask)
    repeat = None
    if study.images.repeat is not None:
        repeat = read_image(folder / study.images.repeat)
        check_sizes([reference, repeat])
        check_repeat(repeat, reference, mask)
    judged = quality(reference, mask, settings.subset, repeat)
    key = frame_store.first_key(settings, [reference.grey, mask, points])
    image = prepare(reference.grey, settings.degree, mask, settings.blur)
    return Prepared(reference, image, points, grid, judged, settings, key)


def _measure(
    store: Path, key: str, image: GreyImage, ready: Prepared, state: State, bar: Progress
) -> State:
    """The state after one more frame, which is kept."""
    state = next_state(ready.ready, image.grey, ready.points, ready.settings, state, bar)
    frame_store.save(store, key, [state])
    return state


def _summary(path: Path, found: Correlation) -> dict[str, Any]:
    valid = found.valid
    lost = {r.name.lower(): int(np.sum(found.reason == r)) for r in list(Reason)[1:]}
    return {
        "image": path.name,
        "points": int(valid.size),
        "valid": int(valid.sum()),
        "lost": {name: count for name, count in lost.items() if count},
        "median_zncc": float(np.median(found.zncc[valid])) if valid.any() else None,
        "median_sigma_px": _medians(found.sigma[valid]),
        "median_interpolation_px": _medians(found.interpolation[valid]),
    }


def _medians(values: Array) -> list[float] | None:
    """Of each column of values (n, 2); None for none."""
    return np.median(values, axis=0).tolist() if len(values) else None


def _sentence(found: Correlation) -> str:
    valid = int(found.valid.sum())
    text = f"{valid} of {found.valid.size} points"
    if valid:
        noise, wave = (np.median(sd[found.valid]) for sd in (found.sigma, found.interpolation))
        text += f", median sigma {noise:.4f} px by noise, {wave:.4f} px by interpolation"
    return text


def _write(
    out: Path,
    stem: str,
    image: GreyImage,
    found: Correlation,
    ready: Prepared,
    study: DicStudy,
    time: float | None,
    again: bool,
) -> bool:
    """What is in mm follows from more than the measurement and is written each time; pictures,
    which are in px, where they are missing or were measured now (`again`). Returns False where a
    strain was wanted and there is none at any point."""
    length = correlation_length(ready.settings) * study.scale.mm_per_px
    frame = replace(
        point_frame(stem, ready.points, found, study.scale, ready.grid, time),
        correlation_length=length,
    )
    write_points(out / POINTS / f"{stem}.csv", frame)
    overall, lost = (out / PICTURES / f"{stem}{end}.png" for end in ("", "-lost"))
    if again or not overall.exists():
        save_png(overlay(image, ready.points, found), overall)
    if again or not lost.exists():
        save_png(lost_points(ready.reference, ready.points, found), lost)
    strained = out / f"{stem}-strain.csv"
    if study.strain is None:
        strained.unlink(missing_ok=True)  # of a study that wanted it
        return True
    return _write_strain(strained, found, ready.points, study)


def _write_strain(path: Path, found: Correlation, points: Array, study: DicStudy) -> bool:
    """Strains with y up: of a tensor, xy changes its sign with the axis. Whether there is any."""
    assert study.strain is not None
    options = study.strain
    result = strain(points, found.displacement, options.radius_px, options.order, options.measure)
    columns = np.column_stack([points, result.xx, result.yy, -result.xy])
    head = f"x_px,y_px,{options.measure}_xx,{options.measure}_yy,{options.measure}_xy"
    with replacing(path) as temporary:
        np.savetxt(temporary, columns, delimiter=",", header=head, comments="", fmt="%.9g")
    return bool(np.isfinite(result.xx).any())


def _report(out: Path, study: DicStudy, ready: Prepared, frames: list[dict[str, Any]]) -> None:
    content = {
        "reference": ready.reference.name,
        "quality": finite(ready.judged),
        "correlation": asdict(study.correlation),
        "reasons": {reason.name.lower(): reason.text for reason in Reason},
        "frames": frames,
    }
    write_text(out / "dic.json", json.dumps(content, indent=1) + "\n")
