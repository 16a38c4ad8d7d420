"""Where a point touches pin or floor, as friction sees it: limit, place on the surface, tangents.

A place is two numbers, mm.  On a bar: arc length across its profile, and distance along it.  On a
round pin: x and z of the point at the arc length's distance from the axis (the flat's own
coordinates, drawn on over the edge, where they measure slip around the axis up to a tenth too
long).  On the floor: x and z.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.contact import penalty
from fe.pin_surface import ROUND, RigidPin, bar_distance, pin_point

Array = npt.NDArray[np.float64]

PIN, FLOOR = 0, 1


class FrictionLaw(NamedTuple):
    """Coefficients of friction, 0 for none."""

    pin: float = 0.0
    base: float = 0.0
    slip: float = 0.01
    """a: slip over which friction grows to its limit, mm"""


class Chart(NamedTuple):
    """Work arrays of one point's surroundings on a surface."""

    place: Array
    """(2,) mm"""
    tangent: Array
    """(2, 3) unit tangents along the two numbers of the place"""
    slope: Array
    """(2, 3) derivative of the place in the point"""
    normal: Array
    """(3,) outward normal"""
    bend: Array
    """(2, 3, 3) [a, i, k] derivative of tangent[a, i] in the point's k, 1/mm"""


@kernel()
def empty_chart() -> Chart:
    """Zeroed work arrays."""
    return Chart(np.zeros(2), np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(3), np.zeros((2, 3, 3)))


@kernel()
def bar_arc(
    x: float, y: float, half_width: float, fillet: float, bottom: float
) -> tuple[float, float]:
    """Arc length on the profile of the point nearest to (x, y), mm, and its stretch.

    Counted from the middle of the flat bottom, with the sign of x; the stretch is its derivative
    along the tangent at (x, y), that is fillet radius over distance from the fillet's centre.
    """
    side = 1.0 if x >= 0.0 else -1.0
    flat = half_width - fillet
    q0 = abs(x) - flat
    q1 = bottom + fillet - y
    if q0 <= 0.0 or q1 <= 0.0:
        if q0 > q1:
            return side * (flat + 0.5 * np.pi * fillet - q1), 1.0
        return x, 1.0
    radius = max(np.sqrt(q0 * q0 + q1 * q1), 1e-6)
    return side * (flat + fillet * np.arctan2(q0, q1)), fillet / radius


@kernel()
def chart_floor(x: Array, chart: Chart) -> None:
    """Fill the chart of the floor under x (3,) mm."""
    for part in (chart.tangent, chart.slope):
        part[:, :] = 0.0
        part[0, 0] = 1.0
        part[1, 2] = 1.0
    chart.bend[:, :, :] = 0.0
    chart.normal[0], chart.normal[1], chart.normal[2] = 0.0, 1.0, 0.0
    chart.place[0], chart.place[1] = x[0], x[2]


@kernel()
def chart_pin(x: Array, travel: float, pin: RigidPin, chart: Chart) -> float:
    """Fill the chart of the pin at x (3,) mm; returns the signed distance to it, mm.

    With m along the meridian, o outwards, h around the axis and phi the normal's angle from the
    vertical: dm = -n dphi + cos(phi) h dtheta, dh = -o dtheta.  Under a bar o is across it and h
    along it, and theta does not change.
    """
    dx, dz = x[0] - pin.x, x[2] - pin.z
    bottom = pin.height - travel
    ex, ez, c, s = pin.across_x, pin.across_z, 1.0, 0.0
    out = ex * dx + ez * dz
    if pin.shape == ROUND:
        out = max(np.sqrt(dx * dx + dz * dz), 1e-12)
        ex, ez = dx / out, dz / out
        c, s = ex, ez  # the tangents of the flat: x and z
    gap, n, ny, hoo, _, hyy = bar_distance(out, x[1], pin.half_width, pin.fillet, bottom)
    arc, stretch = bar_arc(out, x[1], pin.half_width, pin.fillet, bottom)
    curvature = hoo + hyy
    meridian = (-ny * ex, n, -ny * ez)
    around = (-ez, 0.0, ex)
    outward = (ex, 0.0, ez)
    normal = (n * ex, ny, n * ez)
    round_pin = pin.shape == ROUND
    hoop = arc / out if round_pin else 1.0
    turn = 1.0 / out if round_pin else 0.0
    chart.place[0] = arc * c if round_pin else arc
    chart.place[1] = arc * s if round_pin else ex * dz - ez * dx
    for i in range(3):
        chart.normal[i] = normal[i]
        chart.tangent[0, i] = c * meridian[i] - s * around[i]
        chart.tangent[1, i] = s * meridian[i] + c * around[i]
        chart.slope[0, i] = c * stretch * meridian[i] - s * hoop * around[i]
        chart.slope[1, i] = s * stretch * meridian[i] + c * hoop * around[i]
        for k in range(3):
            along = -curvature * normal[i] * meridian[k]
            by_turn = turn * around[k]
            lean = meridian[i] - outward[i]
            less = (-ny - 1.0) * around[i]
            chart.bend[0, i, k] = c * along + by_turn * (-s * lean + c * less)
            chart.bend[1, i, k] = s * along + by_turn * (c * lean + s * less)
    return gap


@kernel()
def touch(
    x: Array,
    on_base: bool,
    on_side: bool,
    travel: float,
    pin: RigidPin,
    law: FrictionLaw,
    chart: Chart,
) -> tuple[int, float, float]:
    """Contact of the point x (3,) mm: (PIN or FLOOR, limit mu p MPa, its slope MPa/mm).

    The slope is in the distance to the surface; the chart is filled where the limit is above 0.
    """
    if on_base:
        if not (x[1] < 0.0 and law.base > 0.0):
            return FLOOR, 0.0, 0.0
        chart_floor(x, chart)
        rate = law.base * pin.base_stiffness
        return FLOOR, -rate * x[1], -rate
    if on_side and law.base > 0.0 and x[1] < 0.0:
        chart_floor(x, chart)
        _, slope, curvature = penalty(x[1], pin.stiffness, pin.ramp)
        return FLOOR, -law.base * slope, -law.base * curvature
    if law.pin == 0.0 or pin_point(x, travel, pin).gap >= 0.0:
        return PIN, 0.0, 0.0
    gap = chart_pin(x, travel, pin, chart)
    _, slope, curvature = penalty(gap, pin.stiffness, pin.ramp)
    return PIN, -law.pin * slope, -law.pin * curvature
