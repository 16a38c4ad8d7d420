"""How the contact surfaces depend on parameters: derivatives of faces, pin and friction.

A pin that changes looks, from a point, like a point that moves: growing half the width by dw
brings the profile nearer by dw wherever it has a side, and so does moving the point by -dw
outwards.  So the derivative of anything seen from the point is that along a relative motion, plus
little that a fillet changes by itself (`fe.contact.PenaltyLaw` and coefficients apart).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.contact import Faces
from fe.pin_surface import ROUND, PinPoint, RigidPin

Array = npt.NDArray[np.float64]


class SurfaceSlopes(NamedTuple):
    """Derivatives in the n_p parameters, each per unit of its parameter."""

    points: Array
    """(n_face, n_q, 3, n_p) of the reference positions of the contact points, mm"""
    weights: Array
    """(n_face, n_q, n_p) of their areas, mm2"""
    height: Array
    """(n_p,) of the pin's flat bottom at travel 0, mm"""
    half_width: Array
    """(n_p,) mm"""
    fillet: Array
    """(n_p,) mm"""
    x: Array
    """(n_p,) of the pin's axis, mm"""
    z: Array
    """(n_p,) mm"""
    angle: Array
    """(n_p,) by which a bar is turned about its vertical axis, radians"""
    stiffness: Array
    """(n_p,) of the contact stiffness, MPa/mm"""
    ramp: Array
    """(n_p,) of the penetration over which it grows, mm"""
    base_stiffness: Array
    """(n_p,) MPa/mm"""
    friction_pin: Array
    """(n_p,) of the coefficients of friction"""
    friction_base: Array
    """(n_p,)"""
    slip: Array
    """(n_p,) of the slip over which friction grows, mm"""


def no_slopes(faces: Faces, n_p: int) -> SurfaceSlopes:
    """Slopes of `n_p` parameters that change no surface, to be replaced where they do."""
    n_single = len(SurfaceSlopes._fields) - 2
    return SurfaceSlopes(
        np.zeros((*faces.points.shape, n_p)),
        np.zeros((*faces.weights.shape, n_p)),
        *(np.zeros(n_p) for _ in range(n_single)),
    )


@kernel()
def seen_from(x: Array, pin: RigidPin) -> tuple[float, float, float]:
    """(x, z of the unit vector outwards, side) for the point x (3,) mm: side -1 behind a bar."""
    dx, dz = x[0] - pin.x, x[2] - pin.z
    if pin.shape == ROUND:
        out = max(np.sqrt(dx * dx + dz * dz), 1e-12)
        return dx / out, dz / out, 1.0
    side = 1.0 if pin.across_x * dx + pin.across_z * dz >= 0.0 else -1.0
    return pin.across_x, pin.across_z, side


@kernel(inline="always")
def relative_motion(
    x: Array, motion: Array, pin: RigidPin, slopes: SurfaceSlopes, seen: Array
) -> None:
    """Fill `seen` (3, n_p) with the derivative of the place of x (3,) mm as the pin sees it, mm.

    `motion` (3, n_p) is the point's own.
    """
    ex, ez, side = seen_from(x, pin)
    dx, dz = x[0] - pin.x, x[2] - pin.z
    is_round = pin.shape == ROUND
    for j in range(motion.shape[1]):
        outwards = side * (slopes.fillet[j] - slopes.half_width[j])
        axis_x, axis_z = slopes.x[j], slopes.z[j]
        if not is_round:  # a turning bar is a point that turns the other way
            axis_x += slopes.angle[j] * dz
            axis_z -= slopes.angle[j] * dx
        seen[0, j] = motion[0, j] - axis_x + outwards * ex
        seen[1, j] = motion[1, j] - slopes.height[j] - slopes.fillet[j]
        seen[2, j] = motion[2, j] - axis_z + outwards * ez


@kernel()
def gap_slope(s: PinPoint, moved: Array, slopes: SurfaceSlopes, j: int) -> float:
    """Derivative of the signed distance along the relative motion (3, n_p) mm."""
    along: float = s.nx * moved[0, j] + s.ny * moved[1, j] + s.nz * moved[2, j]
    along -= slopes.fillet[j]
    return along


@kernel()
def normal_slope(
    s: PinPoint, moved: Array, pin: RigidPin, slopes: SurfaceSlopes, j: int
) -> tuple[float, float, float]:
    """Derivative of the pin's normal along the relative motion (3, n_p) mm."""
    v0, v1, v2 = moved[0, j], moved[1, j], moved[2, j]
    d0 = s.hxx * v0 + s.hxy * v1 + s.hxz * v2
    d1 = s.hxy * v0 + s.hyy * v1 + s.hyz * v2
    d2 = s.hxz * v0 + s.hyz * v1 + s.hzz * v2
    if pin.shape != ROUND:
        d0 += slopes.angle[j] * s.nz
        d2 -= slopes.angle[j] * s.nx
    return d0, d1, d2


@kernel()
def penalty_slope(gap: float, stiffness: float, ramp: float, dk: float, dr: float) -> float:
    """Derivative of the penalty's slope in stiffness (MPa/mm) and ramp (mm) at a fixed gap, MPa."""
    t = -gap
    if t <= 0.0:
        return 0.0
    m = min(t, ramp)
    return -dk * (m * m / (2.0 * ramp) + t - m) + dr * stiffness * m * m / (2.0 * ramp * ramp)
