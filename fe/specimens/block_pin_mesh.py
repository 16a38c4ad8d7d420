"""Mesh, contact faces, constraints and field points of the modelled part of a block under a pin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from skfem import MeshHex

from fe.contact import Faces
from fe.discretisation import Pattern, elements, faces, pattern
from fe.field_motion import FieldProbe, field_probe
from fe.pin_surface import RigidPin, under_flat
from fe.specimens.block_lines import (
    Manner,
    along_bar,
    both_sides,
    from_axis,
    manner,
    over_height,
    seen_from_axis,
)
from fe.specimens.block_pin_geometry import BlockPin, Contact, Symmetry
from fe.specimens.field_grid import FieldGrid, own_points
from fe.specimens.ring_mesh import Cells, Rings, ring_mesh
from fe.specimens.turned_bar import bar_mesh
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


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


def check_field_grid(grid: FieldGrid, specimen: BlockPin, symmetry: Symmetry) -> None:
    """Raise ValueError for impossible numbers, and for points beside the modelled part's face."""
    found = own_points(grid)
    if found is None:
        return
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
    """Hexahedra of the modelled part, finer where the solution is not smooth (`block_lines`).

    `cells` are numbers of elements of a quarter; a half and a full model have as many on each side
    of the pin's axis.  With `Rings` the lines follow the rim of a round pin instead; those of a
    full model follow a turned bar (`turned_bar`).  What is chosen, as which line is the edge of a
    flat, is chosen for the specimen `like` (this one, if not given), so that lines do not jump
    where a dimension is differenced.
    """
    if isinstance(cells, Rings):
        return ring_mesh(specimen, cells, contact)
    like = like or specimen
    is_round = specimen.pin == "round"
    if symmetry == "full" and not is_round:
        return bar_mesh(specimen, like, cells, contact)
    nx, ny, nz = cells
    how = manner(contact, is_round, nz)
    behind, before = (
        from_axis(seen_from_axis(specimen, side), seen_from_axis(like, side), how, nx)
        for side in (-1, 1)
    )
    x = before if symmetry == "quarter" else both_sides(behind, before)
    half_depth, shift = specimen.depth / 2.0, specimen.pin_shift[1]
    if not is_round:
        z = along_bar(half_depth, how, nz)
    elif symmetry != "full":
        z = _around(specimen, half_depth, how, nz)
    else:
        sides = (_around(specimen, half_depth + s * shift, how, nz) for s in (1.0, -1.0))
        z = both_sides(*sides)
    return MeshHex.init_tensor(x, over_height(specimen.height, how, ny), z)


def _around(specimen: BlockPin, length: float, how: Manner, n: int) -> Array:
    """(n + 1,) lines along z from the axis of a round pin, mm."""
    seen = seen_from_axis(specimen, 1)._replace(length=length)
    return from_axis(seen, seen, how, n)


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
