"""Derivative of friction's forces in the parameters at a fixed displacement.

Through the point's motion as its surface sees it, the anchor it slides from, the largest traction
and the slip over which that is reached (`fe.friction`).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.friction import slip_potential
from fe.pin_surface import RigidPin, pin_point
from fe.point_shares import (
    AREA,
    BASE_STIFFNESS,
    FILLET,
    FRICTION_BASE,
    FRICTION_PIN,
    HALF_WIDTH,
    MOTION,
    RAMP,
    REMEMBERED,
    SLIP,
    STIFFNESS,
    Share,
    add_normal_turn,
    add_seen,
)
from fe.slip_anchors import arc_growth
from fe.surface_slopes import penalty_slope
from fe.touch import PIN, Chart, FrictionLaw

Array = npt.NDArray[np.float64]


@kernel(inline="always")
def add_friction(
    x: Array,
    q: int,
    on_base: bool,
    surface: int,
    limit: float,
    steep: float,
    anchor: Array,
    travel: float,
    w: float,
    pin: RigidPin,
    law: FrictionLaw,
    chart: Chart,
    share: Share,
) -> None:
    """Add the shares of friction where its limit (MPa, `steep` its slope in the gap) is above 0.

    x (3,) mm is the point, `anchor` (2,) mm the place on the surface from which it slides.
    """
    s0, s1 = chart.place[0] - anchor[0], chart.place[1] - anchor[1]
    size2, a = s0 * s0 + s1 * s1, law.slip
    _, secant, fall = slip_potential(s0, s1, a)
    by_slip = 1.5 * (size2 / a**4 - 1.0 / a**2) if size2 < a * a else 0.0
    on_pin = surface == PIN
    e0, e1, turned = 0.0, 0.0, 0.0
    if on_pin:
        e0, e1, turned = arc_growth(x, chart, pin)
    traction = w * limit * secant
    T, slope, n = chart.tangent, chart.slope, chart.normal
    for i in range(3):
        along = s0 * T[0, i] + s1 * T[1, i]
        d0 = traction * T[0, i] - w * limit * fall * along * s0  # by the slip
        d1 = traction * T[1, i] - w * limit * fall * along * s1
        by_limit = w * secant * along
        rate = by_limit * steep
        v0 = d0 * slope[0, 0] + d1 * slope[1, 0] + rate * n[0]
        v1 = d0 * slope[0, 1] + d1 * slope[1, 1] + rate * n[1]
        v2 = d0 * slope[0, 2] + d1 * slope[1, 2] + rate * n[2]
        if on_pin:
            v0 += traction * (s0 * chart.bend[0, i, 0] + s1 * chart.bend[1, i, 0])
            v1 += traction * (s0 * chart.bend[0, i, 1] + s1 * chart.bend[1, i, 1])
            v2 += traction * (s0 * chart.bend[0, i, 2] + s1 * chart.bend[1, i, 2])
            add_seen(x, q, i, v0, v1, v2, pin, share)
            longer = d0 * e0 + d1 * e1
            share.single[q, i, HALF_WIDTH] += longer
            share.single[q, i, FILLET] += turned * longer - rate
        else:
            share.own[q, i, MOTION] += v0
            share.own[q, i, MOTION + 1] += v1
            share.own[q, i, MOTION + 2] += v2
        share.own[q, i, REMEMBERED] -= d0
        share.own[q, i, REMEMBERED + 1] -= d1
        share.own[q, i, AREA] += limit * secant * along
        share.single[q, i, SLIP] += w * limit * by_slip * along
        _add_limit(x, q, i, on_base, on_pin, limit, travel, by_limit, pin, law, share)
    if on_pin:  # the tangents turn with a bar, as its normal does
        along_x = traction * (s0 * T[0, 0] + s1 * T[1, 0])
        along_z = traction * (s0 * T[0, 2] + s1 * T[1, 2])
        add_normal_turn(q, along_x, along_z, pin, share)


@kernel(inline="always")
def _add_limit(
    x: Array,
    q: int,
    i: int,
    on_base: bool,
    on_pin: bool,
    limit: float,
    travel: float,
    by_limit: float,
    pin: RigidPin,
    law: FrictionLaw,
    share: Share,
) -> None:
    """What row i takes of what changes the largest traction mu p at a fixed distance.

    `by_limit` is its derivative in that, mm2.
    """
    coefficient = law.pin if on_pin else law.base
    share.single[q, i, FRICTION_PIN if on_pin else FRICTION_BASE] += by_limit * limit / coefficient
    if on_base:
        share.single[q, i, BASE_STIFFNESS] += by_limit * limit / pin.base_stiffness
        return
    gap = pin_point(x, travel, pin).gap if on_pin else x[1]
    rate = by_limit * coefficient
    share.single[q, i, STIFFNESS] -= rate * penalty_slope(gap, pin.stiffness, pin.ramp, 1.0, 0.0)
    share.single[q, i, RAMP] -= rate * penalty_slope(gap, pin.stiffness, pin.ramp, 0.0, 1.0)
