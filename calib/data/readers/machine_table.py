"""From the columns of a text file to a machine record: what the formats of machines share."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calib.data.readers.header import Column
from calib.data.readers.machine_record import Direction, MachineRecord
from calib.data.readers.number_table import Layout, NumberTable, number, read_numbers
from calib.data.readers.source import Source
from calib.data.readers.units import LARGEST, TARGET, factor, scaled
from calib.data.readers.wrong_file import WrongFile, shown
from fe.response import Array

MAX_SAMPLES = 500_000
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(,\d{3})+\.\d+([eE][+-]?\d+)?", re.ASCII)


@dataclass(frozen=True)
class Channels:
    """Which columns of a machine's table hold what."""

    time: Column
    force: Column
    travel: Column | None = None
    frame: Column | None = None

    @property
    def all(self) -> tuple[Column, ...]:
        """The columns to be read, in the order of the values."""
        found = (self.time, self.force, self.travel, self.frame)
        return tuple(column for column in found if column is not None)


@dataclass(frozen=True)
class Said:
    """What a file says beside its numbers."""

    format: str
    positive: Direction = "unknown"
    metadata: Mapping[str, str] | None = None
    notes: tuple[str, ...] = ()
    time_unit: str | None = None
    """where the column of time names none"""


def read_record(
    source: Source, layout: Layout, line: int, channels: Channels, said: Said
) -> MachineRecord:
    """The record of a table whose header stands on `line`; values brought to s, mm and N.

    Raises WrongFile as `read_numbers`, for wrong units, and for values that are missing or
    impossible.
    """
    table = read_machine_numbers(source, layout, [column.index for column in channels.all])
    values = dict(zip(channels.all, table.values.T, strict=True))

    def in_unit(column: Column, kind: str) -> Array:
        unit = column.unit
        if kind == "time" and unit is None:
            unit = said.time_unit
        return scaled(values[column], factor(source.path, line, column.text, kind, unit))

    travel = None if channels.travel is None else in_unit(channels.travel, "length")
    origins = {"time": channels.time, "force": channels.force, "travel": channels.travel}
    return checked_record(
        table,
        MachineValues(
            in_unit(channels.time, "time"),
            in_unit(channels.force, "force"),
            travel,
            None if channels.frame is None else values[channels.frame],
        ),
        said,
        {key: _origin(column) for key, column in origins.items() if column is not None},
    )


def _origin(column: Column) -> str:
    return column.text if column.unit is None else f"{column.name} [{column.unit}]"


@dataclass(frozen=True)
class MachineValues:
    """Columns of a record, not yet checked."""

    time: Array
    """(n_sample,) s"""
    force: Array
    """(n_sample,) N"""
    travel: Array | None
    """(n_sample,) mm"""
    frame: Array | None
    """(n_sample,) number of the image"""


def checked_record(
    table: NumberTable, values: MachineValues, said: Said, channels: Mapping[str, str]
) -> MachineRecord:
    """The record, when all its values are possible.

    Raises WrongFile naming the line where a value is missing or beyond what can be measured, or
    where time runs backwards.
    """
    for name, kind in (("time", "time"), ("force", "force"), ("travel", "length")):
        column = getattr(values, name)
        if column is None:
            continue
        wrong = ~(np.abs(column) <= LARGEST[kind])
        if wrong.any():
            row = int(np.argmax(wrong))
            expected = f"a {name} of at most {LARGEST[kind]:g} {TARGET[kind][0]}"
            if np.isnan(column[row]):
                raise WrongFile(table.path, table.line(row), f"a number for the {name}", "none")
            raise WrongFile(table.path, table.line(row), expected, f"{column[row]:g}")
    back = np.diff(values.time) < 0
    if back.any():
        row = int(np.argmax(back)) + 1
        expected = f"a time of {values.time[row - 1]:g} s or later"
        raise WrongFile(table.path, table.line(row), expected, f"{values.time[row]:g} s")
    return MachineRecord(
        said.format,
        values.time,
        values.force,
        values.travel,
        said.positive,
        channels,
        dict(said.metadata or {}),
        values.frame,
        said.notes,
    )


def read_machine_numbers(source: Source, layout: Layout, columns: list[int]) -> NumberTable:
    """As `read_numbers`, and cells in quotes: with commas between the thousands, or decimal ones.

    The latter where no number has a point and cells are not separated by commas.
    """
    n = len(source.lines) - layout.start
    if n > MAX_SAMPLES:
        raise WrongFile(source.path, layout.start, f"at most {MAX_SAMPLES:,} samples", f"{n:,}")
    if not any('"' in line for line in source.lines[layout.start :]):
        return read_numbers(source, layout, columns)
    rows: list[list[str]] = []
    lines: list[int] = []
    width = len(layout.header)
    allowed = {width, width - 1} if layout.header[-1] == "" else {width}
    for index in range(layout.start, len(source.lines)):
        text = source.lines[index]
        if not text.strip():
            continue
        row = next(csv.reader([text], delimiter=layout.separator or ","))
        if len(row) not in allowed:
            raise WrongFile(source.path, index + 1, f"{width} values", f"{len(row)}")
        rows.append([row[c].strip() for c in columns])
        lines.append(index + 1)
    if not rows:
        raise WrongFile(source.path, len(source.lines), "lines of numbers", "the end of the file")
    with_points = layout.separator == "," or any("." in cell for row in rows for cell in row)
    names = [layout.header[c] for c in columns]
    values = [
        [
            _quoted(source, line, name, cell if with_points else cell.replace(",", "."))
            for name, cell in zip(names, row, strict=True)
        ]
        for line, row in zip(lines, rows, strict=True)
    ]
    return NumberTable(source.path, np.array(values, dtype=np.float64), np.array(lines))


def _quoted(source: Source, line: int, name: str, text: str) -> float:
    if "," not in text:
        return number(source.path, line, name, text)
    if _THOUSANDS.fullmatch(text):
        return number(source.path, line, name, text.replace(",", ""))
    # 1,234 may be a thousand or a little more than one
    expected = f"thousands commas and a decimal point in column {shown(name)}"
    raise WrongFile(source.path, line, expected, shown(text))
