"""DaVis csv: `x [mm];y [mm];z [mm];X-displacement [mm];...`, one file a frame (LaVision DaVis 10).

Positions are those of the reference frame: `Height [mm]` of the same file is z plus its
displacement, and the points of two real frames agree in x, y and z.  The set of points differs
from frame to frame.
"""

from __future__ import annotations

from calib.data.readers.frames import DicSeries
from calib.data.readers.header import Column, Names, names_in, separator_of
from calib.data.readers.number_table import Layout, cells
from calib.data.readers.point_table import PointColumns, PointFormat, read_point_frame
from calib.data.readers.source import Source

NAME = "DaVis csv"


def recognises(source: Source) -> bool:
    """Whether the first line names x, y and their displacements as DaVis does."""
    head = source.first(1)
    return bool(head) and {"x", "y", "x-displacement", "y-displacement"} <= names_in(
        head[0], separator_of(head[0])
    )


def read(source: Source, mm_per_px: float | None = None) -> DicSeries:
    """One frame; lengths from the header's units to mm.

    Raises WrongFile for anything else than a DaVis csv.
    """
    separator = separator_of(source.lines[0])
    layout = Layout(1, separator, cells(source.lines[0], separator))
    columns = davis_columns(Names(source, 1, layout.header))
    return DicSeries(NAME, (read_point_frame(source, layout, columns, PointFormat()),))


def davis_columns(names: Names) -> PointColumns:
    """Columns of a DaVis export, stereo or planar; shared with the Tecplot form.

    Raises WrongFile where one is missing.
    """
    stereo = names.get("z") is not None or _displacement(names, "z") is not None
    axes = "xyz" if stereo else "xy"
    position = tuple(names.need(axis) for axis in axes)
    displacement = tuple(
        _displacement(names, axis) or names.need(f"{axis}-displacement") for axis in axes
    )
    stated = tuple(names.get(f"Uncertainty V{axis}") for axis in axes)
    sigma = tuple(column for column in stated if column is not None)
    flag = names.get("isValid")
    return PointColumns(
        position,
        displacement,
        flags=() if flag is None else (flag,),
        flag_at_least=0.5,
        sigma=sigma if len(sigma) == len(axes) else (),
    )


def _displacement(names: Names, axis: str) -> Column | None:
    return names.get(f"{axis}-displacement", f"displacement {axis}")
