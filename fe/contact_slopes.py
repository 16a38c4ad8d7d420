"""Derivative of all contact forces in the parameters at a fixed displacement.

Through everything but the displacement: faces that move with the geometry, the pin, stiffness,
friction, and the anchors that the memory carries from step to step.

What is done at each point is inlined: handing over the many arrays, whose references are counted,
took as long as the sums.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from fe.contact import FREE, TIED_TO_PIN, Faces, penalty, position
from fe.friction_slopes import SlopeWork, empty_work, friction_pull
from fe.pin_surface import RigidPin, pin_point
from fe.slip_anchors import SlipAnchors
from fe.surface_slopes import (
    SurfaceSlopes,
    gap_slope,
    normal_slope,
    penalty_slope,
    relative_motion,
)
from fe.ties import Ties
from fe.touch import FrictionLaw

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
    work = empty_work(n_p)
    pull[...] = 0.0
    rubs = law.pin > 0.0 or law.base > 0.0
    for c in range(faces.weights.shape[0]):
        for q in range(faces.weights.shape[1]):
            position(u, faces, c, q, x)
            if ties.kind[c, q] != FREE and not faces.base[c]:
                at = pull[c, q]
                _held_pull(x, ties, c, q, faces, travel, pin, slopes, work, at, on_pin)
                continue
            if faces.base[c]:
                _base_pull(x, c, q, faces, pin, slopes, pull)
            elif _touches(x, faces.floor[c], travel, pin):
                at = pull[c, q]
                _free_pull(x, c, q, faces, travel, pin, slopes, work.seen, at, on_pin)
            else:
                continue
            if rubs:
                at = pull[c, q]
                friction_pull(x, c, q, faces, slip, travel, pin, law, slopes, work, at, on_pin)
    return on_pin


@njit(cache=True)
def add_to_nodes(faces: Faces, pull: Array, total: Array) -> None:
    """Add the forces of the points (n_face, n_q, 3, n_p) to those of the nodes (n_node, 3, n_p)."""
    n_p = pull.shape[3]
    for c in range(pull.shape[0]):
        for q in range(pull.shape[1]):
            touched = False
            for i in range(3):
                for j in range(n_p):
                    touched |= pull[c, q, i, j] != 0.0
            if not touched:
                continue
            for a in range(faces.nodes.shape[1]):
                node, share = faces.nodes[c, a], faces.shape[c, q, a]
                for i in range(3):
                    for j in range(n_p):
                        total[node, i, j] += share * pull[c, q, i, j]


@njit(cache=True)
def _touches(x: Array, on_side: bool, travel: float, pin: RigidPin) -> bool:
    """Whether the point x (3,) mm presses on the pin or, on a side face, on the floor."""
    return (on_side and x[1] < 0.0) or pin_point(x, travel, pin).gap < 0.0


@njit(cache=True, inline="always")
def _base_pull(
    x: Array, c: int, q: int, faces: Faces, pin: RigidPin, slopes: SurfaceSlopes, pull: Array
) -> None:
    """What the spring under a base point adds."""
    w, k = faces.weights[c, q], pin.base_stiffness
    for j in range(pull.shape[3]):
        dw, dk, moved = slopes.weights[c, q, j], slopes.base_stiffness[j], slopes.points[c, q, 1, j]
        pull[c, q, 1, j] += w * (k * moved + dk * x[1]) + dw * k * x[1]


@njit(cache=True, inline="always")
def _free_pull(
    x: Array,
    c: int,
    q: int,
    faces: Faces,
    travel: float,
    pin: RigidPin,
    slopes: SurfaceSlopes,
    seen: Array,
    pull: Array,
    on_pin: Array,
) -> None:
    """Frictionless penalty of pin and floor; adds what of it is the pin's to `on_pin` (n_p,)."""
    motion, w, dw = slopes.points[c, q], faces.weights[c, q], slopes.weights[c, q]
    _pin_pull(x, motion, travel, w, dw, pin, slopes, seen, pull)
    for j in range(dw.size):
        on_pin[j] += pull[1, j]
    if faces.floor[c] and x[1] < 0.0:
        _floor_pull(x, motion, w, dw, pin, slopes, pull)


@njit(cache=True, inline="always")
def _held_pull(
    x: Array,
    ties: Ties,
    c: int,
    q: int,
    faces: Faces,
    travel: float,
    pin: RigidPin,
    slopes: SurfaceSlopes,
    work: SlopeWork,
    pull: Array,
    on_pin: Array,
) -> None:
    """What holds a tied point: spring and penalty; adds what of it is the pin's to `on_pin`."""
    motion, w, dw = slopes.points[c, q], faces.weights[c, q], slopes.weights[c, q]
    held, d_held = ties.hold[c, q], ties.hold_gradient[c, q]
    if held < 1.0:
        free, d_free = w * (1.0 - held), dw * (1.0 - held) - w * d_held
        _pin_pull(x, motion, travel, free, d_free, pin, slopes, work.seen, pull)
        for j in range(dw.size):
            on_pin[j] += pull[1, j]
        if faces.floor[c] and x[1] < 0.0:
            _floor_pull(x, motion, free, d_free, pin, slopes, pull)
    tied_to_pin = ties.kind[c, q] == TIED_TO_PIN
    if tied_to_pin:
        x[1] += travel
    work.before[:] = pull[1]
    _tied_pull(x, ties, c, q, motion, w, dw, pin, slopes, pull)
    if tied_to_pin:
        for j in range(dw.size):
            on_pin[j] += pull[1, j] - work.before[j]


@njit(cache=True, inline="always")
def _tied_pull(
    x: Array,
    ties: Ties,
    c: int,
    q: int,
    motion: Array,
    w: float,
    dw: Array,
    pin: RigidPin,
    slopes: SurfaceSlopes,
    pull: Array,
) -> None:
    """Spring to an anchor; x is seen from what the anchor moves with."""
    held, d_held, d_anchor = ties.hold[c, q], ties.hold_gradient[c, q], ties.anchor_gradient[c, q]
    rate = w * held * pin.stiffness
    for i in range(3):
        stretch = x[i] - ties.anchor[c, q, i]
        by_stiffness, by_area = w * held * stretch, pin.stiffness * stretch
        for j in range(dw.size):
            d_area = dw[j] * held + w * d_held[j]
            pull[i, j] += rate * (motion[i, j] - d_anchor[i, j])
            pull[i, j] += by_stiffness * slopes.stiffness[j] + by_area * d_area


@njit(cache=True, inline="always")
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


@njit(cache=True, inline="always")
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
