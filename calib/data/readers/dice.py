"""DICe text (Sandia): comment lines `***`, or none, then names in capitals; commas or blanks.

One file a frame with one line a subset, or, where the first column is FRAME, one file a subset
with one line a frame.  SIGMA in px and MATCH are -1 where the subset failed.  Results in pixels
need mm_per_px; rows of the image count downwards and are turned upwards.  MODEL_COORDINATES and
MODEL_DISPLACEMENT of a stereo run are in the unit of the calibration, taken as mm.
"""

from __future__ import annotations

from dataclasses import replace

from calib.data.readers.frames import DicSeries, PointFrame
from calib.data.readers.header import Column, Names
from calib.data.readers.number_table import Layout, NumberTable, cells, read_numbers
from calib.data.readers.point_table import (
    Lengths,
    PointColumns,
    PointFormat,
    frame_of,
)
from calib.data.readers.source import Source
from calib.data.readers.wrong_file import WrongFile

NAME = "DICe text"
MAX_COMMENTS = 60
MAX_FRAMES = 20_000
ONE_CAMERA = "positions and displacements are those of one camera's image"
MODEL_UNIT = "MODEL columns are in the unit of the calibration; mm is taken"


def recognises(source: Source) -> bool:
    """Whether the header names COORDINATE_X and DISPLACEMENT_X."""
    return _header_line(source) is not None


def _header_line(source: Source) -> int | None:
    """The first line that is no comment, if it is a header of DICe."""
    for index, line in enumerate(source.first(MAX_COMMENTS)):
        if not line.startswith("***"):
            header = set(cells(line, "," if "," in line else None))
            is_header = {"COORDINATE_X", "COORDINATE_Y", "DISPLACEMENT_X"} <= header
            return index if is_header else None
    return None


def read(source: Source, mm_per_px: float | None = None) -> DicSeries:
    """One frame, or as many as a subset has lines.

    Raises WrongFile for anything else than a DICe result, and for pixels without mm_per_px.
    """
    index = _header_line(source) or 0
    separator = "," if "," in source.lines[index] else None
    layout = Layout(index + 1, separator, cells(source.lines[index], separator))
    names = Names(source, index + 1, layout.header)
    has_model = names.get("MODEL_DISPLACEMENT_X") is not None
    columns = _columns(names, has_model)
    lengths = Lengths("mm" if has_model else "px", mm_per_px)
    form = PointFormat(lengths, rows_point_down=not has_model)
    table = read_numbers(source, layout, [column.index for column in columns.all])
    frames: tuple[PointFrame, ...]
    if names.get("FRAME") is None:
        frames = (frame_of(source, table, index + 1, columns, form),)
    else:
        frames = _frames_of_subset(source, table, index + 1, columns, form)
    return DicSeries(NAME, frames, (MODEL_UNIT,) if has_model else (ONE_CAMERA,))


def _columns(names: Names, has_model: bool) -> PointColumns:
    if has_model:
        position = tuple(names.need(f"MODEL_COORDINATES_{axis}") for axis in "XYZ")
        displacement = tuple(names.need(f"MODEL_DISPLACEMENT_{axis}") for axis in "XYZ")
    else:
        position = tuple(names.need(f"COORDINATE_{axis}") for axis in "XY")
        displacement = tuple(names.need(f"DISPLACEMENT_{axis}") for axis in "XY")
    deviation = names.get("SIGMA")
    sigma: tuple[Column, ...] = ()
    if deviation is not None and not has_model:
        sigma = (deviation,)
    # either is -1 where a subset failed
    flags = tuple(flag for flag in (names.get("MATCH"), deviation) if flag is not None)
    return PointColumns(position, displacement, flags, 0.0, sigma)


def _frames_of_subset(
    source: Source, table: NumberTable, line: int, columns: PointColumns, form: PointFormat
) -> tuple[PointFrame, ...]:
    """One frame a line, each with the one point."""
    n = len(table.lines)
    if n > MAX_FRAMES:
        raise WrongFile(source.path, line, f"at most {MAX_FRAMES:,} frames", f"{n:,}")
    frames = []
    for row in range(n):
        one = NumberTable(table.path, table.values[row : row + 1], table.lines[row : row + 1])
        frame = frame_of(source, one, line, columns, form)
        frames.append(replace(frame, name=f"{frame.name} frame {row}"))
    return tuple(frames)
