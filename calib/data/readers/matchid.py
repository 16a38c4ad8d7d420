"""MatchID stereo csv of two generations, one file a frame.

2023: `x_pic,y_pic,x,y,z,u,v,w,...` without units; 2024: `coor.X [mm]`, `disp.Horizontal
Displacement U [mm]`, ...  Positions are those of the **deformed** state: in the real files a
point's x grows by its u from frame to frame.  The reference position is therefore x - u.
`ext.Force [N]` of 2024 is not read: in the real files it repeats the voltage.
"""

from __future__ import annotations

from calib.data.readers.frames import DicSeries
from calib.data.readers.header import Names, names_in
from calib.data.readers.number_table import Layout, cells
from calib.data.readers.point_table import (
    Lengths,
    PointColumns,
    PointFormat,
    read_point_frame,
)
from calib.data.readers.source import Source

NAME_2023 = "MatchID 2023 csv"
NAME_2024 = "MatchID 2024 csv"
_NAMES_2023 = {"x_pic", "y_pic", "x", "y", "z", "u", "v", "w"}
_POSITION_2024 = ("coor.X", "coor.Y", "coor.Z")
_DISPLACEMENT_2024 = (
    "disp.Horizontal Displacement U",
    "disp.Vertical Displacement V",
    "disp.Out-Of-Plane: W",
)
DEFORMED = "positions are those of the deformed state; x - u is taken as the reference"
NO_UNITS = "the header has no units; mm is taken"
VOLTS = "ext.Force [N] is not read, as it may repeat the voltage; take force from the load file"


def recognises_2023(source: Source) -> bool:
    """Whether the first line has x_pic, x and u, as the 2023 generation."""
    head = source.first(1)
    return bool(head) and names_in(head[0], ",", fold=False) >= _NAMES_2023


def recognises_2024(source: Source) -> bool:
    """Whether the first line has coor.X and the long names of displacements."""
    head = source.first(1)
    return bool(head) and names_in(head[0], ",", fold=False) >= {
        *_POSITION_2024,
        *_DISPLACEMENT_2024,
    }


def read_2023(source: Source, mm_per_px: float | None = None) -> DicSeries:
    """One frame of the 2023 generation; raises WrongFile for anything else."""
    layout = Layout(1, ",", cells(source.lines[0], ","))
    names = Names(source, 1, layout.header, fold=False)
    columns = PointColumns(
        tuple(names.need(name) for name in "xyz"), tuple(names.need(name) for name in "uvw")
    )
    form = PointFormat(Lengths(default="mm"), is_deformed=True)
    frame = read_point_frame(source, layout, columns, form)
    return DicSeries(NAME_2023, (frame,), (DEFORMED, NO_UNITS))


def read_2024(source: Source, mm_per_px: float | None = None) -> DicSeries:
    """One frame of the 2024 generation with its time; raises WrongFile for anything else."""
    layout = Layout(1, ",", cells(source.lines[0], ","))
    names = Names(source, 1, layout.header)
    columns = PointColumns(
        tuple(names.need(name) for name in _POSITION_2024),
        tuple(names.need(name) for name in _DISPLACEMENT_2024),
        time=names.get("ext.Time"),
    )
    frame = read_point_frame(source, layout, columns, PointFormat(is_deformed=True))
    notes = (DEFORMED, VOLTS) if names.get("ext.Force") else (DEFORMED,)
    return DicSeries(NAME_2024, (frame,), notes)
