"""Mesh, contact faces, constraints and field points of the modelled part of a block under a pin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from skfem import MeshHex

from fe.contact import Faces
from fe.discretisation import Pattern, elements, faces, pattern
from fe.pin_surface import RigidPin, under_flat
from fe.specimens.block_pin_geometry import BlockPin, Contact, Symmetry
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

EDGE_DENSITY = 2.0
"""how much denser the mesh lines are at the pin's edge than far away, less one"""
DEPTH_GRADING = 0.6
"""0 is uniform along the bar; elements shrink towards the front face as it grows to 1"""


@dataclass(frozen=True)
class Discretisation:
    """Everything about one specimen that does not depend on the material."""

    elements: Elements
    faces: Faces
    pattern: Pattern
    glued: BoolArray
    """(n_face, n_q) contact points under the pin's flat part"""
    probe: sp.csr_matrix
    """(n_point, n_node) nodal values to values at the field points"""


def front_points(specimen: BlockPin, symmetry: Symmetry, grid: tuple[int, int]) -> Array:
    """(n_point, 2) reference x, y of the field points on the modelled part of the front face, mm.

    `grid` are their numbers along x and y on half the front face; they are at the centres of
    equal rectangles.
    """
    nx, ny = grid
    x = (np.arange(nx) + 0.5) * specimen.width / 2.0 / nx
    if symmetry != "quarter":
        x = np.concatenate([-x[::-1], x])
    y = (np.arange(ny) + 0.5) * specimen.height / ny
    return np.stack([c.ravel() for c in np.meshgrid(x, y, indexing="ij")], axis=1)


def block_mesh(specimen: BlockPin, symmetry: Symmetry, cells: tuple[int, int, int]) -> MeshHex:
    """Hexahedra of the modelled part, finer where material passes the pin's edge.

    Whole rows of nodes snap past the fillet when the block slides; fine rows there make the
    force curve smooth.  Along a bar little happens until near the front face, so the depth
    takes few elements, finer towards the front; the edge of a round pin passes in both directions.
    `cells` are numbers of elements of a quarter; a half and a full model have as many on each side
    of the pin's axis.
    """
    half_width, half_depth = specimen.width / 2.0, specimen.depth / 2.0
    nx, ny, nz = cells
    x0, z0 = specimen.pin_shift
    edge = specimen.pin_width / 2.0

    def graded(length: float, n: int) -> Array:
        return _graded_lines(length, n, centre=0.7 * edge, spread=0.45 * edge)

    def along_bar(length: float, n: int) -> Array:
        z = np.linspace(0.0, 1.0, n + 1)
        return length * z * (1.0 + DEPTH_GRADING * (1.0 - z))

    x = graded(half_width, nx)
    if symmetry != "quarter":
        x = _both_sides(graded(half_width + x0, nx), graded(half_width - x0, nx))
    is_round = specimen.pin == "round"
    z = graded(half_depth, nz) if is_round else along_bar(half_depth, nz)
    if symmetry == "full":
        behind, before = graded(half_depth + z0, nz), graded(half_depth - z0, nz)
        z = _both_sides(behind, before) if is_round else _both_sides(z, z)
    return MeshHex.init_tensor(x, np.linspace(0.0, specimen.height, ny + 1), z)


def discretise(
    specimen: BlockPin,
    contact: Contact,
    symmetry: Symmetry,
    mesh: MeshHex,
    pin: RigidPin,
    points: Array,
    *,
    plane_strain: bool = False,
) -> Discretisation:
    """Tables of the mesh, contact faces, constraints and field points (n_point, 2) mm.

    In `plane_strain` nothing moves along z, and the faces at its ends meet nothing.
    """
    table, basis = elements(mesh)
    tolerance = 1e-9 * specimen.height
    rubs = contact.friction(1.0).base > 0.0
    contact_faces, on_top = _contact_faces(mesh, specimen, rubs, ends=not plane_strain)
    position = table.positions
    fixed = np.zeros(position.shape, dtype=bool)
    if symmetry == "quarter":
        fixed[position[:, 0] < tolerance, 0] = True
    if symmetry != "full":
        fixed[position[:, 2] < tolerance, 2] = True
    if plane_strain:
        fixed[:, 2] = True
    base = position[:, 1] < tolerance
    fixed[base, 1] = not rubs
    if contact.base == "stick":
        fixed[base] = True
    glued = on_top[:, None] & under_flat(contact_faces.points, pin)
    probe_at = np.vstack([points.T, np.full(len(points), specimen.depth / 2.0)])
    return Discretisation(
        elements=table,
        faces=contact_faces,
        pattern=pattern(table.nodes, contact_faces.nodes, fixed.ravel()),
        glued=glued & (contact.pin == "stick"),
        probe=basis.probes(probe_at).tocsr(),
    )


def _contact_faces(
    mesh: MeshHex, specimen: BlockPin, rubs: bool, *, ends: bool
) -> tuple[Faces, BoolArray]:
    """Faces that may touch, and which of them (n_face,) are on top; the bottom's if it rubs.

    `ends` are the faces across z.
    """
    half_width, height, half_depth = specimen.width / 2.0, specimen.height, specimen.depth / 2.0
    tolerance = 1e-9 * height
    top = mesh.facets_satisfying(lambda x: abs(x[1] - height) < tolerance)
    side = mesh.facets_satisfying(
        lambda x: (
            (abs(abs(x[0]) - half_width) < tolerance)
            | (ends & (abs(abs(x[2]) - half_depth) < tolerance))
        )
    )
    bottom = mesh.facets_satisfying(lambda x: abs(x[1]) < tolerance) if rubs else top[:0]
    kind = np.repeat([0, 1, 2], [top.size, side.size, bottom.size])
    found = faces(mesh, np.concatenate([top, side, bottom]), kind == 1, kind == 2)
    return found, kind == 0


def _both_sides(behind: Array, before: Array) -> Array:
    """Lines on both sides of the pin's axis from those at growing distances from it, mm.

    Counted from the block's centre, between equal ends.
    """
    half = (behind[-1] + before[-1]) / 2.0
    axis = half - before[-1]
    lines = np.concatenate([axis - behind[:0:-1], axis + before])
    lines[[0, -1]] = -half, half
    return lines


def _graded_lines(length: float, n: int, *, centre: float, spread: float) -> Array:
    """(n + 1,) mesh lines on [0, length], mm, densest at `centre` over a width of `spread`."""
    x = np.linspace(0.0, length, 4001)
    density = 1.0 + EDGE_DENSITY * np.exp(-(((x - centre) / spread) ** 2))
    count = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2.0)])
    lines = np.interp(np.linspace(0.0, 1.0, n + 1), count / count[-1], x)
    lines[[0, -1]] = 0.0, length
    return lines
