"""Mesh, contact faces, constraints and field points of the modelled part of a block under a pin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from skfem import MeshHex

from fe.contact import Faces
from fe.discretisation import Pattern, elements, faces, pattern
from fe.field_motion import FieldProbe, field_probe
from fe.pin_surface import RigidPin, under_flat
from fe.specimens.block_pin_geometry import BlockPin, Contact, Symmetry
from fe.specimens.checks import check_counts
from fe.specimens.mesh_lines import (
    N_DENSITY,
    Dense,
    Pinned,
    bump,
    line_for,
    lines_of_density,
    thinner,
)
from fe.specimens.ring_mesh import Cells, Rings, ring_mesh
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


class Edge(NamedTuple):
    """Lines that stand closer under the edge of a pin, whose half width or radius is the unit."""

    at: float
    dense: Dense


FLAT = 0.85
"""usual half width of a bar's flat over that of the bar"""
GLUED_EDGE = Edge(FLAT, Dense(peak=8.0, spread=0.35))
"""of a bar that sticks: at the edge of its flat the glue ends"""
RUBBING_EDGE = Edge(FLAT, Dense(peak=4.0, spread=0.35))
"""of a bar with friction and more than two elements along it: what sticks under its flat ends near
there, but not on a line of the mesh"""
SLIDING_EDGE = Edge(0.7, Dense(peak=2.0, spread=0.45))
"""of a pin that slides: material that slides past the fillet comes from further in"""
GLUED_RIM = Edge(0.7, Dense(peak=3.0, spread=0.35))
"""of a round pin that sticks: its rim runs across the elements"""
SIDE = Dense(peak=0.7, spread=0.12)
"""at the free side of a glued base, by the length to it: its edge is singular"""
BASE = Dense(peak=5.0, spread=0.1)
"""above a glued base, by the height: close to it the free faces bend sharply"""
TOP = Dense(peak=4.0, spread=0.12)
"""below a glued top, by the height"""
GLUED_DEPTH = 2.25
"""along a bar elements get thinner towards the front face: 1 - (1 - t)^GLUED_DEPTH"""


class Thinning(NamedTuple):
    """How elements get thinner towards an end: t (1 + thinning (1 - t))."""

    front: float
    """along a bar, towards the front face"""
    top: float
    """over the height, towards the top"""


SLIDING = Thinning(front=0.6, top=0.0)
"""of a bar without glue and without friction, or of one or two elements along it"""
RUBBING = Thinning(front=0.9, top=0.0)
"""of a bar with friction and more elements along it: the front face rolls under the pin.  Not
thinner at the top: 16 x 8 x 4 elements so thinned took 331 factorisations in place of 201"""
UNDER_ROUND, STUCK_TO_ROUND = Thinning(front=0.0, top=0.5), Thinning(front=0.0, top=1.0)
"""of a round pin that slides or sticks"""


@dataclass(frozen=True)
class Discretisation:
    """Everything about one specimen that does not depend on the material."""

    elements: Elements
    faces: Faces
    pattern: Pattern
    glued: BoolArray
    """(n_face, n_q) contact points under the pin's flat part"""
    probe: FieldProbe
    """what the field points see of nodal values"""


FieldGrid = tuple[int, int] | tuple[tuple[float, float], ...]
"""numbers of field points along x and y of half the front face, or their own x, y in mm"""


def check_field_grid(grid: FieldGrid, specimen: BlockPin, symmetry: Symmetry) -> None:
    """Raise ValueError for impossible numbers, and for points beside the modelled part's face."""
    found = np.asarray(grid)
    if found.ndim == 1:
        check_counts("field_grid", grid, (1, 1))
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
    if np.ndim(grid) == 2:
        return np.array(grid, dtype=np.float64)
    nx, ny = (int(n) for n in np.asarray(grid))
    x = (np.arange(nx) + 0.5) * specimen.width / 2.0 / nx
    if symmetry != "quarter":
        x = np.concatenate([-x[::-1], x])
    y = (np.arange(ny) + 0.5) * specimen.height / ny
    return np.stack([c.ravel() for c in np.meshgrid(x, y, indexing="ij")], axis=1)


