"""DuoDIC `.mat` (SolavLab): points followed through all images, pairs or reconstructed.

`DIC3DPPresults`, `DIC3Dcombined`, `DIC3DpairResults`: `Points3D`, a cell of (n, 3) positions in
mm, the first image being the reference.  `DIC2DpairResults`: `Points`, a cell of (n, 2) pixel
positions, all images of the first camera and then all of the second; read as a planar
measurement of the first camera, which needs mm_per_px.
"""

from __future__ import annotations

import numpy as np

from calib.data.readers.frames import DicSeries, PointFrame, masked_frame
from calib.data.readers.mat_values import as_list, as_matrix, as_number, field
from calib.data.readers.matlab5 import Value
from calib.data.readers.matlab_file import read_variable, variable_names
from calib.data.readers.point_table import UPWARDS
from calib.data.readers.source import Source
from calib.data.readers.units import LARGEST, scaled
from calib.data.readers.wrong_file import WrongFile
from fe.response import Array

NAME = "DuoDIC mat"
PAIR = "DIC2DpairResults"
STEREO = ("DIC3DPPresults", "DIC3Dcombined", "DIC3DpairResults")
MAX_FRAMES = 5_000
ONE_CAMERA = "the first camera of a pair that is not yet reconstructed is read as planar"


def recognises(source: Source) -> bool:
    """Whether this is a MATLAB file with a variable of DuoDIC."""
    return not variable_names(source).isdisjoint({PAIR, *STEREO})


def read(source: Source, mm_per_px: float | None = None) -> DicSeries:
    """All frames; raises WrongFile for anything else, and for a pair without mm_per_px."""
    names = variable_names(source)
    stereo = next((name for name in STEREO if name in names), None)
    if stereo is not None:
        data = read_variable(source, stereo, {"Points3D"})
        points = _points(source, "Points3D", as_list(field(source.path, data, "Points3D")), 3)
        return DicSeries(NAME, _frames(source, points, is_planar=False))
    return _first_camera(source, read_variable(source, PAIR, {"Points", "nImages"}), mm_per_px)


def _first_camera(source: Source, data: Value, mm_per_px: float | None) -> DicSeries:
    path = source.path
    points = as_list(field(path, data, "Points"))
    n = as_number(path, "nImages", field(path, data, "nImages"))
    if len(points) != 2 * n:
        expected = f"Points of two cameras, {2 * n:g} arrays as nImages says"
        raise WrongFile(path, None, expected, f"{len(points)}")
    if mm_per_px is None:
        raise WrongFile(path, None, "mm_per_px to be given for Points, in pixels", "none")
    pixels = _points(source, "Points", points[: int(n)], 2)
    flat = [scaled(np.column_stack([p, np.zeros(len(p))]), mm_per_px) * UPWARDS for p in pixels]
    return DicSeries(NAME, _frames(source, flat, is_planar=True), (ONE_CAMERA,))


def _points(source: Source, name: str, arrays: list[Value], columns: int) -> list[Array]:
    """Positions image by image, of the same points."""
    path = source.path
    if not 0 < len(arrays) <= MAX_FRAMES:
        raise WrongFile(path, None, f"1 to {MAX_FRAMES:,} images in {name}", f"{len(arrays):,}")
    points = [as_matrix(path, name, array, columns) for array in arrays]
    points = [np.where(np.isfinite(array), array, np.nan) for array in points]
    for array in points:
        if array.shape != points[0].shape:
            found = f"{array.shape[0]}"
            raise WrongFile(path, None, f"{len(points[0])} points in all of {name}", found)
        if np.any(np.abs(array) > LARGEST["length"]):
            raise WrongFile(path, None, f"{name} below {LARGEST['length']:g}", "a larger one")
    return points


def _frames(source: Source, points: list[Array], is_planar: bool) -> tuple[PointFrame, ...]:
    return tuple(
        masked_frame(
            f"{source.path.stem} frame {index}", points[0], current - points[0], is_planar=is_planar
        )
        for index, current in enumerate(points)
    )
