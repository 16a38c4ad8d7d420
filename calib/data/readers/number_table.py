"""Columns of numbers in text, read by numpy's parser; what it refuses is found cell by cell."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.data.readers.source import Source
from calib.data.readers.wrong_file import WrongFile, shown
from fe.response import Array, IntArray

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eEdD][+-]?\d+)?", re.ASCII)
_NOT_FINITE = re.compile(r"[+-]?(nan|inf(inity)?|1\.#(ind|qnan|inf)0*)", re.IGNORECASE | re.ASCII)
_ONE_MARK = "numbers with a decimal comma and no mark of thousands"
_ABSENT = {"", "n/a", "na", "nan", "-", "--"}


@dataclass(frozen=True)
class NumberTable:
    """Numbers of the columns asked for, and the line of each row for refusals."""

    path: Path
    values: Array
    """(n_row, n_column); NaN where a cell is empty or says so"""
    lines: IntArray
    """(n_row,) line numbers from 1"""

    def line(self, row: int) -> int:
        """Line, from 1, that row came from."""
        return int(self.lines[row])


@dataclass(frozen=True)
class Layout:
    """How a table is written: where it begins and what separates its cells."""

    start: int
    """index of the first line of numbers"""
    separator: str | None
    """between cells; None for blanks"""
    header: list[str]
    """names of the columns, the last one empty when the line ends in a separator"""


def cells(line: str, separator: str | None) -> list[str]:
    """Cells of one line without quotes and blanks around them."""
    parts = line.split(separator) if separator else line.split()
    return [part.strip().strip('"').strip() for part in parts]


def read_numbers(source: Source, layout: Layout, columns: list[int]) -> NumberTable:
    """Numbers of some columns of all lines from `layout.start` on; empty lines are left out.

    Raises WrongFile for a line with more or fewer cells than the header, for a cell that is no
    number, for a comma that may mark decimals or thousands, and for a table without a line.
    """
    body = source.lines[layout.start :]
    lines = np.arange(layout.start + 1, layout.start + 1 + len(body))
    if not all(map(str.strip, body)):
        filled = [bool(line.strip()) for line in body]
        body = [line for line in body if line.strip()]
        lines = lines[filled]
    if not body:
        raise WrongFile(
            source.path, len(source.lines) or None, "lines of numbers", "the end of the file"
        )
    _check_widths(source.path, layout, body, lines)
    body = _with_points(source.path, layout, body, lines, columns)
    values = _numbers(source.path, layout, body, lines, columns)
    values[np.isinf(values)] = np.nan  # neither is a measurement
    return NumberTable(source.path, values, lines)


def _check_widths(path: Path, layout: Layout, body: list[str], lines: IntArray) -> None:
    """A line that lost or won a separator would shift its numbers into other columns."""
    n = len(layout.header)
    # where the header ends in a separator, the lines below may or may not
    allowed = {n, n - 1} if layout.header[-1] == "" else {n}
    separator = layout.separator
    if separator is None:
        widths = [len(line.split()) for line in body]
    else:
        widths = [line.count(separator) + 1 for line in body]
    if set(widths) <= allowed:
        return
    row = next(row for row, width in enumerate(widths) if width not in allowed)
    named = {None: "blanks", "\t": "tabs"}.get(separator, repr(separator))
    expected = f"{max(allowed)} values separated by {named} as in the header"
    raise WrongFile(path, int(lines[row]), expected, f"{widths[row]}")


def _with_points(
    path: Path, layout: Layout, body: list[str], lines: IntArray, columns: list[int]
) -> list[str]:
    """Decimal commas become points where the cells are not separated by commas.

    `columns` are those of numbers; where one of them has points too, its commas may be thousands'.
    """
    if layout.separator == "," or not any("," in line for line in body):
        return body
    commas: set[int] = set()
    points: dict[int, tuple[int, str]] = {}
    for row, line in enumerate(body):
        parts = cells(line, layout.separator)
        for column in columns:
            cell = parts[column] if column < len(parts) else ""
            if "," in cell:
                commas.add(column)
                if cell.count(",") > 1 or "." in cell:
                    raise WrongFile(path, int(lines[row]), _ONE_MARK, shown(cell))
            elif "." in cell and _NUMBER.fullmatch(cell):
                points.setdefault(column, (int(lines[row]), cell))
    if mixed := commas & points.keys():
        line_of, cell = points[min(mixed)]
        raise WrongFile(path, line_of, _ONE_MARK, shown(cell))
    return [line.replace(",", ".") for line in body] if commas else body


def _numbers(
    path: Path, layout: Layout, body: list[str], lines: IntArray, columns: list[int]
) -> Array:
    try:
        values = np.loadtxt(
            body, np.float64, delimiter=layout.separator, usecols=columns, comments=None, ndmin=2
        )
        if values.shape == (len(body), len(columns)):
            return values
    except (ValueError, IndexError):
        pass  # an empty cell, or one that has to be named
    values = np.empty((len(body), len(columns)))
    for row, line in enumerate(body):
        parts = cells(line, layout.separator)
        for column, index in enumerate(columns):
            name = layout.header[index]
            values[row, column] = number(path, int(lines[row]), name, parts[index])
    return values


def number(path: Path, line: int, name: str, cell: str) -> float:
    """Value of one cell; NaN where it is empty or says that it has none.

    Raises WrongFile where it is anything else than a number.
    """
    if _NUMBER.fullmatch(cell):
        return float(cell.lower().replace("d", "e"))
    if cell.lower() in _ABSENT or _NOT_FINITE.fullmatch(cell):
        return float("nan")
    raise WrongFile(path, line, f"a number in column {shown(name)}", shown(cell))
