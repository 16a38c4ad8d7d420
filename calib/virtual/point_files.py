"""Frames of points written as DIC programs write them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from calib.data.readers import PointFrame, write_points
from calib.virtual.laboratory_settings import PointFormat
from fe.response import Array

SYNTHETIC = "synthetic, made by softcal's virtual laboratory"
PX_PER_MM = 100.0
"""of the columns in pixels that these programs write beside those in mm"""


class PointWriter(NamedTuple):
    """How one program's files are written."""

    suffix: str
    """end of a file's name"""
    write: Callable[[Path, PointFrame], None]
    axes: tuple[str, str, str] = ("+x", "+y", "+z")
    """axes of the files that are our x (right), y (up), z (towards the cameras)"""


def write_frames(folder: Path, frames: tuple[PointFrame, ...], writer: PointWriter) -> None:
    """Write one file a frame into `folder`, turned into the program's axes."""
    folder.mkdir(parents=True)
    signs = np.array([1.0 if axis[0] == "+" else -1.0 for axis in writer.axes])
    for frame in frames:
        turned = replace(
            frame, position=frame.position * signs, displacement=frame.displacement * signs
        )
        writer.write(folder / f"{frame.name}{writer.suffix}", turned)


def _text(path: Path, head: list[str], row: str, values: Array, encoding: str = "utf-8") -> None:
    lines = [row % tuple(numbers) for numbers in values.tolist()]
    path.write_text("\n".join([*head, *lines]) + "\n", encoding=encoding)


def _zero_filled(frame: PointFrame) -> Array:
    """(n_point, 3) displacements with false zeros where nothing was found."""
    return np.where(frame.valid[:, None], frame.displacement, 0.0)


def _davis_csv(path: Path, frame: PointFrame) -> None:
    """Points that were not found are left out; the head has no room to say synthetic."""
    position, moved = frame.position[frame.valid], frame.displacement[frame.valid]
    names = ["x [mm]", "y [mm]", "z [mm]"]
    names += [f"{axis}-displacement [mm]" for axis in "XYZ"]
    names += ["Displacement [mm]", "Maximum shear angle [°]", "Height [mm]"]
    size = np.linalg.norm(moved, axis=1)
    values = np.column_stack(
        [position, moved, size, np.zeros_like(size), position[:, 2] + moved[:, 2]]
    )
    row = ";".join(["%.6f"] * 6 + ["%.6f", "%g", "%.6f"])
    _text(path, [";".join(names)], row, values, "latin-1")


def _davis_tecplot(path: Path, frame: PointFrame) -> None:
    """All points of the grid, with isValid and false zeros, as the thesis' files."""
    names = [f"{axis} [mm]" for axis in "xyz"]
    names += [f"{axis}-displacement [mm]" for axis in "XYZ"] + ["isValid"]
    quoted = ", ".join(f'"{name}"' for name in names)
    head = [
        f'TITLE = "{frame.name}, {SYNTHETIC}"',
        f"VARIABLES = {quoted}",
        f'ZONE T="Frame 0", I={frame.valid.size}, J=1, F=POINT',
        f"STRANDID=1, SOLUTIONTIME={frame.time:.3f}",
    ]
    values = np.column_stack([frame.position, _zero_filled(frame), frame.valid])
    _text(path, head, " ".join(["%.6f"] * 6 + ["%d"]), values)


def _image(position: Array) -> Array:
    return np.round(position[:, :2] * PX_PER_MM) + 1000.0


def _matchid_2023(path: Path, frame: PointFrame) -> None:
    """Deformed positions; points that were not found are left out; no room to say synthetic."""
    position, moved = frame.position[frame.valid], frame.displacement[frame.valid]
    values = np.hstack([_image(position), position + moved, moved])
    row = ",".join(["%d"] * 2 + ["%.5E"] * 6)
    _text(path, ["x_pic,y_pic,x,y,z,u,v,w"], row, values)


def _matchid_2024(path: Path, frame: PointFrame) -> None:
    """As 2023, with long names and the time."""
    position, moved = frame.position[frame.valid], frame.displacement[frame.valid]
    names = [
        "Coordinates.Image X [Pixel]", "Coordinates.Image Y [Pixel]",
        "coor.X [mm]", "coor.Y [mm]", "coor.Z [mm]",
        "disp.Horizontal Displacement U [mm]", "disp.Vertical Displacement V [mm]",
        "disp.Out-Of-Plane: W [mm]", "ext.Time [s]",
    ]  # fmt: skip
    time = np.full((len(position), 1), frame.time)
    values = np.hstack([_image(position), position + moved, moved, time])
    row = ",".join(["%d"] * 2 + ["%.5E"] * 7)
    _text(path, [",".join(names)], row, values)


def _vic_3d(path: Path, frame: PointFrame) -> None:
    """A title, then all points; sigma -1 and zeros where nothing was found."""
    sigma = np.where(frame.valid, 0.012, -1.0)
    values = np.column_stack([frame.position, _zero_filled(frame), sigma, _image(frame.position)])
    names = ["X", "Y", "Z", "U", "V", "W", "sigma", "x", "y"]
    head = [f'"{SYNTHETIC}"', ", ".join(f'"{name}"' for name in names)]
    _text(path, head, ", ".join(["%.6f"] * 7 + ["%d"] * 2), values)


def _dice(path: Path, frame: PointFrame) -> None:
    """Stereo results as MODEL columns; SIGMA and MATCH -1 and zeros where nothing was found."""
    names = [
        "SUBSET_ID", "COORDINATE_X", "COORDINATE_Y", "DISPLACEMENT_X", "DISPLACEMENT_Y",
        *(f"MODEL_COORDINATES_{axis}" for axis in "XYZ"),
        *(f"MODEL_DISPLACEMENT_{axis}" for axis in "XYZ"), "SIGMA", "MATCH",
    ]  # fmt: skip
    moved, failed = _zero_filled(frame), np.where(frame.valid, 0.0, -1.0)
    values = np.column_stack(
        [
            np.arange(frame.valid.size), _image(frame.position), moved[:, :2] * PX_PER_MM,
            frame.position, moved, np.where(frame.valid, 0.012, -1.0), failed,
        ]
    )  # fmt: skip
    head = ["***", "*** Digital Image Correlation Engine (DICe)", f"*** {SYNTHETIC}", "***"]
    row = ",".join(["%d"] * 3 + ["%.6E"] * 10)
    _text(path, [*head, ",".join(names)], row, values)


def _softcal(path: Path, frame: PointFrame) -> None:
    """Our own csv, without loss."""
    write_points(path, replace(frame, name=f"{frame.name}, {SYNTHETIC}"))


DOWN_AND_AWAY = ("+x", "-y", "-z")
"""of programs whose y counts down the image and whose z points into the scene"""
POINT_WRITERS: dict[PointFormat, PointWriter] = {
    "davis-csv": PointWriter(".csv", _davis_csv),
    "davis-tecplot": PointWriter(".dat", _davis_tecplot),
    "matchid-2023": PointWriter("_0.tif.csv", _matchid_2023, DOWN_AND_AWAY),
    "matchid-2024": PointWriter("_0.tiff.csv", _matchid_2024, DOWN_AND_AWAY),
    "vic-3d": PointWriter(".csv", _vic_3d),
    "dice": PointWriter(".txt", _dice),
    "softcal": PointWriter(".csv", _softcal),
}
