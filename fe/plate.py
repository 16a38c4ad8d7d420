"""A rigid flat plate on top of an axisymmetric solid: normal contact and Coulomb friction.

The plate's face is z = height - speed * travel.  The nodes of the solid's own end face move with
it (prescribed motion, no penalty); free side faces that roll over onto it meet the penalty of
fe.contact at Gauss points of their edges.  Friction acts on both: a potential limit *
(sqrt(s^2 + a^2) - a) in the radial slip s since the last step, whose limit is the coefficient times
the normal force, held during an equilibrium and renewed between (lagged).  The traction is then
limit * s / sqrt(s^2 + a^2): Coulomb's for slips a step well above a.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from skfem import ElementQuad2, FacetBasis, MeshQuad

from fe.contact import PenaltyLaw, penalty
from fe.discretisation import FACE_ORDER

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class Edges(NamedTuple):
    """Quadrature of the edges of a section that may touch a plate."""

    nodes: IntArray
    """(n_edge, 3)"""
    shape: Array
    """(n_edge, n_q, 3) shape functions"""
    weights: Array
    """(n_edge, n_q) reference area of the whole ring, mm2"""
    points: Array
    """(n_edge, n_q, 2) reference (r, z), mm"""


@dataclass(frozen=True)
class Plate:
    """A plate, what it may touch, and how; raises ValueError for numbers out of range."""

    height: float
    """z of its face at travel 0, mm"""
    speed: float
    """how far it comes down for a travel of 1 mm"""
    ends: IntArray
    """(n_end,) nodes that move with it"""
    edges: Edges
    friction: float = 0.0
    """coefficient, on ends and edges; bonded ends do not slip"""
    slip: float = 0.01
    """a of the friction potential, mm"""
    law: PenaltyLaw = field(default_factory=PenaltyLaw)

    def __post_init__(self) -> None:
        if not self.friction >= 0.0:
            raise ValueError(f"friction: expected a coefficient of at least 0, got {self.friction}")
        if not self.slip > 0.0:
            raise ValueError(f"slip: expected a length above 0 mm, found {self.slip}")


@dataclass(frozen=True)
class PlateMemory:
    """What friction remembers between equilibria; without friction it stays as it is made."""

    end_anchor: Array
    """(n_end,) u_r from which slip counts, mm"""
    end_limit: Array
    """(n_end,) largest friction force, N"""
    edge_anchor: Array
    """(n_edge, n_q) r from which slip counts, mm"""
    edge_limit: Array
    """(n_edge, n_q) largest friction force, N"""


class Touch(NamedTuple):
    """Energy of plate and friction and its derivatives at one state."""

    energy: float
    """N mm"""
    forces: Array
    """(n_node, 3) N"""
    by_travel: Array
    """(n_node, 3) derivative of `forces` in the travel, N/mm"""
    travel_force: float
    """derivative of the energy in the travel, N"""
    face_tangent: Array
    """(n_edge, 3, 3, 3, 3) indexed [a, i, k, b], N/mm"""
    nodal_stiffness: Array
    """(n_node, 3) friction of the ends, diagonal, N/mm"""


def ring_edges(mesh: MeshQuad, facets: IntArray) -> Edges:
    """Quadrature of the facets (n_edge,) of a section (r, z), areas of the whole ring."""
    basis = FacetBasis(mesh, ElementQuad2(), facets=facets, intorder=FACE_ORDER)
    points = np.asarray(basis.global_coordinates())
    values = np.stack([np.broadcast_to(np.asarray(p[0]), points.shape[1:]) for p in basis.basis])
    on_edge = np.abs(values).max(axis=2) > 1e-12
    local = np.stack([np.flatnonzero(column) for column in on_edge.T])
    rows = np.arange(len(facets))[:, None]
    return Edges(
        nodes=np.ascontiguousarray(basis.element_dofs[local, rows], dtype=np.int64),
        shape=np.ascontiguousarray(values[local, rows].transpose(0, 2, 1)),
        weights=2.0 * np.pi * points[0] * np.asarray(basis.dx),
        points=np.ascontiguousarray(points.transpose(1, 2, 0)),
    )


def initial_memory(plate: Plate) -> PlateMemory:
    """Memory of the undeformed state, no normal force yet."""
    n_end = plate.ends.size
    return PlateMemory(
        end_anchor=np.zeros(n_end),
        end_limit=np.zeros(n_end),
        edge_anchor=plate.edges.points[..., 0].copy(),
        edge_limit=np.zeros(plate.edges.weights.shape),
    )


def evaluate(plate: Plate, u: Array, travel: float, memory: PlateMemory, modulus: float) -> Touch:
    """Plate and friction at u (n_node, 3) mm, travel mm; `modulus` mu (MPa) scales the penalty."""
    edges = plate.edges
    position = _edge_positions(edges, u)
    e, slope, curvature = _normal(plate, position[..., 1], travel, modulus)
    slip = position[..., 0] - memory.edge_anchor
    rub, pull, stiffness = _friction(slip, memory.edge_limit, plate.slip)
    w = edges.weights
    force = np.stack([pull, -w * slope, np.zeros_like(w)], axis=2)
    hessian = np.stack([stiffness, w * curvature], axis=2)
    forces = np.zeros(u.shape)
    np.add.at(forces, edges.nodes, np.einsum("cqa,cqi->cai", edges.shape, force))
    by_travel = np.zeros(u.shape)
    down = plate.speed * w * curvature
    np.add.at(by_travel[:, 1], edges.nodes, np.einsum("cqa,cq->ca", edges.shape, down))
    tangent = np.zeros((len(edges.nodes), 3, 3, 3, 3))
    for i in range(2):
        tangent[:, :, i, i, :] = np.einsum(
            "cqa,cq,cqb->cab", edges.shape, hessian[..., i], edges.shape
        )
    nodal = np.zeros(u.shape)
    end_rub, end_pull, end_stiffness = _friction(
        u[plate.ends, 0] - memory.end_anchor, memory.end_limit, plate.slip
    )
    forces[plate.ends, 0] += end_pull
    nodal[plate.ends, 0] = end_stiffness
    return Touch(
        energy=float(np.sum(w * e) + rub.sum() + end_rub.sum()),
        forces=forces,
        by_travel=by_travel,
        travel_force=float(-plate.speed * np.sum(w * slope)),
        face_tangent=tangent,
        nodal_stiffness=nodal,
    )


def tangent_times(plate: Plate, touch: Touch, motion: Array) -> Array:
    """(n_node, 3) change of the forces per travel, N/mm: plate and nodes (their motion) move."""
    total = touch.by_travel + touch.nodal_stiffness * motion
    nodes = plate.edges.nodes
    moved = np.einsum("caikb,cbk->cai", touch.face_tangent, motion[nodes])
    np.add.at(total, nodes, moved)
    return total


def travel_slope(plate: Plate, touch: Touch, motion: Array) -> float:
    """Change of `travel_force` per travel, N/mm, where plate and nodes (their motion) move.

    At fixed nodes it is the speed times the sum of `by_travel`: shape functions add up to 1.
    """
    return float(np.sum(touch.by_travel * motion) + plate.speed * touch.by_travel[:, 1].sum())


def renewed_limits(
    plate: Plate, memory: PlateMemory, u: Array, travel: float, modulus: float, end_force: Array
) -> PlateMemory:
    """The memory with the friction limits of this state, anchors held.

    `end_force` (n_end,) is the force of the plate on its end nodes, N, negative in compression.
    """
    _, slope, _ = _normal(plate, _edge_positions(plate.edges, u)[..., 1], travel, modulus)
    return PlateMemory(
        end_anchor=memory.end_anchor,
        end_limit=plate.friction * np.maximum(-end_force, 0.0),
        edge_anchor=memory.edge_anchor,
        edge_limit=plate.friction * plate.edges.weights * -slope,
    )


def renewed_anchors(plate: Plate, memory: PlateMemory, u: Array) -> PlateMemory:
    """The memory from which the next step's slip counts."""
    return PlateMemory(
        end_anchor=u[plate.ends, 0].copy(),
        end_limit=memory.end_limit,
        edge_anchor=_edge_positions(plate.edges, u)[..., 0],
        edge_limit=memory.edge_limit,
    )


