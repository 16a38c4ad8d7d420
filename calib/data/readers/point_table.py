"""From the columns of one text file to a frame: what the formats of DIC programs share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.data.readers.frames import BoolArray, PointFrame, masked_frame
from calib.data.readers.header import Column
from calib.data.readers.number_table import Layout, NumberTable, read_numbers
from calib.data.readers.source import Source
from calib.data.readers.units import LARGEST, factor, scaled
from calib.data.readers.wrong_file import WrongFile
from fe.response import Array

UPWARDS = np.array([1.0, -1.0, 1.0])
"""turns image rows, which count downwards, into a height"""


@dataclass(frozen=True)
class PointColumns:
    """Which columns hold what; two positions and displacements are a planar measurement."""

    position: tuple[Column, ...]
    displacement: tuple[Column, ...]
    flags: tuple[Column, ...] = ()
    """a point is measured where all are at least `flag_at_least`"""
    flag_at_least: float = 0.0
    sigma: tuple[Column, ...] = ()
    """of each displacement, or one for all"""
    time: Column | None = None
    """s; the same in all rows"""

    @property
    def all(self) -> tuple[Column, ...]:
        """Every column to be read, in the order of the values."""
        time = () if self.time is None else (self.time,)
        return (*self.position, *self.displacement, *self.sigma, *self.flags, *time)


@dataclass(frozen=True)
class Lengths:
    """What brings lengths of a file to mm."""

    default: str | None = None
    """unit of columns without one, None where they need it"""
    mm_per_px: float | None = None
    """for columns in px"""

    def factor(self, source: Source, line: int, column: Column) -> float:
        """Factor from the column's unit to mm; raises WrongFile where it is none of length."""
        unit = column.unit if column.unit is not None else self.default
        if unit is not None and unit.lower() in ("px", "pixel", "pixels"):
            if self.mm_per_px is None:
                expected = f"mm_per_px to be given for column {column.text!r}, which is in pixels"
                raise WrongFile(source.path, line, expected, "none")
            return self.mm_per_px
        return factor(source.path, line, column.text, "length", unit)


@dataclass(frozen=True)
class PointFormat:
    """How the columns of one program become reference positions and displacements."""

    lengths: Lengths = Lengths()
    is_deformed: bool = False
    """whether positions are those of the deformed state, as MatchID writes them"""
    rows_point_down: bool = False
    """whether y counts image rows"""
    grid_shape: tuple[int, int] | None = None
    time: float | None = None


def read_point_frame(
    source: Source, layout: Layout, columns: PointColumns, form: PointFormat
) -> PointFrame:
    """The frame of a text file with one line a point.

    Raises WrongFile as `read_numbers`, and for wrong units and impossible lengths.
    """
    table = read_numbers(source, layout, [column.index for column in columns.all])
    if form.grid_shape is not None and len(table.lines) != np.prod(form.grid_shape):
        rows, cols = form.grid_shape
        expected = f"{rows} x {cols} lines of points as the header says"
        raise WrongFile(source.path, len(source.lines), expected, f"{len(table.lines)}")
    return frame_of(source, table, layout.start, columns, form)


def frame_of(
    source: Source, table: NumberTable, line: int, columns: PointColumns, form: PointFormat
) -> PointFrame:
    """The frame of a table already read; `line` is that of the header."""
    n_axes = len(columns.position)
    position = _lengths(source, table, line, columns.position, 0, form)
    displacement = _lengths(source, table, line, columns.displacement, n_axes, form)
    if form.is_deformed:
        position = position - displacement
    if form.rows_point_down:
        position, displacement = position * UPWARDS, displacement * UPWARDS
    next_column = 2 * n_axes
    sigma = None
    if columns.sigma:
        sigma = _lengths(source, table, line, columns.sigma, next_column, form)
        next_column += len(columns.sigma)
    measured: BoolArray | None = None
    if columns.flags:
        flags = table.values[:, next_column : next_column + len(columns.flags)]
        measured = np.all(flags >= columns.flag_at_least, axis=1)
        next_column += len(columns.flags)
    time = form.time
    if columns.time is not None:
        time = _time(source, table, line, columns.time, next_column)
    return masked_frame(
        source.path.stem,
        position,
        displacement,
        measured,
        sigma,
        time,
        form.grid_shape,
        n_axes == 2,
    )


def _lengths(
    source: Source,
    table: NumberTable,
    line: int,
    columns: tuple[Column, ...],
    first: int,
    form: PointFormat,
) -> Array:
    """(n, 3) mm; one column stands for all axes, two leave z zero."""
    values = np.zeros((len(table.lines), 3))
    for axis, column in enumerate(columns):
        by = form.lengths.factor(source, line, column)
        values[:, axis] = scaled(table.values[:, first + axis], by)
        read = np.isfinite(table.values[:, first + axis])  # else a hole, which masks the point
        too_large = read & (np.abs(values[:, axis]) > LARGEST["length"])
        if too_large.any():
            row = int(np.argmax(too_large))
            expected = f"at most {LARGEST['length']:g} mm in column {column.text!r}"
            raise WrongFile(source.path, table.line(row), expected, f"{values[row, axis]:g}")
    if len(columns) == 1:
        values[:] = values[:, :1]
    return values


def _time(
    source: Source, table: NumberTable, line: int, column: Column, index: int
) -> float | None:
    values = scaled(
        table.values[:, index], factor(source.path, line, column.text, "time", column.unit)
    )
    time = float(values[0])
    differs = values != time
    if not np.isfinite(time) or differs.any():
        row = int(np.argmax(differs)) if np.isfinite(time) else 0
        expected = f"one finite time in column {column.text!r}"
        raise WrongFile(source.path, table.line(row), expected, f"{values[row]:g}")
    return time
