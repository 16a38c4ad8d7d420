"""Derivative of the forces of a plate in the parameters at a fixed displacement and travel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.plate import Plate, PlateMemory, PlateSlopes
from fe.plate_contact import Coupling, Limits, Normal, slip_share, slips
from fe.surface_slopes import penalty_slope

Array = npt.NDArray[np.float64]


def add_normal_slopes(
    plate: Plate, normal: Normal, modulus: float, slopes: PlateSlopes, total: Array
) -> Array:
    """Add those of the penalty to `total` (n_node, 3, n_p), N per unit.

    `modulus` mu (MPa) scales the penalty.  Returns the derivative (n_edge, n_q, n_p) of weight
    times the penalty's slope in the gap, N: minus the normal force of the points.
    """
    edges = plate.edges
    flat = _penalty_slopes(
        normal.gap.ravel(),
        plate.law.stiffness * modulus,
        plate.law.ramp,
        slopes.stiffness,
        slopes.ramp,
    )
    change = normal.curvature[..., None] * (slopes.height - slopes.points[..., 1, :])
    change += flat.reshape(change.shape)
    pressed: Array = slopes.weights * normal.slope[..., None] + edges.weights[..., None] * change
    push = np.einsum("cqa,cqj->caj", edges.shape, -pressed)
    np.add.at(total[:, 1], edges.nodes, push)
    return pressed


@kernel()
def _penalty_slopes(gap: Array, stiffness: float, ramp: float, dk: Array, dr: Array) -> Array:
    values = np.empty((gap.size, dk.size))
    for i in range(gap.size):
        for j in range(dk.size):
            values[i, j] = penalty_slope(gap[i], stiffness, ramp, dk[j], dr[j])
    return values


def add_friction_slopes(
    plate: Plate,
    u: Array,
    memory: PlateMemory,
    limits: Limits,
    follows: Coupling,
    pressed: Array,
    slopes: PlateSlopes,
    total: Array,
) -> None:
    """Add those of friction to `total` (n_node, 3, n_p), N per unit, where all others are.

    `pressed` is what `add_normal_slopes` returned.
    """
    ends, edges = slips(plate, u, memory)
    by_limit, by_slip = _force_slopes(ends, limits.ends, plate.slip, -memory.end_gradient, slopes)
    changed = limits.ends[:, None] / plate.friction * slopes.friction
    axial = follows.ends[:, None] * total[plate.ends, 1]
    total[plate.ends, 0] += axial + by_limit[:, None] * changed + by_slip
    moved = slopes.points[..., 0, :] - memory.edge_gradient
    by_limit, by_slip = _force_slopes(edges, limits.edges, plate.slip, moved, slopes)
    changed = limits.edges[..., None] / plate.friction * slopes.friction - plate.friction * pressed
    pull = by_limit[..., None] * changed + by_slip
    np.add.at(total[:, 0], plate.edges.nodes, np.einsum("cqa,cqj->caj", plate.edges.shape, pull))


def _force_slopes(
    slip: Array, limit: Array, a: float, moved: Array, slopes: PlateSlopes
) -> tuple[Array, Array]:
    """Derivative of friction's force in its limit, and (..., n_p) at a fixed limit, N per unit.

    `moved` (..., n_p) is that of the slip, mm.
    """
    share, rate = slip_share(slip, a)
    along = moved - (slip / a)[..., None] * slopes.slip
    return share, (limit * rate)[..., None] * along
