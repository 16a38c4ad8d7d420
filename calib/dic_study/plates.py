"""From a study's images of a plate to a calibration, or from its file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from calib.dic.calibration import Calibration, calibrate
from calib.dic.calibration_files import read_calibration
from calib.dic.chessboard import Chessboard, chessboard_view
from calib.dic.dot_grid import DotPlate, dot_view
from calib.dic.images import GreyImage, check_sizes, read_image
from calib.dic.plate_view import PlateView
from calib.dic_study.named_files import named_files
from calib.dic_study.stereo_config import Plates, StereoStudy
from calib.toml_file import Contradiction

Say = Callable[[str], None]


def calibration_of(study: StereoStudy, folder: Path, say: Say) -> Calibration:
    """The calibration that a study names or whose plates it names.

    Raises ValueError when the file is none, or the plates do not do.
    """
    if study.calibration is None:
        assert study.stereo.calibration is not None
        found = read_calibration(folder / study.stereo.calibration)
    else:
        found = _calibrated(study.calibration, folder, say)
        say(
            f"calibration: {found.n_poses} poses, {found.n_points} points, reprojection "
            f"{found.rms:.4f} px RMS, epipolar distance {found.epipolar:.4f} px RMS"
        )
    rig = found.rig
    say(f"rig: stereo angle {rig.angle:.2f} degrees, baseline {rig.baseline:.2f} mm")
    return found


def _calibrated(plates: Plates, folder: Path, say: Say) -> Calibration:
    left, right = (
        named_files(names, folder, f"calibration.{side}", set())
        for side, names in (("left", plates.left), ("right", plates.right))
    )
    if len(left) != len(right):
        raise Contradiction(
            "calibration.right", list(plates.right),
            f"{len(left)} files as calibration.left names, not {len(right)}",
        )  # fmt: skip
    views, first = [], None
    for paths in zip(left, right, strict=True):
        images = tuple(read_image(path) for path in paths)
        first = first or images[0]
        check_sizes([first, *images])
        try:
            views.append(tuple(_view(image, plates) for image in images))
        except ValueError as error:
            say(f"left out: {error}")
    if first is None or len(views) < plates.least_poses:
        raise ValueError(
            f"calibration: found {len(views)} poses in {len(left)} pairs of images in which both "
            f"cameras see the plate, expected {plates.least_poses} or more "
            "(calibration.least_poses may be as low as 3)"
        )
    size = (first.grey.shape[1], first.grey.shape[0])
    ours, theirs = ([pair[side] for pair in views] for side in (0, 1))
    try:
        return calibrate(ours, theirs, size, plates.settings)
    except ValueError as error:
        raise ValueError(f"calibration: {error}") from error


def _view(image: GreyImage, plates: Plates) -> PlateView:
    if plates.plate == "dots":
        plate = DotPlate(plates.spacing_mm, plates.to_x_marker, plates.to_y_marker)
        return dot_view(image.grey, plate, image.name)
    board = Chessboard(plates.columns, plates.rows, plates.spacing_mm)
    return chessboard_view(image.grey, board, image.name)
