"""Derivative of all contact forces in the parameters at a fixed displacement.

Through everything but the displacement: faces that move with the geometry, the pin, stiffness,
friction, and the anchors that the memory carries from step to step.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from fe.contact import FREE, TIED_TO_PIN, Faces, penalty, position
from fe.friction import slip_potential
from fe.pin_surface import RigidPin, pin_point
from fe.slip_anchors import SlipAnchors, place_slopes
from fe.surface_slopes import (
    SurfaceSlopes,
    gap_slope,
    normal_slope,
    penalty_slope,
    relative_motion,
)
from fe.ties import Ties
from fe.touch import PIN, Chart, FrictionLaw, empty_chart, touch

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@njit(cache=True)
def contact_pull(
    u: Array,
    faces: Faces,
    ties: Ties,
    slip: SlipAnchors,
    travel: float,
    pin: RigidPin,
    law: FrictionLaw,
    slopes: SurfaceSlopes,
    pull: Array,
) -> Array:
    """Fill `pull` (n_face, n_q, 3, n_p) with the derivative of each point's force, N.

    Returns that of the pin force (n_p,) N.  u (n_node, 3) and travel in mm.
    """
    n_p = pull.shape[3]
    on_pin = np.zeros(n_p)
    x = np.empty(3)
    seen, there = np.empty((3, n_p)), np.empty((2, n_p))
    chart = empty_chart()
    for c in range(faces.weights.shape[0]):
        for q in range(faces.weights.shape[1]):
            position(u, faces, c, q, x)
            at, motion, w = pull[c, q], slopes.points[c, q], faces.weights[c, q]
            dw = slopes.weights[c, q]
            at[:, :] = 0.0
            if ties.kind[c, q] != FREE and not faces.base[c]:
                on_pin += _held_pull(x, ties, c, q, faces, travel, pin, slopes, seen, at)
                continue
            if faces.base[c]:
                for j in range(n_p):
                    k, dk = pin.base_stiffness, slopes.base_stiffness[j]
                    at[1, j] += w * (k * motion[1, j] + dk * x[1]) + dw[j] * k * x[1]
            else:
                _pin_pull(x, motion, travel, w, dw, pin, slopes, seen, at)
                on_pin += at[1]
                if faces.floor[c] and x[1] < 0.0:
                    _floor_pull(x, motion, w, dw, pin, slopes, at)
            if law.pin <= 0.0 and law.base <= 0.0:
                continue
            surface, limit, steep = touch(x, faces.base[c], faces.floor[c], travel, pin, law, chart)
            if limit <= 0.0:
                continue
            if surface == PIN:
                relative_motion(x, motion, pin, slopes, seen)
            else:
                seen[:, :] = motion
            place_slopes(x, seen, chart, surface, pin, slopes, there)
            there -= slip.gradient[c, q, surface]
            before = at[1].copy()
            _friction_pull(
                x,
                seen,
                faces.base[c],
                surface,
                limit,
                steep,
                chart,
                slip.place[c, q, surface],
                there,
                travel,
                w,
                dw,
                pin,
                law,
                slopes,
                at,
            )
            if surface == PIN:
                on_pin += at[1] - before
    return on_pin


@njit(cache=True)
def _held_pull(
    x: Array,
    ties: Ties,
    c: int,
    q: int,
    faces: Faces,
    travel: float,
    pin: RigidPin,
    slopes: SurfaceSlopes,
    seen: Array,
    pull: Array,
) -> Array:
    """What holds a tied point: spring and penalty; returns what of it is the pin's (n_p,)."""
    motion, w, dw = slopes.points[c, q], faces.weights[c, q], slopes.weights[c, q]
    held, d_held = ties.hold[c, q], ties.hold_gradient[c, q]
    on_pin = np.zeros(dw.size)
    if held < 1.0:
        free, d_free = w * (1.0 - held), dw * (1.0 - held) - w * d_held
        _pin_pull(x, motion, travel, free, d_free, pin, slopes, seen, pull)
        on_pin += pull[1]
        if faces.floor[c] and x[1] < 0.0:
            _floor_pull(x, motion, free, d_free, pin, slopes, pull)
    moves = 1.0 if ties.kind[c, q] == TIED_TO_PIN else 0.0
    x[1] += moves * travel
    before = pull[1].copy()
    anchor, d_anchor = ties.anchor[c, q], ties.anchor_gradient[c, q]
    d_area = dw * held + w * d_held
    _tied_pull(x, anchor, d_anchor, motion, w * held, d_area, pin, slopes, pull)
    on_pin += moves * (pull[1] - before)
    return on_pin


@njit(cache=True)
def _tied_pull(
    x: Array,
    anchor: Array,
    anchor_gradient: Array,
    motion: Array,
    w: float,
    dw: Array,
    pin: RigidPin,
    slopes: SurfaceSlopes,
    pull: Array,
) -> None:
    """Spring to an anchor; x is seen from what the anchor moves with."""
    for i in range(3):
        stretch = x[i] - anchor[i]
        for j in range(dw.size):
            d = motion[i, j] - anchor_gradient[i, j]
            force = w * slopes.stiffness[j] + dw[j] * pin.stiffness
            pull[i, j] += w * pin.stiffness * d + force * stretch


@njit(cache=True)
def _pin_pull(
    x: Array,
    motion: Array,
    travel: float,
    w: float,
    dw: Array,
    pin: RigidPin,
    slopes: SurfaceSlopes,
    seen: Array,
    pull: Array,
) -> None:
    """Frictionless penalty of the pin; `seen` (3, n_p) is work space."""
    s = pin_point(x, travel, pin)
    if s.gap >= 0.0:
        return
    _, slope, curvature = penalty(s.gap, pin.stiffness, pin.ramp)
    relative_motion(x, motion, pin, slopes, seen)
    for j in range(dw.size):
        d0, d1, d2 = normal_slope(s, seen, pin, slopes, j)
        change = curvature * gap_slope(s, seen, slopes, j)
        change += penalty_slope(s.gap, pin.stiffness, pin.ramp, slopes.stiffness[j], slopes.ramp[j])
        along = w * change + dw[j] * slope
        pull[0, j] += along * s.nx + w * slope * d0
        pull[1, j] += along * s.ny + w * slope * d1
        pull[2, j] += along * s.nz + w * slope * d2


@njit(cache=True)
def _floor_pull(
    x: Array,
    motion: Array,
    w: float,
    dw: Array,
    pin: RigidPin,
    slopes: SurfaceSlopes,
    pull: Array,
) -> None:
    """Frictionless penalty of the floor."""
    _, slope, curvature = penalty(x[1], pin.stiffness, pin.ramp)
    for j in range(dw.size):
        change = curvature * motion[1, j]
        change += penalty_slope(x[1], pin.stiffness, pin.ramp, slopes.stiffness[j], slopes.ramp[j])
        pull[1, j] += w * change + dw[j] * slope


@njit(cache=True)
def _friction_pull(
    x: Array,
    seen: Array,
    on_base: bool,
    surface: int,
    limit: float,
    steep: float,
    chart: Chart,
    place: Array,
    slides: Array,
    travel: float,
    w: float,
    dw: Array,
    pin: RigidPin,
    law: FrictionLaw,
    slopes: SurfaceSlopes,
    pull: Array,
) -> None:
    """Friction where the limit (MPa, `steep` its slope in the distance) is above 0.

    `seen` (3, n_p) is the point's motion, `slides` (2, n_p) that of its slip, mm.
    """
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
