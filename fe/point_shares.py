"""What the force of a contact point takes of each change at it, at a fixed displacement."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.pin_surface import ROUND, RigidPin
from fe.surface_slopes import seen_from

Array = npt.NDArray[np.float64]

MOTION, REMEMBERED, HOLD, AREA, N_OWN = 0, 3, 6, 7, 8
"""of a point: how it moves (3), what it remembers of the step before (a tie's anchor (3) or the
place it slides from (2)), how firmly it is tied, its area"""
HEIGHT, HALF_WIDTH, FILLET, AXIS_X, AXIS_Z, ANGLE = 0, 1, 2, 3, 4, 5
STIFFNESS, RAMP, BASE_STIFFNESS, FRICTION_PIN, FRICTION_BASE, SLIP, N_SINGLE = range(6, 13)
"""of all points, in the order of `fe.surface_slopes.SurfaceSlopes`"""


class Share(NamedTuple):
    """Derivatives of the points' forces, N: rows x, y, z, and what of y is the pin's."""

    own: Array
    """(n_q, 4, N_OWN)"""
    single: Array
    """(n_q, 4, N_SINGLE)"""


@kernel(inline="always")
def add_seen(
    x: Array, q: int, i: int, v0: float, v1: float, v2: float, pin: RigidPin, share: Share
) -> None:
    """Add to row i the rate v (N/mm) times how the point x (3,) mm moves as the pin sees it.

    `fe.surface_slopes.relative_motion`, transposed.
    """
    ex, ez, side = seen_from(x, pin)
    outwards = side * (v0 * ex + v2 * ez)
    share.own[q, i, MOTION] += v0
    share.own[q, i, MOTION + 1] += v1
    share.own[q, i, MOTION + 2] += v2
    share.single[q, i, HEIGHT] -= v1
    share.single[q, i, HALF_WIDTH] -= outwards
    share.single[q, i, FILLET] += outwards - v1
    share.single[q, i, AXIS_X] -= v0
    share.single[q, i, AXIS_Z] -= v2
    if pin.shape != ROUND:
        share.single[q, i, ANGLE] += v2 * (x[0] - pin.x) - v0 * (x[2] - pin.z)


@kernel(inline="always")
def add_normal_turn(q: int, along_x: float, along_z: float, pin: RigidPin, share: Share) -> None:
    """Add that a force (x and z of it, N) that goes with the pin's surface turns with a bar."""
    if pin.shape != ROUND:
        share.single[q, 0, ANGLE] += along_z
        share.single[q, 2, ANGLE] -= along_x
