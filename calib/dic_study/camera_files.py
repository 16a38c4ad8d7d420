"""Images that are said to be of two cameras: that they are, and of the right one each."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.dic import GreyImage
from calib.dic.stereo import StereoReference, Tracked, median_distance, usual_distance
from calib.dic_study.named_files import check_series, named_files
from calib.dic_study.stereo_config import StereoStudy
from calib.toml_file import Contradiction

FARTHER = 5.0
"""times the distance of points from their epipolar lines in the reference images"""
LEAST_FAR = 0.1
"""px that are never told: noise and the shape functions of a deformed face take points off"""


def pairs(study: StereoStudy, folder: Path) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """Deformed images of the left and the right camera in their order, by the files in `folder`.

    Raises Contradiction for other numbers of them, names that results cannot bear, and files that
    are named for both cameras.
    """
    images, stereo = study.images, study.stereo
    leave = {images.reference, stereo.right_reference, images.repeat}
    left = named_files(images.deformed, folder, "images.deformed", leave)
    right = named_files(stereo.right_deformed, folder, "stereo.right_deformed", leave)
    if len(left) != len(right):
        raise Contradiction(
            "stereo.right_deformed", list(stereo.right_deformed),
            f"{len(left)} files as images.deformed names, not {len(right)}",
        )  # fmt: skip
    check_series("images.deformed", left, images.times_s)
    first = Path(images.reference).stem
    if first in {path.stem for path in left}:
        expected = "other names than the reference's (without its ending): results bear them"
        raise Contradiction("images.deformed", first, expected)
    of_left = {path.resolve() for path in (folder / images.reference, *left)}
    for key, paths in (
        ("stereo.right_reference", (folder / stereo.right_reference,)),
        ("stereo.right_deformed", right),
    ):
        for path in paths:
            if path.resolve() in of_left:
                raise Contradiction(key, path.name, "an image of the right camera alone")
    return left, right


def check_two_views(left: GreyImage, right: GreyImage) -> None:
    """Raises ValueError for one picture under two names."""
    if np.array_equal(left.grey, right.grey) and np.ptp(left.grey) > 0.0:  # else none shows a thing
        raise ValueError(
            f"{right.name}: found the very picture of {left.name}, expected one of each camera"
        )


def view_doubt(
    reference: StereoReference,
    tracked: Tracked,
    limit: float,
    left: GreyImage,
    right: GreyImage,
) -> str | None:
    """Why the pair of images followed to is doubtful: points farther from their lines than `limit`.

    In px, in the median, or than several times what they were in the reference images; None where
    it is not. Raises ValueError when the two are swapped.
    """
    subject = f"{left.name}, {right.name}: the images"
    distance = median_distance(reference, tracked, subject)
    most = min(limit, max(FARTHER * usual_distance(reference), LEAST_FAR))
    if distance <= most or not np.isfinite(distance):
        return None
    return (
        f"{left.name}, {right.name}: points lie {distance:.2g} px from their epipolar lines, "
        f"expected below {most:.2g}; the images are of other cameras or moments, or the cameras "
        "have moved since the reference images"
    )