def _edge_positions(edges: Edges, u: Array) -> Array:
    """(n_edge, n_q, 2) current (r, z), mm."""
    x: Array = edges.points + np.einsum("cqa,cai->cqi", edges.shape, u[edges.nodes, :2])
    return x


def _normal(plate: Plate, z: Array, travel: float, modulus: float) -> tuple[Array, Array, Array]:
    """Energy density and derivatives in the gap (n_edge, n_q) where the surface is at z, mm."""
    gap = plate.height - plate.speed * travel - z
    values = _penalties(gap.ravel(), plate.law.stiffness * modulus, plate.law.ramp)
    e, slope, curvature = values.reshape(3, *gap.shape)
    return e, slope, curvature


@njit(cache=True)
def _penalties(gap: Array, stiffness: float, ramp: float) -> Array:
    values = np.empty((3, gap.size))
    for i in range(gap.size):
        values[0, i], values[1, i], values[2, i] = penalty(gap[i], stiffness, ramp)
    return values


def _friction(slip: Array, limit: Array, a: float) -> tuple[Array, Array, Array]:
    """Energy (N mm), force (N) and stiffness (N/mm) of slips (mm) under limits (N)."""
    root = np.sqrt(slip**2 + a**2)
    return limit * (root - a), limit * slip / root, limit * a**2 / root**3
