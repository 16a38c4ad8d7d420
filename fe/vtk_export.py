"""A solved specimen as a file that ParaView opens: its elements and nodal values."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from skfem import Element, ElementHex1, ElementHex2, ElementQuad2

from fe.materials.material import Material
from fe.solid import Solid
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

# corners, edges, faces and centre of VTK_TRIQUADRATIC_HEXAHEDRON in its own coordinates, halves
_HEXAHEDRON = np.array(
    [
        *[(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)],
        *[(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2)],
        *[(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)],
        *[(0, 1, 1), (2, 1, 1), (1, 0, 1), (1, 2, 1), (1, 1, 0), (1, 1, 2), (1, 1, 1)],
    ]
)
# corners, edges and centre of VTK_BIQUADRATIC_QUAD
_QUADRILATERAL = np.array([(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1)])


class _Cell(NamedTuple):
    """An element as meshio names it and VTK orders it."""

    name: str
    element: type[Element]
    nodes: IntArray
    """(n, n_dim) VTK's places of the nodes, halves"""


_CELLS = {
    27: _Cell("hexahedron27", ElementHex2, _HEXAHEDRON),
    8: _Cell("hexahedron", ElementHex1, _HEXAHEDRON[:8]),
    18: _Cell("quad9", ElementQuad2, _QUADRILATERAL),
}
"""by the number of nodes of an element of a table; that of a section has as many hoop nodes"""


def export_vtk(path: Path | str, elements: Elements, u: Array, material: Material) -> None:
    """Write undeformed elements with displacement and nodal force at u (n_node, 3) mm.

    Hexahedra, or quadrilaterals of the half section (r, z) of a body of revolution, whose
    displacements are (u_r, u_z, 0) and whose forces are those of the whole ring.  Point data:
    "displacement_mm" and "force_N", what contact and supports exert on the node.  `elements` and
    `u` are those of a model's `discretise()` and solved states, `material` the one they were solved
    for.  The format follows the suffix, ".vtu" or ".vtk".  Needs the extra `vtk`.

    Raises ValueError for another suffix, when the elements are none of a specimen or u does not fit
    them, and ModuleNotFoundError without the extra.
    """
    if Path(path).suffix not in (".vtu", ".vtk"):
        raise ValueError(f"path: expected a name that ends in .vtu or .vtk, found {str(path)!r}")
    import meshio  # an extra: only who exports needs it

    cell = _CELLS.get(elements.nodes.shape[1])
    if cell is None:
        raise ValueError(
            "elements: expected hexahedra of 27 or 8 nodes or sections of 18, "
            f"found {elements.nodes.shape[1]}"
        )
    if u.shape != elements.positions.shape:
        raise ValueError(f"u: expected shape {elements.positions.shape}, found {u.shape}")
    solid = Solid(elements, material)
    _, _, force = solid.assemble(u, solid.consistent_pressure(u))
    points = elements.positions
    if cell.element is ElementQuad2:
        n = len(points) // 2  # the hoop nodes come after all others
        force = np.column_stack([force[:n, 0] + force[n:, 2], force[:n, 1], np.zeros(n)])
        points, u = points[:n], u[:n]
    meshio.Mesh(
        points,
        [(cell.name, elements.nodes[:, _vtk_order(elements, cell)])],
        point_data={"displacement_mm": u, "force_N": force},
    ).write(path)


def _vtk_order(elements: Elements, cell: _Cell) -> IntArray:
    """(n,) which of an element's nodes VTK wants at each of its places."""
    local = np.rint(2.0 * np.asarray(cell.element.doflocs)).astype(np.int64)
    n_dim = local.shape[1]

    def places(wanted: IntArray) -> IntArray:
        index: IntArray = (local[None] == wanted[:, None]).all(axis=2).argmax(axis=1)
        return index

    origin = np.zeros((1, n_dim), dtype=np.int64)
    axes = np.vstack([origin, 2 * np.eye(n_dim, dtype=np.int64)])
    corner = elements.positions[elements.nodes[0]][places(axes)][:, :n_dim]
    left_handed = (
        np.linalg.det(corner[1:] - corner[0]) < 0.0
    )  # of the mesh; VTK counts right-handed
    swapped = [1, 0, 2][:n_dim]
    return places(cell.nodes[:, swapped] if left_handed else cell.nodes)
