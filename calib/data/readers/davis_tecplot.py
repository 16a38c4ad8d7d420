"""DaVis Tecplot `.dat`: TITLE, VARIABLES, ZONE and STRANDID lines, then one line a point.

The thesis' DIC files are of this kind (its section 4.3.1: initial positions and displacements).
Points hidden or outside the sample stay in the I x J grid, with `isValid` 0 or as false zeros.
"""

from __future__ import annotations

import re

from calib.data.readers.davis_csv import davis_columns
from calib.data.readers.frames import DicSeries
from calib.data.readers.header import Names
from calib.data.readers.number_table import Layout
from calib.data.readers.point_table import PointFormat, read_point_frame
from calib.data.readers.source import Source
from calib.data.readers.wrong_file import WrongFile, shown

NAME = "DaVis Tecplot"
MAX_HEADER_LINES = 10
_SETTING = re.compile(r'\b([A-Z]+)\s*=\s*("[^"]*"|[^\s,]+)', re.IGNORECASE)


def recognises(source: Source) -> bool:
    """Whether the file begins with TITLE and VARIABLES and has a displacement among them."""
    head = source.first(MAX_HEADER_LINES)
    starts = [line.lstrip().upper() for line in head]
    return any(line.startswith("TITLE") for line in starts[:1]) and any(
        line.startswith("VARIABLES") and "DISPLACEMENT" in line for line in starts
    )


def read(source: Source, mm_per_px: float | None = None) -> DicSeries:
    """One frame with the shape of its grid and its SOLUTIONTIME, if stated.

    Raises WrongFile for anything else than one zone of points.
    """
    head = _header_lines(source)
    line = next((i for i, t in enumerate(head) if t.lstrip().upper().startswith("VARIABLES")), 0)
    header = re.findall(r'"([^"]*)"', head[line]) if line else []
    if not header:
        raise WrongFile(source.path, line + 1, 'names as VARIABLES = "x [mm]", ...', "none")
    settings = {
        key.upper(): value.strip('"') for text in head for key, value in _SETTING.findall(text)
    }
    packing = settings.get("DATAPACKING", settings.get("F", "POINT")).upper()
    if packing != "POINT":
        raise WrongFile(source.path, len(head), "F=POINT, one line a point", shown(packing))
    columns = davis_columns(Names(source, line + 1, header))
    form = PointFormat(grid_shape=_grid(source, len(head), settings), time=_time(source, settings))
    layout = Layout(len(head), None, header)
    return DicSeries(NAME, (read_point_frame(source, layout, columns, form),))


def _header_lines(source: Source) -> list[str]:
    """Lines before the first that begins with a number, or with one that was not measured."""
    head = source.first(MAX_HEADER_LINES)
    for n, text in enumerate(head):
        if re.match(r"\s*[+-]?(\.?\d|nan\b)", text, re.IGNORECASE):
            return head[:n]
    raise WrongFile(
        source.path, len(head), f"numbers within {MAX_HEADER_LINES} lines", "header lines only"
    )


def _grid(source: Source, line: int, settings: dict[str, str]) -> tuple[int, int]:
    """(J, I): I runs fastest; K may only be 1."""
    shape = []
    for key in ("I", "J", "K"):
        text = settings.get(key, "1" if key != "I" else "")
        if not re.fullmatch(r"\d{1,9}", text, re.ASCII):
            raise WrongFile(source.path, line, f"a whole number {key}= in ZONE", shown(text))
        shape.append(int(text))
    if shape[2] != 1:
        raise WrongFile(source.path, line, "K=1, one layer of points", f"K={shape[2]}")
    return shape[1], shape[0]


def _time(source: Source, settings: dict[str, str]) -> float | None:
    """SOLUTIONTIME, s."""
    text = settings.get("SOLUTIONTIME")
    if text is None:
        return None
    if not re.fullmatch(r"[+-]?\d{1,15}(\.\d{0,15})?([eE][+-]?\d{1,2})?", text, re.ASCII):
        raise WrongFile(source.path, None, "a number after SOLUTIONTIME=", shown(text))
    return float(text)
