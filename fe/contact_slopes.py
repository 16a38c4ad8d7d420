"""Derivative of all contact forces in the parameters at a fixed displacement.

Through everything but the displacement: faces that move with the geometry, the pin, stiffness,
friction, and the anchors that the memory carries from step to step.

The force of a point is linear in what changes at it (`Share`): how much it takes of each is found
once a point, whatever the number of parameters, and put together a face at a time by products of
matrices.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.contact import FREE, TIED_TO_PIN, Faces, penalty, position
from fe.friction_slopes import add_friction
from fe.pin_surface import RigidPin, pin_point
from fe.point_shares import (
    AREA,
    BASE_STIFFNESS,
    FILLET,
    HOLD,
    MOTION,
    N_OWN,
    N_SINGLE,
    RAMP,
    REMEMBERED,
    STIFFNESS,
    Share,
    add_normal_turn,
    add_seen,
)
from fe.slip_anchors import SlipAnchors
from fe.surface_slopes import SurfaceSlopes, penalty_slope
from fe.ties import Ties
from fe.touch import FLOOR, PIN, Chart, FrictionLaw, empty_chart, touch

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_NOTHING, _TIED = -2, -1
"""what a point remembers that touches nothing, or is tied; else the surface it slides on"""


def contact_pull(
    u: Array,
    faces: Faces,
    ties: Ties,
    slip: SlipAnchors,
    travel: float,
    pin: RigidPin,
    law: FrictionLaw,
    slopes: SurfaceSlopes,
) -> tuple[Array, Array]:
    """Derivatives of the nodal forces (n_node, 3, n_p) and of the pin force (n_p,), N per unit.

    u (n_node, 3) and travel in mm.
    """
    single = np.array(slopes[2:])
    total, on_pin = np.zeros((*u.shape, single.shape[1])), np.zeros(single.shape[1])
    if on_pin.size:
        _pull_faces(u, faces, ties, slip, travel, pin, law, slopes, single, total, on_pin)
    return total, on_pin


@kernel()
def _pull_faces(
    u: Array,
    faces: Faces,
    ties: Ties,
    slip: SlipAnchors,
    travel: float,
    pin: RigidPin,
    law: FrictionLaw,
    slopes: SurfaceSlopes,
    single: Array,
    total: Array,
    on_pin: Array,
) -> None:
    """Add to `total` and `on_pin`; `single` (N_SINGLE, n_p) are the slopes but points and areas."""
    n_face, n_quad = faces.weights.shape
    n_p = single.shape[1]
    share = Share(np.empty((n_quad, 4, N_OWN)), np.empty((n_quad, 4, N_SINGLE)))
    remembers = np.empty(n_quad, dtype=np.int64)
    x, chart = np.empty(3), empty_chart()
    for c in range(n_face):
        share.own[...] = 0.0
        share.single[...] = 0.0
        touched = False
        for q in range(n_quad):
            position(u, faces, c, q, x)
            remembers[q] = _add_point(x, c, q, faces, ties, slip, travel, pin, law, chart, share)
            touched |= remembers[q] != _NOTHING
        if not touched:
            continue
        pull = np.dot(share.single.reshape(4 * n_quad, N_SINGLE), single).reshape(n_quad, 4, n_p)
        for q in range(n_quad):
            if remembers[q] != _NOTHING:
                _add_own(c, q, remembers[q], share.own, ties, slip, slopes, pull)
        nodal = np.dot(faces.shape[c].T, pull.reshape(n_quad, 4 * n_p))
        for a in range(faces.nodes.shape[1]):
            node = faces.nodes[c, a]
            for j in range(n_p):
                for i in range(3):
                    total[node, i, j] += nodal[a, i * n_p + j]
                on_pin[j] += nodal[a, 3 * n_p + j]  # shape functions add up to one


@kernel(inline="always")
def _add_own(
    c: int,
    q: int,
    remembers: int,
    own: Array,
    ties: Ties,
    slip: SlipAnchors,
    slopes: SurfaceSlopes,
    pull: Array,
) -> None:
    """Add to `pull` (n_q, 4, n_p) what comes of the point's own motion, area and memory."""
    n_p = pull.shape[2]
    for i in range(4):
        a0, a1, a2 = own[q, i, MOTION], own[q, i, MOTION + 1], own[q, i, MOTION + 2]
        by_area = own[q, i, AREA]
        for j in range(n_p):
            pull[q, i, j] += (
                a0 * slopes.points[c, q, 0, j]
                + a1 * slopes.points[c, q, 1, j]
                + a2 * slopes.points[c, q, 2, j]
                + by_area * slopes.weights[c, q, j]
            )
        b0, b1, b2 = own[q, i, REMEMBERED], own[q, i, REMEMBERED + 1], own[q, i, REMEMBERED + 2]
        if remembers == _TIED:
            by_hold = own[q, i, HOLD]
            for j in range(n_p):
                pull[q, i, j] += (
                    b0 * ties.anchor_gradient[c, q, 0, j]
                    + b1 * ties.anchor_gradient[c, q, 1, j]
                    + b2 * ties.anchor_gradient[c, q, 2, j]
                    + by_hold * ties.hold_gradient[c, q, j]
                )
        elif b0 != 0.0 or b1 != 0.0:
            for j in range(n_p):
                pull[q, i, j] += (
                    b0 * slip.gradient[c, q, remembers, 0, j]
                    + b1 * slip.gradient[c, q, remembers, 1, j]
                )


