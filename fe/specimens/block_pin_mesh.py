"""Mesh, contact faces, constraints and field points of the modelled part of a block under a pin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

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


class Dense(NamedTuple):
    """Where mesh lines stand closer: their density is 1 + `peak` at a place, 1 far from it."""

    peak: float
    spread: float
    """fraction of the length that it is measured by"""


BAR_EDGE = Dense(peak=3.0, spread=0.4)
"""at 0.675 of the bar's half width, the unit: glue ends a little further out; material that slides
past the fillet comes from further in"""
ROUND_EDGE = Dense(peak=2.0, spread=0.45)
"""at 0.7 of the pin's radius, the unit: weaker, for the edge passes in both directions"""
SIDE = Dense(peak=0.7, spread=0.12)
"""at the free side beside a bar, by the length to it: the edge of a glued base is singular"""
BASE = Dense(peak=5.0, spread=0.1)
"""under a bar, by the height: close to a glued base the free faces bend sharply"""
TOP = Dense(peak=4.0, spread=0.12)
"""under a bar, by the height"""
N_DENSITY = 4001
"""places at which densities of mesh lines are tabulated"""
DEPTH_POWER = 2.25
"""1 is uniform along a bar; the front face's elements get thinner as it grows"""


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
    """Hexahedra of the modelled part, finer where the solution is not smooth.

    That is where glued faces end: at the flat of the pin, where also whole rows of nodes snap past
    the fillet when the block slides, and where base and top meet the free faces.  Along a bar
    little happens until near the front face, so the depth takes few elements.  One mesh line under
    a bar is the edge of its flat, for glue that ends inside an element ends somewhere else on every
    mesh.  Lines are values of one smooth map for all numbers of elements, so that meshes of
    proportional `cells` are similar: exactly, where the nearest line to that edge is the same one,
    as with a fillet of 0.3 mm and even numbers along x.

    `cells` are numbers of elements of a quarter; a half and a full model have as many on each side
    of the pin's axis.
    """
    half_width, half_depth = specimen.width / 2.0, specimen.depth / 2.0
    nx, ny, nz = cells
    x0, z0 = specimen.pin_shift
    if specimen.pin == "round":
        y = np.linspace(0.0, specimen.height, ny + 1)
        z = _from_round_pin(specimen, half_depth, nz)
        behind = _from_round_pin(specimen, half_depth + z0, nz)
        before = _from_round_pin(specimen, half_depth - z0, nz)
        from_axis = _from_round_pin
    else:
        y = _height_lines(specimen.height, ny)
        z = half_depth * (1.0 - (1.0 - np.linspace(0.0, 1.0, nz + 1)) ** DEPTH_POWER)
        behind = before = z
        from_axis = _from_bar
    x = from_axis(specimen, half_width, nx)
    if symmetry != "quarter":
        left, right = (from_axis(specimen, half_width + s, nx) for s in (x0, -x0))
        x = _both_sides(left, right)
    if symmetry == "full":
        z = _both_sides(behind, before)
    return MeshHex.init_tensor(x, y, z)


def _from_bar(specimen: BlockPin, length: float, n: int) -> Array:
    """(n + 1,) lines at distances from the bar's axis, mm, one of them at the edge of its flat."""
    edge = specimen.pin_width / 2.0
    x = np.linspace(0.0, length, N_DENSITY)
    density = 1.0 + _bump(x - 0.675 * edge, BAR_EDGE, edge) + _bump(length - x, SIDE, length)
    return _lines(x, density, n, through=edge - specimen.pin_fillet)


def _from_round_pin(specimen: BlockPin, length: float, n: int) -> Array:
    """(n + 1,) lines at distances along x or z from the axis of a round pin, mm."""
    edge = specimen.pin_width / 2.0
    x = np.linspace(0.0, length, N_DENSITY)
    return _lines(x, 1.0 + _bump(x - 0.7 * edge, ROUND_EDGE, edge), n)


def _height_lines(height: float, n: int) -> Array:
    """(n + 1,) lines above the base of a block under a bar, mm."""
    y = np.linspace(0.0, height, N_DENSITY)
    return _lines(y, 1.0 + _bump(y, BASE, height) + _bump(height - y, TOP, height), n)


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


def _bump(distance: Array, dense: Dense, unit: float) -> Array:
    """Density of mesh lines above the background at a distance, mm."""
    return dense.peak * np.exp(-((distance / (dense.spread * unit)) ** 2))


def _lines(x: Array, density: Array, n: int, through: float | None = None) -> Array:
    """(n + 1,) mesh lines from x[0] to x[-1], mm, spaced as the inverse of the density at x.

    The line nearest to `through`, unless it is an end, is moved there and its neighbours with it.
    """
    share = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2.0)])
    share /= share[-1]
    at = np.linspace(0.0, 1.0, n + 1)
    if through is not None and x[0] < through < x[-1]:
        wanted = float(np.interp(through, x, share))
        nearest = round(n * wanted)
        if 0 < nearest < n:
            at = np.interp(at, [0.0, nearest / n, 1.0], [0.0, wanted, 1.0])
    lines = np.interp(at, share, x)
    lines[[0, -1]] = x[0], x[-1]
    return lines
