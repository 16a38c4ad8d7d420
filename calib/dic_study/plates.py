"""From a study's images of a plate to a calibration, or from its file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from calib.dic.calibration import LEAST_POSES, Calibration, calibrate
from calib.dic.calibration_files import read_calibration, write_calibration
from calib.dic.chessboard import Chessboard, chessboard_view
from calib.dic.dot_grid import DotPlate, dot_view
from calib.dic.images import GreyImage, check_sizes, read_image
from calib.dic.plate_view import LEAST_POINTS, PlateView
from calib.dic_study.named_files import named_files, number_doubt
from calib.dic_study.stereo_config import Plates, StereoStudy
from calib.toml_file import Contradiction

Say = Callable[[str], None]
VERSION = 1
"""of what makes a calibration from images"""
KEPT = "plates-{}.json"
SAME_POSE = 1.0
"""px RMS between two poses in each camera, below which they are one"""


def calibration_of(study: StereoStudy, folder: Path, store: Path, say: Say) -> Calibration:
    """The calibration that a study names or whose plates it names.

    One from plates is kept in the folder `store`, and is not made again from the same images with
    the same settings. Raises ValueError when the file is none, or the plates do not do.
    """
    if study.calibration is None:
        assert study.stereo.calibration is not None
        found = read_calibration(folder / study.stereo.calibration)
    else:
        found, again = _of_plates(study.calibration, folder, store, say)
        done = "measured" if again else "kept, the images and settings are those it was made from"
        say(
            f"calibration: {found.n_poses} poses, {found.n_points} points, reprojection "
            f"{found.rms:.4f} px RMS, epipolar distance {found.epipolar:.4f} px RMS ({done})"
        )
        if found.n_poses < LEAST_POSES:
            say(
                f"warning: a calibration from {found.n_poses} poses, expected {LEAST_POSES} or "
                "more; what that leaves open of all lengths is scale_sd in dic.json"
            )
    rig = found.rig
    say(f"rig: stereo angle {rig.angle:.2f} degrees, baseline {rig.baseline:.2f} mm")
    return found


def _of_plates(plates: Plates, folder: Path, store: Path, say: Say) -> tuple[Calibration, bool]:
    """The calibration of images of plates, and whether it was made now."""
    left, right = _pairs(plates, folder)
    if doubt := number_doubt(left, right):
        say(f"warning: {doubt}")
    kept = store / KEPT.format(_key(plates, [*left, *right]))
    try:
        return read_calibration(kept), False
    except ValueError:
        # not there, or not whole
        found = _calibrated(plates, left, right, say)
    store.mkdir(parents=True, exist_ok=True)
    for old in store.glob(KEPT.format("*")):
        old.unlink()
    write_calibration(kept, found)
    return found, True


def _key(plates: Plates, paths: Sequence[Path]) -> str:
    """Hash of the images' bytes, in their order, and of the settings."""
    settings = asdict(plates)
    del settings["left"], settings["right"]
    digest = hashlib.sha256(json.dumps([VERSION, settings], sort_keys=True).encode())
    for path in paths:
        # a folder or a missing file is refused where it is read as an image
        content = path.read_bytes() if path.is_file() else b""
        digest.update(hashlib.sha256(content).digest())
    return digest.hexdigest()[:32]


def _pairs(plates: Plates, folder: Path) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    left, right = (
        named_files(names, folder, f"calibration.{side}", set())
        for side, names in (("left", plates.left), ("right", plates.right))
    )
    if len(left) != len(right):
        raise Contradiction(
            "calibration.right", list(plates.right),
            f"{len(left)} files as calibration.left names, not {len(right)}",
        )  # fmt: skip
    return left, right


def _calibrated(
    plates: Plates, left: Sequence[Path], right: Sequence[Path], say: Say
) -> Calibration:
    views: list[tuple[PlateView, PlateView]] = []
    first = None
    for paths in zip(left, right, strict=True):
        images = tuple(read_image(path) for path in paths)
        first = first or images[0]
        check_sizes([first, *images])
        try:
            seen = (_view(images[0], plates), _view(images[1], plates))
        except ValueError as error:
            say(f"left out: {error}")
            continue
        twin = next((one[0].name for one in views if _is_same_pose(one, seen)), None)
        if twin is None:
            views.append(seen)
        else:
            say(f"left out: {seen[0].name}: the plate stands as in {twin}, expected another pose")
    if first is None or len(views) < plates.least_poses:
        fewer = f"= {len(views)} takes them" if len(views) >= 3 else "may be as low as 3"
        raise ValueError(
            f"calibration: found {len(views)} poses in {len(left)} pairs of images in which both "
            f"cameras see the plate, each pose counted once, expected {plates.least_poses} or more "
            f"(calibration.least_poses {fewer})"
        )
    size = (first.grey.shape[1], first.grey.shape[0])
    ours, theirs = ([pair[side] for pair in views] for side in (0, 1))
    try:
        return calibrate(ours, theirs, size, plates.settings)
    except ValueError as error:
        raise ValueError(f"calibration: {error}") from error


def _is_same_pose(one: tuple[PlateView, PlateView], other: tuple[PlateView, PlateView]) -> bool:
    """Whether both cameras see the plate where they saw it before."""
    return all(_shift(*views) < SAME_POSE for views in zip(one, other, strict=True))


def _shift(one: PlateView, other: PlateView) -> float:
    """RMS distance of the points that two views share, px; infinite where they share few."""
    at = {
        tuple(np.round(place, 6)): pixel
        for place, pixel in zip(one.places, one.pixels, strict=True)
    }
    off = [
        pixel - at[key]
        for place, pixel in zip(other.places, other.pixels, strict=True)
        if (key := tuple(np.round(place, 6))) in at
    ]
    return (
        float(np.sqrt(np.mean(np.sum(np.square(off), axis=1))))
        if len(off) >= LEAST_POINTS
        else np.inf
    )


def _view(image: GreyImage, plates: Plates) -> PlateView:
    if plates.plate == "dots":
        plate = DotPlate(plates.spacing_mm, plates.to_x_marker, plates.to_y_marker)
        return dot_view(image.grey, plate, image.name)
    board = Chessboard(plates.columns, plates.rows, plates.spacing_mm)
    return chessboard_view(image.grey, board, image.name)
