"""Surface of a rigid pin with a filleted lower edge: signed distance, normal and Hessian.

Both pins are a plane profile: a bar draws it along a horizontal axis, a round pin turns it about
a vertical one (a cylinder with a flat end and a torus for an edge).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel

Array = npt.NDArray[np.float64]

BAR, ROUND = 0, 1

GRIP = 0.005
"""mm, see fe.contact.PenaltyLaw"""


class RigidPin(NamedTuple):
    """Pin above a block on the floor y = 0, with the stiffness of what it meets."""

    height: float
    """of the pin's flat bottom at travel 0, mm"""
    half_width: float
    """mm, of the bar, or radius of the round pin"""
    fillet: float
    """radius of the lower edges, mm"""
    stiffness: float
    """contact pressure per penetration, MPa/mm"""
    ramp: float
    """mm, see fe.contact.PenaltyLaw"""
    base_stiffness: float = 0.0
    """pressure per displacement u_y of base faces, MPa/mm"""
    shape: int = BAR
    """BAR or ROUND"""
    x: float = 0.0
    """of the pin's vertical axis, mm"""
    z: float = 0.0
    """mm"""
    across_x: float = 1.0
    """x and z of the unit vector across the bar"""
    across_z: float = 0.0
    grip: float = GRIP
    """mm, see fe.contact.PenaltyLaw"""


class PinPoint(NamedTuple):
    """The pin seen from one point."""

    gap: float
    """signed distance, mm, negative inside the pin"""
    nx: float
    """outward normal of the pin, the gradient of the distance"""
    ny: float
    nz: float
    hxx: float
    """Hessian of the distance, 1/mm"""
    hxy: float
    hxz: float
    hyy: float
    hyz: float
    hzz: float


@kernel()
def bar_distance(
    x: float, y: float, half_width: float, fillet: float, bottom: float
) -> tuple[float, float, float, float, float, float]:
    """Signed distance of (x, y) to the profile with filleted lower edges, x from its middle; mm.

    Returns (distance, normal_x, normal_y, H_xx, H_xy, H_yy): the outward normal of the pin is the
    gradient of the distance, H its Hessian (1/mm).
    """
    side = 1.0 if x >= 0.0 else -1.0
    q0 = abs(x) - (half_width - fillet)
    q1 = bottom + fillet - y
    if q0 <= 0.0 or q1 <= 0.0:
        if q0 > q1:
            return q0 - fillet, side, 0.0, 0.0, 0.0, 0.0
        return q1 - fillet, 0.0, -1.0, 0.0, 0.0, 0.0
    radius = np.sqrt(q0 * q0 + q1 * q1)
    nx = side * q0 / radius
    ny = -q1 / radius
    c = 1.0 / max(radius, 1e-6)
    return radius - fillet, nx, ny, c * ny * ny, -c * nx * ny, c * nx * nx


@kernel()
def pin_point(x: Array, travel: float, pin: RigidPin) -> PinPoint:
    """The pin at its travel (mm) seen from x (3,) mm."""
    dx, dz = x[0] - pin.x, x[2] - pin.z
    if pin.shape == ROUND:
        out = max(np.sqrt(dx * dx + dz * dz), 1e-12)
        ex, ez = dx / out, dz / out
    else:
        ex, ez = pin.across_x, pin.across_z
        out = ex * dx + ez * dz
    gap, n, ny, hoo, hoy, hyy = bar_distance(
        out, x[1], pin.half_width, pin.fillet, pin.height - travel
    )
    # the normal of a round pin turns with the point that goes round
    hoop = n / out if pin.shape == ROUND else 0.0
    return PinPoint(
        gap,
        n * ex,
        ny,
        n * ez,
        hoo * ex * ex + hoop * ez * ez,
        hoy * ex,
        (hoo - hoop) * ex * ez,
        hyy,
        hoy * ez,
        hoo * ez * ez + hoop * ex * ex,
    )


def under_flat(points: Array, pin: RigidPin) -> npt.NDArray[np.bool_]:
    """Whether reference points (..., 3) mm lie under the flat part of the pin's bottom."""
    dx, dz = points[..., 0] - pin.x, points[..., 2] - pin.z
    if pin.shape == ROUND:
        out = np.sqrt(dx * dx + dz * dz)
    else:
        out = np.abs(pin.across_x * dx + pin.across_z * dz)
    flat: npt.NDArray[np.bool_] = out <= pin.half_width - pin.fillet
    return flat
