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


GLUED_EDGE = Dense(peak=3.0, spread=0.4)
"""of a bar that sticks, at 0.675 of its half width, the unit: glue ends a little further out"""
SLIDING_EDGE = Dense(peak=2.0, spread=0.45)
"""of a bar that slides, and of a round pin, at 0.7 of the half width, the unit: material that
slides past the fillet comes from further in"""
SIDE = Dense(peak=0.7, spread=0.12)
"""at the free side of a glued base, by the length to it: its edge is singular"""
BASE = Dense(peak=5.0, spread=0.1)
"""above a glued base, by the height: close to it the free faces bend sharply"""
TOP = Dense(peak=4.0, spread=0.12)
"""below a glued top, by the height"""
FLAT = 0.85
"""usual half width of a bar's flat over that of the bar"""
N_DENSITY = 4001
"""places at which densities of mesh lines are tabulated"""
GLUED_DEPTH, SLIDING_DEPTH = 2.25, 0.6
"""along a bar elements get thinner towards the front face: 1 - (1 - t)^GLUED_DEPTH, and
t (1 + SLIDING_DEPTH (1 - t)) where nothing is glued"""


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


FieldGrid = tuple[int, int] | tuple[tuple[float, float], ...]
"""numbers of field points along x and y of half the front face, or their own x, y in mm"""


def check_field_grid(grid: FieldGrid, specimen: BlockPin, symmetry: Symmetry) -> None:
    """Raise ValueError for impossible numbers, and for points beside the modelled part's face."""
    found = np.asarray(grid)
    if found.ndim == 1:
        if found.shape != (2,) or found.dtype.kind != "i" or found.min() < 1:
            raise ValueError(f"field_grid: expected 2 whole numbers of at least 1, found {grid}")
        return
    if found.ndim != 2 or found.shape[1] != 2 or not np.isfinite(found).all():
        raise ValueError(f"field_grid: expected points (x, y) in mm, found shape {found.shape}")
    half = specimen.width / 2.0
    low = np.array([0.0 if symmetry == "quarter" else -half, 0.0])
    beside = np.any((found < low) | (found > [half, specimen.height]), axis=1)
    if beside.any():
        raise ValueError(
            f"field_grid: expected points with x from {low[0]:g} to {half:g} mm and y from 0 to "
            f"{specimen.height:g} mm, found {found[beside][0].tolist()}"
        )


def front_points(specimen: BlockPin, symmetry: Symmetry, grid: FieldGrid) -> Array:
    """(n_point, 2) reference x, y of the field points on the modelled part of the front face, mm.

    `grid` are their numbers along x and y on half the front face; they are at the centres of
    equal rectangles.  Or it is the points themselves, which stay where they are when the
    specimen's geometry changes.
    """
    if isinstance(grid[0], tuple):
        return np.array(grid, dtype=np.float64)
    nx, ny = (int(n) for n in np.asarray(grid))
    x = (np.arange(nx) + 0.5) * specimen.width / 2.0 / nx
    if symmetry != "quarter":
        x = np.concatenate([-x[::-1], x])
    y = (np.arange(ny) + 0.5) * specimen.height / ny
    return np.stack([c.ravel() for c in np.meshgrid(x, y, indexing="ij")], axis=1)


def block_mesh(
    specimen: BlockPin, symmetry: Symmetry, cells: tuple[int, int, int], contact: Contact
) -> MeshHex:
    """Hexahedra of the modelled part, finer where the solution is not smooth.

    Where material passes the pin's edge whole rows of nodes snap past its fillet.  Glued faces are
    singular where they end: at the flat of the pin, and where base and top meet the free faces.
    Elements thin enough for those would make a block that slides chatter, so the lines follow
    what is glued.  Along a bar little happens until near the front face, so the depth takes few
    elements.  One mesh line under a bar that sticks is the edge of its flat, for glue that ends
    inside an element ends somewhere else on every mesh.  Lines are values of one smooth map for all
    numbers of elements, so that meshes of proportional `cells` are similar: exactly, where the
    nearest line to that edge is the same one, as with even numbers along x.

    `cells` are numbers of elements of a quarter; a half and a full model have as many on each side
    of the pin's axis.
    """
    half_width, half_depth = specimen.width / 2.0, specimen.depth / 2.0
    nx, ny, nz = cells
    x0, z0 = specimen.pin_shift
    is_round = specimen.pin == "round"
    glued = Glued(not is_round and contact.pin == "stick", not is_round and contact.base == "stick")

    def across(length: float, n: int) -> Array:
        return _from_axis(specimen, glued, length, n)

    def along(length: float, n: int) -> Array:
        return across(length, n) if is_round else _along_bar(glued, length, n)

    x = across(half_width, nx)
    if symmetry != "quarter":
        x = _both_sides(across(half_width + x0, nx), across(half_width - x0, nx))
    z = along(half_depth, nz)
    if symmetry == "full":
        z1 = z0 if is_round else 0.0
        z = _both_sides(along(half_depth + z1, nz), along(half_depth - z1, nz))
    return MeshHex.init_tensor(x, _height_lines(glued, specimen.height, ny), z)


class Glued(NamedTuple):
    """What of a block under a bar is glued."""

    top: bool
    base: bool


def _from_axis(specimen: BlockPin, glued: Glued, length: float, n: int) -> Array:
    """(n + 1,) lines at distances from the pin's axis, mm."""
    edge = specimen.pin_width / 2.0
    x = np.linspace(0.0, length, N_DENSITY)
    density = 1.0 + (_bump(length - x, SIDE, length) if glued.base else 0.0)
    if not glued.top:
        return _lines(x, density + _bump(x - 0.7 * edge, SLIDING_EDGE, edge), n)
    density = density + _bump(x - 0.675 * edge, GLUED_EDGE, edge)
    return _lines(x, density, n, through=(edge - specimen.pin_fillet, FLAT * edge))


def _along_bar(glued: Glued, length: float, n: int) -> Array:
    """(n + 1,) lines at distances along a bar from the plane of symmetry, mm."""
    t = np.linspace(0.0, 1.0, n + 1)
    if any(glued):
        return length * (1.0 - (1.0 - t) ** GLUED_DEPTH)
    return length * t * (1.0 + SLIDING_DEPTH * (1.0 - t))


def _height_lines(glued: Glued, height: float, n: int) -> Array:
    """(n + 1,) lines above the base, mm."""
    if not any(glued):
        return np.linspace(0.0, height, n + 1)
    y = np.linspace(0.0, height, N_DENSITY)
    density = np.ones(N_DENSITY)
    density += _bump(y, BASE, height) if glued.base else 0.0
    density += _bump(height - y, TOP, height) if glued.top else 0.0
    return _lines(y, density, n)


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


def _lines(x: Array, density: Array, n: int, through: tuple[float, float] | None = None) -> Array:
    """(n + 1,) mesh lines from x[0] to x[-1], mm, spaced as the inverse of the density at x.

    The line nearest to the second place of `through`, unless it is an end, is moved to the first,
    and its neighbours with it: the same line wherever the first is, so that lines move smoothly.
    """
    share = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2.0)])
    share /= share[-1]
    at = np.linspace(0.0, 1.0, n + 1)
    if through is not None and x[0] < through[0] < x[-1]:
        wanted, usual = (float(np.interp(place, x, share)) for place in through)
        nearest = round(n * usual)
        if 0 < nearest < n:
            at = np.interp(at, [0.0, nearest / n, 1.0], [0.0, wanted, 1.0])
    lines = np.interp(at, share, x)
    lines[[0, -1]] = x[0], x[-1]
    return lines
