"""The thesis' lens calculations again: Tables 3.3, 3.4 and Appendix A.2, value by value.

Each printed value is compared with its own formula, fed with the inputs as printed, and with the
inputs that give the printed digits. Where these inputs differ, the thesis is inconsistent there; an
error is thus named where it arises, not in all that follows from it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import floor

from calib.data.thesis import thesis_table
from calib.optics.framing import (
    aspect_angle,
    frame_height,
    frame_width,
    half_depth,
    pixel_size,
    pixels_across,
    projected_width,
)
from calib.optics.thin_lens import (
    Values,
    circle_of_confusion,
    far_field_of_view,
    far_limit,
    hyperfocal_distance,
    near_limit,
)

OBJECT_DISTANCE = 500.0  # mm, section 3.4
CAMERA_ANGLE = 30.0  # degrees, section 3.4
SAMPLE_WIDTH = SAMPLE_HEIGHT = 10.0  # mm, section 3.4
COLUMNS, ROWS = 2448, 2050  # pixels, Eqs. A.11 and A.12
HEIGHT_USED = 5.0  # mm, what the printed number of pixels in height is made of
ASPECT_PRINTED = 6 / 5  # L_y / L_x, Appendix A.2
ASPECT_USED = 5 / 6  # L_y / L_x, what phi = 39.8 degrees is made of; 6/5 printed
ZOOM_USED = 108.0  # mm, what lens set 3 of Table 3.3 is made of; 180 in Table 2.3
SENSOR_USED = 11.016  # mm, what Table 3.3 is made of: 2448 x 2050 pixels of 3.45 um; 11.06 printed


@dataclass(frozen=True)
class Check:
    """One printed value beside what its formula gives."""

    table: str
    quantity: str
    printed: str
    """as printed, without the unit"""
    unit: str
    formula: float
    """by the formula as printed, from the inputs as printed"""
    reproduced: float
    """by the formula and inputs that give the printed digits"""
    remark: str = ""
    """what differs between the two"""
    is_cut: bool = False
    """the digits after the last one printed were cut, not rounded"""

    @property
    def follows(self) -> bool:
        """The formula, with the inputs as printed, gives all printed digits."""
        return self.shown(self.formula) == self.printed

    @property
    def is_reproduced(self) -> bool:
        """All printed digits are reproduced."""
        return self.shown(self.reproduced) == self.printed

    def shown(self, value: float) -> str:
        """A value with as many digits as the printed one has, and cut where that one is cut."""
        digits = len(self.printed.partition(".")[2])
        shift = 10**digits
        return f"{floor(value * shift) / shift if self.is_cut else value:.{digits}f}"


def published_checks() -> tuple[Check, ...]:
    """All values of Tables 3.3 and 3.4 and Appendix A.2 that a formula gives."""
    return (*_table_3_3(), *_appendix_a_2(), *_table_3_4())


def _fields(sensor: Values, focal_length: Values, f_stop: Values) -> tuple[float, float]:
    """Depth of field (mm) and diagonal of the field of view (mm) by Eqs. A.1 to A.5."""
    hyperfocal = hyperfocal_distance(focal_length, f_stop, circle_of_confusion(sensor))
    near = near_limit(hyperfocal, OBJECT_DISTANCE, focal_length)
    far = far_limit(hyperfocal, OBJECT_DISTANCE, focal_length)
    return float(far - near), float(far_field_of_view(sensor, OBJECT_DISTANCE, focal_length))


def _table_3_3() -> Iterator[Check]:
    inputs, printed = thesis_table("Table 2.3"), thesis_table("Table 3.3")
    depths, views = printed.cells("total_depth_of_field_mm"), printed.cells("field_of_view_mm")
    sensors = inputs.numbers("maximum_sensor_size_mm")
    focal_lengths = inputs.numbers("maximum_focal_length_mm")
    f_stops = inputs.numbers("maximum_f_stop")
    for index, lens in enumerate(printed.cells("lens_set")):
        sensor, focal_length, f_stop = sensors[index], focal_lengths[index], f_stops[index]
        is_zoom = inputs.cells("minimum_focal_length_mm")[index] != f"{focal_length:g}"
        sensor_used = SENSOR_USED if sensor == 11.06 else sensor
        used = _fields(sensor_used, ZOOM_USED if is_zoom else focal_length, f_stop)
        formula = _fields(sensor, focal_length, f_stop)
        remark = "" if sensor_used == sensor else f"sensor {SENSOR_USED} mm, printed {sensor:g}"
        remark += f"; focal length {ZOOM_USED:g} mm, printed {focal_length:g}" if is_zoom else ""
        names = ("depth of field", "field of view")
        for name, cells, by_formula, by_used in zip(
            names, (depths, views), formula, used, strict=True
        ):
            quantity = f"lens set {lens}, {name}"
            yield Check("Table 3.3", quantity, cells[index], "mm", by_formula, by_used, remark)


def _appendix_a_2() -> Iterator[Check]:
    table = thesis_table("Appendix A.2")
    cell = dict(zip(table.cells("symbol"), table.cells("value"), strict=True))
    units = dict(zip(table.cells("symbol"), table.cells("unit"), strict=True))

    def check(symbol: str, formula: Values, used: Values | None = None, why: str = "") -> Check:
        reproduced = formula if used is None else used
        return Check(
            "Appendix A.2",
            symbol,
            cell[symbol],
            units[symbol],
            float(formula),
            float(reproduced),
            why,
            is_cut=symbol in ("NP_x", "Subsets_x", "Subsets_y"),
        )

    sensor, focal, distance = float(cell["d"]), float(cell["FL"]), float(cell["OD"])
    hyperfocal = hyperfocal_distance(focal, float(cell["F_stop"]), float(cell["CoC"]))
    near = near_limit(hyperfocal, distance, focal)
    far = far_limit(hyperfocal, distance, focal)
    yield check("CoC", circle_of_confusion(sensor))
    yield check("HFD", hyperfocal / 1000)
    yield check("D_near", near)
    yield check("D_far", far)
    yield check("DOF", far - near)
    yield check("FOV", far_field_of_view(sensor, distance, focal))
    # A.7 and A.8 take the angle before it is rounded for print
    diagonal, phi = float(cell["FOV"]), aspect_angle(ASPECT_USED)
    yield check("phi", aspect_angle(ASPECT_PRINTED), phi, "AR 5/6, printed 6/5")
    yield check("L_x", frame_width(diagonal, phi))
    yield check("L_y", frame_height(diagonal, phi))
    angle = f"camera angle {CAMERA_ANGLE:g} degrees, printed phi"
    depth = half_depth(SAMPLE_WIDTH, phi)
    yield check("B", depth, half_depth(SAMPLE_WIDTH, CAMERA_ANGLE), angle)
    width = projected_width(SAMPLE_WIDTH, phi)
    yield check("A", width, projected_width(SAMPLE_WIDTH, CAMERA_ANGLE), angle)
    yield check("P_x", _pixel_width(float(cell["L_x"])), _pixel_width_used(cell["L_x"]), _PIXEL)
    yield check("P_y", pixel_size(float(cell["L_y"]), ROWS))
    n_x, n_y = _pixel_counts(cell, cell["L_x"], cell["L_y"])
    yield check("NP_x", n_x.formula, n_x.used, n_x.why)
    yield check("NP_y", n_y.formula, n_y.used, n_y.why)
    yield check("Subsets_x", float(cell["NP_x"]) / 6)
    yield check("Subsets_y", float(cell["NP_y"]) / 5)
    yield check("Subsets", float(cell["Subsets_x"]) * float(cell["Subsets_y"]))


def _table_3_4() -> Iterator[Check]:
    table = thesis_table("Table 3.4")
    a_2 = thesis_table("Appendix A.2")
    cell = dict(zip(table.cells("property"), table.cells("value"), strict=True))
    inputs = dict(zip(a_2.cells("symbol"), a_2.cells("value"), strict=True))
    # A.7 and A.8 take the angle before it is rounded for print
    diagonal, phi = float(inputs["FOV"]), aspect_angle(ASPECT_USED)
    width, height = cell["Frame Width"], cell["Frame Height"]
    n_x, n_y = _pixel_counts(
        {"A": inputs["A"], "P_x": cell["Pixel Width"], "P_y": cell["Pixel Height"]}, width, height
    )
    rows: list[tuple[str, Values, Values, str]] = [
        ("phi", aspect_angle(ASPECT_PRINTED), phi, "AR 5/6, printed 6/5"),
        *_same("Frame Width", frame_width(diagonal, phi)),
        *_same("Frame Height", frame_height(diagonal, phi)),
        ("Pixel Width", _pixel_width(float(width)), _pixel_width_used(width), _PIXEL),
        *_same("Pixel Height", pixel_size(float(height), ROWS)),
        ("Number of Pixels in Width", n_x.formula, n_x.used, n_x.why),
        ("Number of Pixels in Height", n_y.formula, n_y.used, n_y.why),
        (
            "Depth of Sample in Undeformed State",
            half_depth(SAMPLE_WIDTH, phi),
            half_depth(SAMPLE_WIDTH, CAMERA_ANGLE),
            f"camera angle {CAMERA_ANGLE:g} degrees, printed phi",
        ),
    ]
    units = dict(zip(table.cells("property"), table.cells("unit"), strict=True))
    for name, formula, used, why in rows:
        unit = units[name].replace("number of ", "")
        yield Check("Table 3.4", name, cell[name], unit, float(formula), float(used), why)


def _same(name: str, value: Values) -> list[tuple[str, Values, Values, str]]:
    return [(name, value, value, "")]


_PIXEL = f"times cos({CAMERA_ANGLE:g} degrees), which Eq. A.11 does not have"


def _pixel_width(width: float) -> Values:
    return pixel_size(width, COLUMNS)


def _pixel_width_used(width: str) -> Values:
    return pixel_size(projected_width(float(width), CAMERA_ANGLE), COLUMNS)


@dataclass(frozen=True)
class _Count:
    formula: Values
    used: Values
    why: str


def _pixel_counts(cell: dict[str, str], width: str, height: str) -> tuple[_Count, _Count]:
    """Pixels along width and height of the sample; the thesis rounds P to 0.00001 mm first."""
    pixel_x = round(float(_pixel_width_used(width)), 5)
    pixel_y = round(float(pixel_size(float(height), ROWS)), 5)
    n_x = _Count(
        pixels_across(float(cell["A"]), _pixel_width(float(width))),
        pixels_across(float(cell["A"]), pixel_x),
        f"P_x {pixel_x:g} mm: the factor cos({CAMERA_ANGLE:g} degrees) of A is undone",
    )
    n_y = _Count(
        pixels_across(SAMPLE_HEIGHT, pixel_size(float(height), ROWS)),
        pixels_across(HEIGHT_USED, pixel_y),
        f"height {HEIGHT_USED:g} mm, the sample's is {SAMPLE_HEIGHT:g}; P_y {pixel_y:g} mm",
    )
    return n_x, n_y
