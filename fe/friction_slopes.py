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
from fe.pin_surface import RigidPin, pin_point
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
    chart: Chart


@njit(cache=True)
def empty_work(n_p: int) -> SlopeWork:
    """Work arrays for n_p parameters."""
    return SlopeWork(np.empty((3, n_p)), np.empty((2, n_p)), np.empty(n_p), empty_chart())


@njit(cache=True)
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
) -> Array:
    """Add friction of point q of face c, at x (3,) mm, to `pull` (3, n_p) N; `work` is filled.

    Returns what of its vertical force is the pin's (n_p,) N.
    """
    motion, w, dw = slopes.points[c, q], faces.weights[c, q], slopes.weights[c, q]
    chart, on_base = work.chart, faces.base[c]
    surface, limit, steep = touch(x, on_base, faces.floor[c], travel, pin, law, chart)
    none = np.zeros(dw.size)
    if limit <= 0.0:
        return none
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
    return pull[1] - work.before if surface == PIN else none


@njit(cache=True)
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
    gap = pin_point(x, travel, pin).gap if surface == PIN else x[1]
    for j in range(dw.size):
        d0, d1 = slides[0, j], slides[1, j]
        d_limit = _limit_slope(
            seen, on_base, surface, limit, steep, gap, chart, pin, law, slopes, j
        )
        d_secant = by_slip * slopes.slip[j] - fall * (s0 * d0 + s1 * d1)
        g = w * (limit * d_secant + d_limit * secant) + dw[j] * limit * secant
        g0 = g * s0 + w * limit * secant * d0
        g1 = g * s1 + w * limit * secant * d1
        for i in range(3):
            pull[i, j] += g0 * chart.tangent[0, i] + g1 * chart.tangent[1, i]
            for k in range(3):
                bend = s0 * chart.bend[0, i, k] + s1 * chart.bend[1, i, k]
                pull[i, j] += w * limit * secant * bend * seen[k, j]


@njit(cache=True)
def _limit_slope(
    seen: Array,
    on_base: bool,
    surface: int,
    limit: float,
    steep: float,
    gap: float,
    chart: Chart,
    pin: RigidPin,
    law: FrictionLaw,
    slopes: SurfaceSlopes,
    j: int,
) -> float:
    """Derivative of the largest traction mu p in one parameter, MPa."""
    n = chart.normal
    d_gap = n[0] * seen[0, j] + n[1] * seen[1, j] + n[2] * seen[2, j]
    if surface == PIN:
        coefficient, d_coefficient = law.pin, slopes.friction_pin[j]
        d_gap -= slopes.fillet[j]
    else:
        coefficient, d_coefficient = law.base, slopes.friction_base[j]
    change: float = steep * d_gap + limit * d_coefficient / coefficient
    if on_base:
        change += limit * slopes.base_stiffness[j] / pin.base_stiffness
    else:
        dk, dr = slopes.stiffness[j], slopes.ramp[j]
        change -= coefficient * penalty_slope(gap, pin.stiffness, pin.ramp, dk, dr)
    return change
