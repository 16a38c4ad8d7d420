"""VIC-3D csv (Correlated Solutions): `"X","Y","Z","U","V","W",...,"sigma"`, one file a frame.

Capital letters are positions and displacements in mm; small x, y, u, v are pixels of the left
image and are left out, so that case matters here.  `sigma` is the confidence of the match in px,
negative where it failed; such points come as zeros.  Exports in German separate by `;`, write
decimal commas and may begin with a line of title.
"""

from __future__ import annotations

from dataclasses import replace

from calib.data.readers.frames import DicSeries
from calib.data.readers.header import Names, names_in, separator_of
from calib.data.readers.number_table import Layout, cells
from calib.data.readers.point_table import (
    Lengths,
    PointColumns,
    PointFormat,
    read_point_frame,
)
from calib.data.readers.source import Source

NAME = "VIC-3D csv"
_NEEDED = {"X", "Y", "Z", "U", "V", "W"}
NO_UNITS = "the header has no units; mm is taken"
ONE_SIGMA = "sigma of the match in px times mm_per_px stands for all three displacements"
NO_SIGMA = "sigma is in px and goes into the mask only; give mm_per_px to keep it in mm"


def recognises(source: Source) -> bool:
    """Whether one of the first two lines names X, Y, Z, U, V and W."""
    return _header_line(source) is not None


def _header_line(source: Source) -> int | None:
    for index, line in enumerate(source.first(2)):
        if names_in(line, separator_of(line), fold=False) >= _NEEDED:
            return index
    return None


def read(source: Source, mm_per_px: float | None = None) -> DicSeries:
    """One frame; sigma in mm where mm_per_px is given or the file has sigma_X in mm.

    Raises WrongFile for anything else than a VIC-3D csv.
    """
    index = _header_line(source) or 0
    separator = separator_of(source.lines[index])
    layout = Layout(index + 1, separator, cells(source.lines[index], separator))
    names = Names(source, index + 1, layout.header, fold=False)
    position = tuple(names.need(name) for name in "XYZ")
    confidence = names.get("sigma", "Sigma")
    stated = tuple(names.get(f"sigma_{axis}") for axis in "XYZ")
    named = tuple(names.need(name) for name in "UVW")
    # a unit stands once: one without is that of the positions
    displacement, sigma = (
        tuple(
            replace(column, unit=column.unit or place.unit)
            for column, place in zip(columns, position, strict=True)
            if column is not None
        )
        for columns in (named, stated)
    )
    notes = () if position[0].unit is not None else (NO_UNITS,)
    if len(sigma) < 3:
        sigma = ()
        if confidence is not None and mm_per_px is not None:
            sigma = (replace(confidence, unit="px"),)
            notes = (*notes, ONE_SIGMA)
        elif confidence is not None:
            notes = (*notes, NO_SIGMA)
    flags = () if confidence is None else (confidence,)
    columns = PointColumns(position, displacement, flags, 0.0, sigma)
    form = PointFormat(Lengths("mm", mm_per_px))
    return DicSeries(NAME, (read_point_frame(source, layout, columns, form),), notes)
