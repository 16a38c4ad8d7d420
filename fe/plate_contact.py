"""Normal contact with a rigid plate and Coulomb friction on it.

Friction acts on the ends and on edges that touch: a force that grows with the radial slip s from an
anchor and is the limit from a slip of a on, as under a pin (`fe.friction.slip_potential`).  At the
end of a step anchors are drawn behind (`fe.plate.moved_anchors`).  The limit is the coefficient
times the normal force of the same state: on edges the penalty's, on ends the nodal reaction of the
solid.  The force has no potential.  For the line search there is one with the limits frozen
(`Limits`) at an iterate, where both have the same gradient; its Hessian is the symmetric matrix
that is factorised.  What the tangent has beyond it is `Coupling`: an end's radial force changes
with its axial one, so its row of the tangent is the axial row times a factor.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.contact import penalty
from fe.plate import Plate, PlateMemory, edge_positions

Array = npt.NDArray[np.float64]


class Normal(NamedTuple):
    """Penalty of the edges at one state, (n_edge, n_q) each."""

    gap: Array
    """mm"""
    energy: Array
    """N/mm"""
    slope: Array
    """derivative in the gap, MPa"""
    curvature: Array
    """MPa/mm"""


class Limits(NamedTuple):
    """Largest friction forces, frozen at one displacement."""

    ends: Array
    """(n_end,) N"""
    edges: Array
    """(n_edge, n_q) N"""


class Friction(NamedTuple):
    """Frozen friction of some points: energy (N mm), force (N), stiffness (N/mm)."""

    energy: Array
    force: Array
    stiffness: Array


class Coupling(NamedTuple):
    """What friction's forces change by as their limits change."""

    ends: Array
    """(n_end,) change of an end's radial force with its axial one"""
    edges: Array
    """(n_edge, n_q) change of a point's radial force with its z, N/mm"""


def normal_contact(plate: Plate, u: Array, travel: float, modulus: float) -> Normal:
    """Penalty at u (n_node, 3) mm, travel mm; `modulus` mu (MPa) scales it."""
    gap = plate.height - plate.speed * travel - edge_positions(plate.edges, u)[..., 1]
    values = _penalties(gap.ravel(), plate.law.stiffness * modulus, plate.law.ramp)
    return Normal(gap, *values.reshape(3, *gap.shape))


@kernel()
def _penalties(gap: Array, stiffness: float, ramp: float) -> Array:
    values = np.empty((3, gap.size))
    for i in range(gap.size):
        values[0, i], values[1, i], values[2, i] = penalty(gap[i], stiffness, ramp)
    return values


def normal_energy(plate: Plate, normal: Normal) -> float:
    """Energy of the penalty, N mm."""
    return float(np.sum(plate.edges.weights * normal.energy))


def add_normal_forces(plate: Plate, normal: Normal, forces: Array) -> None:
    """Add the penalty's to the nodal forces (n_node, 3), N."""
    edges = plate.edges
    push = -edges.weights * normal.slope
    np.add.at(forces[:, 1], edges.nodes, np.einsum("cqa,cq->ca", edges.shape, push))


def normal_tangent(plate: Plate, normal: Normal) -> Array:
    """(n_edge, 3, 3, 3, 3) [a, i, k, b] of the penalty, N/mm."""
    tangent = np.zeros((len(plate.edges.nodes), 3, 3, 3, 3))
    tangent[:, :, 1, 1, :] = _stiffness(plate, plate.edges.weights * normal.curvature)
    return tangent


def _stiffness(plate: Plate, values: Array) -> Array:
    """(n_edge, 3, 3) nodal from values at points (n_edge, n_q)."""
    shape = plate.edges.shape
    nodal: Array = np.einsum("cqa,cq,cqb->cab", shape, values, shape)
    return nodal


def normal_by_travel(plate: Plate, normal: Normal, motion: Array) -> Array:
    """(n_node, 3) change of the penalty's forces per travel, N/mm: plate and nodes move."""
    edges = plate.edges
    change = edges.weights * normal.curvature * approach(plate, motion)
    total = np.zeros(motion.shape)
    np.add.at(total[:, 1], edges.nodes, np.einsum("cqa,cq->ca", edges.shape, change))
    return total


def approach(plate: Plate, motion: Array) -> Array:
    """(n_edge, n_q) closing of the gap per travel where nodes move by `motion` (n_node, 3)."""
    edges = plate.edges
    closing: Array = plate.speed + np.einsum("cqa,ca->cq", edges.shape, motion[edges.nodes, 1])
    return closing


def travel_force(plate: Plate, normal: Normal) -> float:
    """Derivative of the penalty's energy in the travel at fixed nodes, N."""
    return float(-plate.speed * np.sum(plate.edges.weights * normal.slope))