@kernel(inline="always")
def _add_point(
    x: Array,
    c: int,
    q: int,
    faces: Faces,
    ties: Ties,
    slip: SlipAnchors,
    travel: float,
    pin: RigidPin,
    law: FrictionLaw,
    chart: Chart,
    share: Share,
) -> int:
    """Shares of the point at x (3,) mm; returns what it remembers.

    First what is the pin's, then what is the floor's or the base's.
    """
    w, on_base = faces.weights[c, q], faces.base[c]
    tied = ties.kind[c, q] != FREE and not on_base
    free = 1.0 - ties.hold[c, q] if tied else 1.0
    on_floor = faces.floor[c] and x[1] < 0.0
    on_pin = not on_base and pin_point(x, travel, pin).gap < 0.0
    if not (tied or on_base or on_floor or on_pin):
        return _NOTHING
    surface, limit, steep = FLOOR, 0.0, 0.0
    if not tied and (law.pin > 0.0 or law.base > 0.0):
        surface, limit, steep = touch(x, on_base, faces.floor[c], travel, pin, law, chart)
    with_pin = ties.kind[c, q] == TIED_TO_PIN if tied else surface == PIN
    if on_pin and free > 0.0:
        _add_pin(x, q, travel, w, free, pin, share)
    if not with_pin:
        _copy_to_pin(q, share)
    if tied:
        _add_spring(x, c, q, travel if with_pin else 0.0, w, ties, pin, share)
    elif limit > 0.0:
        place = slip.place[c, q, surface]
        add_friction(x, q, on_base, surface, limit, steep, place, travel, w, pin, law, chart, share)
    if with_pin:
        _copy_to_pin(q, share)
    if on_base:
        _add_base(x, q, w, pin, share)
    elif on_floor and free > 0.0:
        _add_floor(x, q, w, free, pin, share)
    return _TIED if tied else int(surface)


@kernel(inline="always")
def _copy_to_pin(q: int, share: Share) -> None:
    """Take the vertical force that there is so far for the pin's."""
    for k in range(N_OWN):
        share.own[q, 3, k] = share.own[q, 1, k]
    for k in range(N_SINGLE):
        share.single[q, 3, k] = share.single[q, 1, k]


@kernel(inline="always")
def _add_base(x: Array, q: int, w: float, pin: RigidPin, share: Share) -> None:
    """The spring under a base point."""
    share.own[q, 1, MOTION + 1] += w * pin.base_stiffness
    share.own[q, 1, AREA] += pin.base_stiffness * x[1]
    share.single[q, 1, BASE_STIFFNESS] += w * x[1]


@kernel(inline="always")
def _add_spring(
    x: Array,
    c: int,
    q: int,
    travel: float,
    w: float,
    ties: Ties,
    pin: RigidPin,
    share: Share,
) -> None:
    """Spring to an anchor that has gone down by `travel`, mm."""
    held, k = ties.hold[c, q], pin.stiffness
    for i in range(3):
        stretch = x[i] - ties.anchor[c, q, i]
        if i == 1:
            stretch += travel
        share.own[q, i, MOTION + i] += w * held * k
        share.own[q, i, REMEMBERED + i] -= w * held * k
        share.own[q, i, HOLD] += w * k * stretch
        share.own[q, i, AREA] += held * k * stretch
        share.single[q, i, STIFFNESS] += w * held * stretch


@kernel(inline="always")
def _add_pin(
    x: Array, q: int, travel: float, w: float, part: float, pin: RigidPin, share: Share
) -> None:
    """Frictionless penalty of the pin, of the `part` of the area w (mm2) that no spring holds."""
    s = pin_point(x, travel, pin)
    if s.gap >= 0.0:
        return
    _, slope, curvature = penalty(s.gap, pin.stiffness, pin.ramp)
    by_stiffness = penalty_slope(s.gap, pin.stiffness, pin.ramp, 1.0, 0.0)
    by_ramp = penalty_slope(s.gap, pin.stiffness, pin.ramp, 0.0, 1.0)
    area, n = w * part, (s.nx, s.ny, s.nz)
    hessian = ((s.hxx, s.hxy, s.hxz), (s.hxy, s.hyy, s.hyz), (s.hxz, s.hyz, s.hzz))
    for i in range(3):
        h, rate = hessian[i], area * curvature * n[i]
        v0 = rate * n[0] + area * slope * h[0]
        v1 = rate * n[1] + area * slope * h[1]
        v2 = rate * n[2] + area * slope * h[2]
        add_seen(x, q, i, v0, v1, v2, pin, share)
        share.single[q, i, FILLET] -= rate
        share.single[q, i, STIFFNESS] += area * by_stiffness * n[i]
        share.single[q, i, RAMP] += area * by_ramp * n[i]
        share.own[q, i, AREA] += part * slope * n[i]
        share.own[q, i, HOLD] -= w * slope * n[i]
    add_normal_turn(q, area * slope * s.nx, area * slope * s.nz, pin, share)


@kernel(inline="always")
def _add_floor(x: Array, q: int, w: float, part: float, pin: RigidPin, share: Share) -> None:
    """Frictionless penalty of the floor, as `_add_pin`."""
    _, slope, curvature = penalty(x[1], pin.stiffness, pin.ramp)
    area = w * part
    share.own[q, 1, MOTION + 1] += area * curvature
    share.single[q, 1, STIFFNESS] += area * penalty_slope(x[1], pin.stiffness, pin.ramp, 1.0, 0.0)
    share.single[q, 1, RAMP] += area * penalty_slope(x[1], pin.stiffness, pin.ramp, 0.0, 1.0)
    share.own[q, 1, AREA] += part * slope
    share.own[q, 1, HOLD] -= w * slope
