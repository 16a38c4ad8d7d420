"""A rigid flat plate on top of an axisymmetric solid: what it is, touches and remembers.

The plate's face is z = height - speed * travel.  The nodes of the solid's own end face move with
it (prescribed motion, no penalty); free side faces that roll over onto it meet the penalty of
fe.contact at Gauss points of their edges.  `fe.plate_contact` has the forces.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from skfem import ElementQuad2, FacetBasis, MeshQuad

from fe.contact import PenaltyLaw
from fe.discretisation import FACE_ORDER
from fe.pin_contact import DEEP, penetration_doubt

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


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
    """a of the friction potential, mm: from this slip on friction is its limit"""
    law: PenaltyLaw = field(default_factory=PenaltyLaw)

    def __post_init__(self) -> None:
        if not self.friction >= 0.0:
            raise ValueError(
                f"friction: expected a coefficient of at least 0, found {self.friction}"
            )
        if not self.slip > 0.0:
            raise ValueError(f"slip: expected a length above 0 mm, found {self.slip}")


@dataclass(frozen=True)
class PlateMemory:
    """From where slip counts, and how that depends on the n_p parameters of the march."""

    end_anchor: Array
    """(n_end,) u_r, mm"""
    edge_anchor: Array
    """(n_edge, n_q) r, mm"""
    end_gradient: Array
    """(n_end, n_p) d end_anchor / d parameter, mm"""
    edge_gradient: Array
    """(n_edge, n_q, n_p)"""


class PlateSlopes(NamedTuple):
    """Derivatives of plate and edges in the n_p parameters, each per unit of its parameter."""

    points: Array
    """(n_edge, n_q, 2, n_p) of the reference (r, z), mm"""
    weights: Array
    """(n_edge, n_q, n_p) of the areas, mm2"""
    height: Array
    """(n_p,) mm"""
    stiffness: Array
    """(n_p,) of the contact stiffness, MPa/mm"""
    ramp: Array
    """(n_p,) of the penetration over which it grows, mm"""
    friction: Array
    """(n_p,) of the coefficient"""
    slip: Array
    """(n_p,) of a, mm"""


def no_slopes(edges: Edges, n_p: int) -> PlateSlopes:
    """Slopes of `n_p` parameters that change no plate, to be filled where they do."""
    return PlateSlopes(
        np.zeros((*edges.points.shape, n_p)),
        np.zeros((*edges.weights.shape, n_p)),
        *(np.zeros(n_p) for _ in range(len(PlateSlopes._fields) - 2)),
    )


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


def edge_positions(edges: Edges, u: Array) -> Array:
    """(n_edge, n_q, 2) current (r, z) at u (n_node, 3), mm."""
    x: Array = edges.points + np.einsum("cqa,cai->cqi", edges.shape, u[edges.nodes, :2])
    return x


def initial_memory(plate: Plate, slopes: PlateSlopes) -> PlateMemory:
    """Memory of the undeformed state."""
    n_p = slopes.height.size
    return PlateMemory(
        end_anchor=np.zeros(plate.ends.size),
        edge_anchor=plate.edges.points[..., 0].copy(),
        end_gradient=np.zeros((plate.ends.size, n_p)),
        edge_gradient=slopes.points[..., 0, :].copy(),
    )


def moved_anchors(
    plate: Plate,
    slopes: PlateSlopes,
    memory: PlateMemory,
    pressed: tuple[BoolArray, BoolArray],
    u: Array,
    u_gradient: Array,
) -> PlateMemory:
    """The memory at the end of a step (return mapping): what slid draws its anchor behind it.

    To the slip a, from which friction is its limit; what sticks keeps it, and what is not `pressed`
    ((n_end,), (n_edge, n_q)) takes it along.  u (n_node, 3) mm, its derivatives (n_node, 3, n_p).
    """
    edges = plate.edges
    along = np.einsum("cqa,caj->cqj", edges.shape, u_gradient[edges.nodes, 0])
    moved = slopes.points[..., 0, :] + along
    place = edge_positions(edges, u)[..., 0]
    ends, end_gradient = _drawn(
        plate.slip,
        slopes.slip,
        pressed[0],
        (u[plate.ends, 0], u_gradient[plate.ends, 0]),
        (memory.end_anchor, memory.end_gradient),
    )
    on_edges, edge_gradient = _drawn(
        plate.slip,
        slopes.slip,
        pressed[1],
        (place, moved),
        (memory.edge_anchor, memory.edge_gradient),
    )
    return PlateMemory(ends, on_edges, end_gradient, edge_gradient)


def _drawn(
    a: float,
    a_slope: Array,
    pressed: BoolArray,
    here: tuple[Array, Array],
    anchor: tuple[Array, Array],
) -> tuple[Array, Array]:
    """Anchors (..., ) drawn behind places, each with its derivatives (..., n_p), mm."""
    slip = here[0] - anchor[0]
    behind = np.where(pressed, np.sign(slip), 0.0)
    drawn = ~pressed | (np.abs(slip) > a)
    place = np.where(drawn, here[0] - a * behind, anchor[0])
    gradient = here[1] - behind[..., None] * a_slope
    return place, np.where(drawn[..., None], gradient, anchor[1])


def doubts(plate: Plate, u: Array, travel: float) -> list[tuple[str, str]]:
    """What makes contact of the sides at a travel, mm, doubtful: (kind, sentence) each."""
    left = plate.height - plate.speed * travel
    deepest = float((edge_positions(plate.edges, u)[..., 1] - left).max(initial=0.0))
    if not deepest > DEEP * left:
        return []
    return [penetration_doubt(deepest, "plate", travel, left)]