def block_mesh(
    specimen: BlockPin,
    symmetry: Symmetry,
    cells: Cells,
    contact: Contact,
    like: BlockPin | None = None,
) -> MeshHex:
    """Hexahedra of the modelled part, finer where the solution is not smooth.

    Where material passes the pin's edge whole rows of nodes snap past its fillet.  Glued faces are
    singular where they end: at the flat of the pin, and where base and top meet the free faces.
    Elements thin enough for those would make a block that slides chatter, so the lines follow
    what is glued.  Along a bar little happens until near the front face, so the depth takes few
    elements.  One mesh line under a bar that sticks is the edge of its flat, for glue that ends
    inside an element ends somewhere else on every mesh.  Lines are values of one smooth map for all
    numbers of elements, so that meshes of proportional `cells` are similar: under a bar that sticks
    exactly with even numbers along x, whose middle line is that edge.  Of a flat that is narrow or
    nearly as wide as the block it is another line: which, is chosen for the specimen `like` (this
    one, if not given), so that lines do not jump where a dimension is differenced.

    `cells` are numbers of elements of a quarter; a half and a full model have as many on each side
    of the pin's axis.  With `Rings` the lines follow the rim of a round pin instead.
    """
    if isinstance(cells, Rings):
        return ring_mesh(specimen, cells, contact)
    half_depth = specimen.depth / 2.0
    nx, ny, nz = cells
    is_round, sticks = specimen.pin == "round", contact.pin == "stick"
    glued = Glued(not is_round and sticks, not is_round and contact.base == "stick")
    thinning = _thinning(contact, nz, is_round)
    edge = RUBBING_EDGE if thinning is RUBBING else SLIDING_EDGE
    if is_round and sticks:
        edge = GLUED_RIM

    def across(side: Side, n: int) -> Array:
        return _from_axis((specimen, like or specimen), glued, edge, side, n)

    def along(length: float, n: int) -> Array:
        return across(lambda _: length, n) if is_round else _along_bar(glued, thinning, length, n)

    x = _width_lines(lambda side: across(side, nx), symmetry)
    z = along(half_depth, nz)
    if symmetry == "full":
        z1 = specimen.pin_shift[1] if is_round else 0.0
        z = _both_sides(along(half_depth + z1, nz), along(half_depth - z1, nz))
    return MeshHex.init_tensor(x, _height_lines(glued, thinning, specimen.height, ny), z)


Side = Callable[[BlockPin], float]
"""how far the modelled part of a block goes from the pin's axis, mm"""


class Glued(NamedTuple):
    """What of a block under a bar is glued."""

    top: bool
    base: bool


def _thinning(contact: Contact, nz: int, is_round: bool) -> Thinning:
    """Of a block with so many elements along a bar, where nothing of it is glued."""
    if is_round:
        return STUCK_TO_ROUND if contact.pin == "stick" else UNDER_ROUND
    law = contact.friction(1.0)
    return RUBBING if nz > 2 and max(law.pin, law.base) > 0.0 else SLIDING


def _from_axis(
    blocks: tuple[BlockPin, BlockPin], glued: Glued, edge: Edge, side: Side, n: int
) -> Array:
    """(n + 1,) lines at distances from the pin's axis, mm; `edge` of a top that is not glued.

    Of the first of the blocks; for the second is chosen which line is the edge of a flat.
    """
    own, chosen = (_density(block, glued, edge, side(block)) for block in blocks)
    pinned = None
    if glued.top:
        flat, of_chosen = (block.pin_width / 2.0 - block.pin_fillet for block in blocks)
        line = line_for(*chosen, n, of_chosen)
        pinned = None if line is None else Pinned(line, flat)
    return lines_of_density(*own, n, pinned)


def _width_lines(across: Callable[[Side], Array], symmetry: Symmetry) -> Array:
    """Lines over the width from those `across` a side of the pin's axis, mm from the centre."""
    if symmetry == "quarter":
        return across(lambda block: block.width / 2.0)
    return _both_sides(
        across(lambda block: block.width / 2.0 + block.pin_shift[0]),
        across(lambda block: block.width / 2.0 - block.pin_shift[0]),
    )


def _density(specimen: BlockPin, glued: Glued, edge: Edge, length: float) -> tuple[Array, Array]:
    """Distances from the pin's axis, mm, and the density of lines there."""
    unit = specimen.pin_width / 2.0
    x = np.linspace(0.0, length, N_DENSITY)
    at, dense = GLUED_EDGE if glued.top else edge
    density = 1.0 + (bump(length - x, SIDE, length) if glued.base else 0.0)
    return x, density + bump(x - at * unit, dense, unit)


def _along_bar(glued: Glued, thinning: Thinning, length: float, n: int) -> Array:
    """(n + 1,) lines at distances along a bar from the plane of symmetry, mm."""
    if any(glued):
        return length * (1.0 - (1.0 - np.linspace(0.0, 1.0, n + 1)) ** GLUED_DEPTH)
    return thinner(length, thinning.front, n)


def _height_lines(glued: Glued, thinning: Thinning, height: float, n: int) -> Array:
    """(n + 1,) lines above the base, mm."""
    if not any(glued):
        return thinner(height, thinning.top, n)
    y = np.linspace(0.0, height, N_DENSITY)
    density = np.ones(N_DENSITY)
    density += bump(y, BASE, height) if glued.base else 0.0
    density += bump(height - y, TOP, height) if glued.top else 0.0
    return lines_of_density(y, density, n)


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
    met, on_top = contact_faces(mesh, specimen, rubs, ends=not plane_strain)
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
    glued = on_top[:, None] & under_flat(met.points, pin)
    front = np.column_stack([points, np.full(len(points), specimen.depth / 2.0)])
    return Discretisation(
        elements=table,
        faces=met,
        pattern=pattern(table.nodes, met.nodes, fixed.ravel()),
        glued=glued & (contact.pin == "stick"),
        probe=field_probe(basis, front),
    )


def contact_faces(
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
