"""Derivative of friction's forces in the parameters at a fixed displacement.

Through the point's motion as its surface sees it, the anchor it slides from, the largest traction
and the slip over which that is reached (`fe.friction`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fe.contact import Faces
from fe.friction import slip_potential
from fe.pin_surface import ROUND, RigidPin, pin_point
from fe.slip_anchors import SlipAnchors, place_slopes
from fe.surface_slopes import SurfaceSlopes, penalty_slope, relative_motion
from fe.touch import PIN, Chart, FrictionLaw, empty_chart, touch

Array = npt.NDArray[np.float64]


class SlopeWork(NamedTuple):
    """Work arrays of one point."""

    seen: Array
    """(3, n_p) motion of the point as the surface sees it, mm"""
    there: Array
    """(2, n_p) that of its slip, mm"""
    before: Array
    """(n_p,) its vertical force without friction, N"""
    limit: Array
    """(n_p,) the largest traction, MPa"""
    chart: Chart


@njit(cache=True)
def empty_work(n_p: int) -> SlopeWork:
    """Work arrays for n_p parameters."""
    return SlopeWork(
        np.empty((3, n_p)), np.empty((2, n_p)), np.empty(n_p), np.empty(n_p), empty_chart()
    )


@njit(cache=True, inline="always")
def friction_pull(
    x: Array,
    c: int,
    q: int,
    faces: Faces,
    slip: SlipAnchors,
    travel: float,
    pin: RigidPin,
    law: FrictionLaw,
    slopes: SurfaceSlopes,
    work: SlopeWork,
    pull: Array,
    on_pin: Array,
) -> None:
    """Add friction of point q of face c, at x (3,) mm, to `pull` (3, n_p) N; `work` is filled.

    What of its vertical force is the pin's is added to `on_pin` (n_p,) N.
    """
    motion, w, dw = slopes.points[c, q], faces.weights[c, q], slopes.weights[c, q]
    chart, on_base = work.chart, faces.base[c]
    surface, limit, steep = touch(x, on_base, faces.floor[c], travel, pin, law, chart)
    if limit <= 0.0:
        return
    if surface == PIN:
        relative_motion(x, motion, pin, slopes, work.seen)
    else:
        work.seen[:, :] = motion
    place_slopes(x, work.seen, chart, surface, pin, slopes, work.there)
    for k in range(2):
        for j in range(dw.size):
            work.there[k, j] -= slip.gradient[c, q, surface, k, j]
    work.before[:] = pull[1]
    place = slip.place[c, q, surface]
    _slip_pull(
        x, on_base, surface, limit, steep, place, travel, w, dw, pin, law, slopes, work, pull
    )
    if surface == PIN:
        for j in range(dw.size):
            on_pin[j] += pull[1, j] - work.before[j]


@njit(cache=True, inline="always")
def _slip_pull(
    x: Array,
    on_base: bool,
    surface: int,
    limit: float,
    steep: float,
    place: Array,
    travel: float,
    w: float,
    dw: Array,
    pin: RigidPin,
    law: FrictionLaw,
    slopes: SurfaceSlopes,
    work: SlopeWork,
    pull: Array,
) -> None:
    """Friction where the limit (MPa, `steep` its slope in the distance) is above 0."""
    seen, slides, chart = work.seen, work.there, work.chart
    s0, s1 = chart.place[0] - place[0], chart.place[1] - place[1]
    size2 = s0 * s0 + s1 * s1
    _, secant, fall = slip_potential(s0, s1, law.slip)
    a = law.slip
    by_slip = 1.5 * (size2 / a**4 - 1.0 / a**2) if size2 < a * a else 0.0
    _fill_limit_slopes(x, on_base, surface, limit, steep, travel, pin, law, slopes, work)
    traction = w * limit * secant
    for j in range(dw.size):
        d0, d1 = slides[0, j], slides[1, j]
        d_secant = by_slip * slopes.slip[j] - fall * (s0 * d0 + s1 * d1)
        g = w * (limit * d_secant + work.limit[j] * secant) + dw[j] * limit * secant
        g0 = g * s0 + traction * d0
        g1 = g * s1 + traction * d1
        for i in range(3):
            pull[i, j] += g0 * chart.tangent[0, i] + g1 * chart.tangent[1, i]
    if surface != PIN:  # the floor is flat
        return
    for i in range(3):
        for k in range(3):
            bend = traction * (s0 * chart.bend[0, i, k] + s1 * chart.bend[1, i, k])
            if bend != 0.0:
                for j in range(dw.size):
                    pull[i, j] += bend * seen[k, j]
    if pin.shape != ROUND:  # the tangents turn with a bar, as its normal does
        across = traction * (s0 * chart.tangent[0, 0] + s1 * chart.tangent[1, 0])
        along = traction * (s0 * chart.tangent[0, 2] + s1 * chart.tangent[1, 2])
        for j in range(dw.size):
            pull[0, j] += slopes.angle[j] * along
            pull[2, j] -= slopes.angle[j] * across


@njit(cache=True, inline="always")
def _fill_limit_slopes(
    x: Array,
    on_base: bool,
    surface: int,
    limit: float,
    steep: float,
    travel: float,
    pin: RigidPin,
    law: FrictionLaw,
    slopes: SurfaceSlopes,
    work: SlopeWork,
) -> None:
    """Derivative of the largest traction mu p of the point x (3,) mm, MPa."""
    seen, n = work.seen, work.chart.normal
    on_pin = surface == PIN
    coefficient = law.pin if on_pin else law.base
    d_coefficient = slopes.friction_pin if on_pin else slopes.friction_base
    gap = pin_point(x, travel, pin).gap if on_pin else x[1]
    by_stiffness = -coefficient * penalty_slope(gap, pin.stiffness, pin.ramp, 1.0, 0.0)
    by_ramp = -coefficient * penalty_slope(gap, pin.stiffness, pin.ramp, 0.0, 1.0)
    by_base = limit / pin.base_stiffness
    for j in range(work.limit.size):
        d_gap = n[0] * seen[0, j] + n[1] * seen[1, j] + n[2] * seen[2, j]
        if on_pin:
            d_gap -= slopes.fillet[j]
        change = steep * d_gap + limit * d_coefficient[j] / coefficient
        if on_base:
            change += by_base * slopes.base_stiffness[j]
        else:
            change += by_stiffness * slopes.stiffness[j] + by_ramp * slopes.ramp[j]
        work.limit[j] = change
