"""Ncorr `.mat`: `data_dic_save` with `displacements(k).plot_u_ref_formatted` and `dispinfo`.

The fields lie on a grid of every (spacing + 1)-th pixel of the reference image; their unit is
`dispinfo.units`, `pixtounits` of them a pixel.  Outside the region of interest they are zero.
Rows count downwards and are turned upwards (J. Blaber, ncorr_2D_matlab, `ncorr.m`, callbacks dic
and formatdisp).  Results that were not formatted yet have no units and are refused.
"""

from __future__ import annotations

import numpy as np

from calib.data.readers.frames import DicSeries, PointFrame, masked_frame
from calib.data.readers.mat_values import as_list, as_matrix, as_number, field
from calib.data.readers.matlab5 import Value
from calib.data.readers.matlab_file import read_variable, variable_names
from calib.data.readers.point_table import UPWARDS
from calib.data.readers.source import Source
from calib.data.readers.units import LARGEST, LENGTH, scaled
from calib.data.readers.wrong_file import WrongFile, shown
from fe.response import Array

NAME = "Ncorr mat"
VARIABLE = "data_dic_save"
MAX_FRAMES = 5_000
_U, _V = "plot_u_ref_formatted", "plot_v_ref_formatted"
_FIELDS = {"displacements", "dispinfo", _U, _V, "pixtounits", "units", "spacing"}
ONE_CAMERA = "positions and displacements are those of one camera's image"


def recognises(source: Source) -> bool:
    """Whether this is a MATLAB file with the variable data_dic_save."""
    return VARIABLE in variable_names(source)


def read(source: Source, mm_per_px: float | None = None) -> DicSeries:
    """All frames of one analysis.

    Raises WrongFile for anything else, for units that are none of length, for pixels without
    mm_per_px, and where mm_per_px contradicts the file.
    """
    path = source.path
    data = read_variable(source, VARIABLE, _FIELDS)
    info = field(path, data, "dispinfo")
    step = as_number(path, "dispinfo.spacing", field(path, info, "spacing")) + 1
    if not (1 <= step <= 1000 and step == int(step)):
        raise WrongFile(path, None, "dispinfo.spacing as a whole number of pixels", f"{step - 1}")
    per_px, per_unit = _scales(source, info, mm_per_px)
    fields = _fields(source, field(path, data, "displacements"))
    frames = tuple(
        _frame(source, index, u, v, step * per_px, per_unit) for index, (u, v) in enumerate(fields)
    )
    return DicSeries(NAME, frames, (ONE_CAMERA,))


def _scales(source: Source, info: Value, mm_per_px: float | None) -> tuple[float, float]:
    """Factors to mm: of a pixel, and of the unit of the displacements."""
    path = source.path
    units = field(path, info, "units")
    pix_to_units = as_number(path, "dispinfo.pixtounits", field(path, info, "pixtounits"))
    if not 0 < pix_to_units < LARGEST["length"]:
        raise WrongFile(path, None, "dispinfo.pixtounits above 0", f"{pix_to_units:g}")
    name = units.strip() if isinstance(units, str) else ""
    if name.lower() in ("px", "pixel", "pixels"):
        if mm_per_px is None:
            raise WrongFile(path, None, "mm_per_px to be given for lengths in pixels", "none")
        return mm_per_px, mm_per_px / pix_to_units
    if name not in LENGTH:
        raise WrongFile(path, None, f"dispinfo.units among {', '.join(LENGTH)}", shown(units))
    per_px = pix_to_units * LENGTH[name]
    if mm_per_px is not None and not np.isclose(mm_per_px, per_px, rtol=1e-6, atol=0):
        raise WrongFile(path, None, f"mm_per_px = {mm_per_px:g} as given", f"{per_px:g}")
    return per_px, LENGTH[name]


def _fields(source: Source, displacements: Value) -> list[tuple[Array, Array]]:
    """Displacements u and v of each frame, in the unit of the file."""
    path = source.path
    if isinstance(displacements, list):
        pairs = [(field(path, one, _U), field(path, one, _V)) for one in displacements]
    else:
        # version 7.3 keeps an array of structs as a struct of lists
        u = as_list(field(path, displacements, _U))
        v = as_list(field(path, displacements, _V))
        if len(u) != len(v):
            raise WrongFile(path, None, f"{len(u)} fields {_V} as {_U}", f"{len(v)}")
        pairs = list(zip(u, v, strict=True))
    if not 0 < len(pairs) <= MAX_FRAMES:
        raise WrongFile(path, None, f"1 to {MAX_FRAMES:,} frames", f"{len(pairs):,}")
    return [(as_matrix(path, _U, u), as_matrix(path, _V, v)) for u, v in pairs]


def _frame(
    source: Source, index: int, u: Array, v: Array, spacing: float, per_unit: float
) -> PointFrame:
    if u.shape != v.shape:
        raise WrongFile(source.path, None, f"{_V} of shape {u.shape} as {_U}", f"{v.shape}")
    rows, columns = np.indices(u.shape).reshape(2, -1)
    nothing = np.zeros(u.size)
    position = np.column_stack([columns, rows, nothing]) * spacing
    moved = np.column_stack([u.ravel(), v.ravel(), nothing])
    displacement = scaled(moved, per_unit)
    if np.any(np.isfinite(moved) & (np.abs(displacement) > LARGEST["length"])):
        expected = f"displacements of at most {LARGEST['length']:g} mm"
        raise WrongFile(source.path, None, expected, "a larger one")
    rows_columns = (u.shape[0], u.shape[1])
    return masked_frame(
        f"{source.path.stem} frame {index}",
        position * UPWARDS,
        displacement * UPWARDS,
        grid_shape=rows_columns,
        is_planar=True,
        zeros_are_holes=True,
    )