def travel_force_slope(plate: Plate, normal: Normal, motion: Array) -> float:
    """Its change per travel where plate and nodes (their motion) move, N/mm."""
    change = plate.edges.weights * normal.curvature * approach(plate, motion)
    return float(plate.speed * np.sum(change))


def friction_limits(plate: Plate, normal: Normal, forces: Array) -> Limits:
    """Limits at nodal forces (n_node, 3) N without friction, negative z in compression."""
    return Limits(
        ends=plate.friction * np.maximum(-forces[plate.ends, 1], 0.0),
        edges=plate.friction * plate.edges.weights * -normal.slope,
    )


def frozen_friction(
    plate: Plate, u: Array, memory: PlateMemory, limits: Limits
) -> tuple[Friction, Friction]:
    """Friction of ends and of edges at u (n_node, 3) mm under these limits."""
    ends, edges = slips(plate, u, memory)
    return _friction(ends, limits.ends, plate.slip), _friction(edges, limits.edges, plate.slip)


def slips(plate: Plate, u: Array, memory: PlateMemory) -> tuple[Array, Array]:
    """Radial slips of ends and edges, mm."""
    place = edge_positions(plate.edges, u)[..., 0]
    return u[plate.ends, 0] - memory.end_anchor, place - memory.edge_anchor


def _friction(slip: Array, limit: Array, a: float) -> Friction:
    x2 = np.minimum((slip / a) ** 2, 1.0)
    inside = a * x2 * (0.75 - 0.125 * x2)
    energy = np.where(x2 < 1.0, inside, np.abs(slip) - 0.375 * a)
    share, rate = slip_share(slip, a)
    return Friction(limit * energy, limit * share, limit * rate)


def slip_share(slip: Array, a: float) -> tuple[Array, Array]:
    """Share of its limit that friction has at a slip, mm, with its sign, and its slope, 1/mm.

    The gradient of `fe.friction.slip_potential` along a line.
    """
    x = np.clip(slip / a, -1.0, 1.0)
    return x * (1.5 - 0.5 * x**2), 1.5 * (1.0 - x**2) / a


def add_friction_forces(plate: Plate, ends: Friction, edges: Friction, forces: Array) -> None:
    """Add friction's to the nodal forces (n_node, 3), N."""
    forces[plate.ends, 0] += ends.force
    pull = np.einsum("cqa,cq->ca", plate.edges.shape, edges.force)
    np.add.at(forces[:, 0], plate.edges.nodes, pull)


def add_friction_tangent(plate: Plate, edges: Friction, tangent: Array) -> None:
    """Add the frozen friction of edges to (n_edge, 3, 3, 3, 3) [a, i, k, b], N/mm."""
    tangent[:, :, 0, 0, :] += _stiffness(plate, edges.stiffness)


def coupling(
    plate: Plate, u: Array, memory: PlateMemory, normal: Normal, limits: Limits
) -> Coupling:
    """How friction follows its limits at u (n_node, 3) mm."""
    ends, edges = (slip_share(s, plate.slip)[0] for s in slips(plate, u, memory))
    pressed = limits.ends > 0.0
    return Coupling(
        ends=np.where(pressed, -plate.friction * ends, 0.0),
        edges=plate.friction * plate.edges.weights * normal.curvature * edges,
    )


def edge_coupling(plate: Plate, follows: Coupling, tangent: Array) -> Array:
    """(n_edge, 3, 3, 3, 3) [a, i, k, b] that edges add to the tangent, N/mm.

    `tangent` is that of the penalty, which also acts on the ends' nodes.
    """
    found = follow_ends(plate, follows, plate.edges.nodes, tangent)
    found[:, :, 0, 1, :] += _stiffness(plate, follows.edges)
    return found


def follow_ends(
    plate: Plate, follows: Coupling, nodes: npt.NDArray[np.int64], tangent: Array
) -> Array:
    """What the ends' friction adds to parts (n, a) with this tangent (n, a, 3, 3, a), N/mm."""
    factor = np.zeros(int(max(nodes.max(), plate.ends.max())) + 1)
    factor[plate.ends] = follows.ends
    found = np.zeros(tangent.shape)
    found[:, :, 0] = factor[nodes][..., None, None] * tangent[:, :, 1]
    return found


def add_coupling_by_travel(
    plate: Plate, follows: Coupling, motion: Array, by_travel: Array
) -> None:
    """Add to the change (n_node, 3) of the forces per travel (N/mm) that of friction's limits."""
    by_travel[plate.ends, 0] += follows.ends * by_travel[plate.ends, 1]
    change = follows.edges * approach(plate, motion)
    pull = np.einsum("cqa,cq->ca", plate.edges.shape, change)
    np.add.at(by_travel[:, 0], plate.edges.nodes, pull)
