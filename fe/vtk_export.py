"""A solved specimen as a file that ParaView opens: quadratic hexahedra and nodal values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from skfem import ElementHex2

from fe.materials.material import Material
from fe.solid import Solid
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]

N_NODES = 27
# corners, edges, faces and centre of VTK_TRIQUADRATIC_HEXAHEDRON in its own coordinates, halves
_VTK_NODES = np.array(
    [
        *[(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)],
        *[(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2)],
        *[(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)],
        *[(0, 1, 1), (2, 1, 1), (1, 0, 1), (1, 2, 1), (1, 1, 0), (1, 1, 2), (1, 1, 1)],
    ]
)


def export_vtk(path: Path | str, elements: Elements, u: Array, material: Material) -> None:
    """Write undeformed Q2 hexahedra with displacement and nodal force at u (n_node, 3) mm.

    Point data: "displacement_mm" and "force_N", what contact and supports exert on the node.
    `elements` and `u` are those of a model's `discretise()` and solved states, `material` the one
    they were solved for.  The format follows the suffix, ".vtu" or ".vtk".  Needs the extra `vtk`.

    Raises ValueError when the elements are not hexahedra of 27 nodes or u does not fit them, and
    ModuleNotFoundError without the extra.
    """
    import meshio  # an extra: only who exports needs it

    if elements.nodes.shape[1] != N_NODES:
        raise ValueError(
            f"elements: expected hexahedra of {N_NODES} nodes, found {elements.nodes.shape[1]}"
        )
    if u.shape != elements.positions.shape:
        raise ValueError(f"u: expected shape {elements.positions.shape}, found {u.shape}")
    solid = Solid(elements, material)
    _, _, force = solid.assemble(u, solid.consistent_pressure(u))
    meshio.Mesh(
        elements.positions,
        [("hexahedron27", elements.nodes[:, _vtk_order(elements)])],
        point_data={"displacement_mm": u, "force_N": force},
    ).write(path)


def _vtk_order(elements: Elements) -> npt.NDArray[np.int64]:
    """(27,) which of an element's nodes VTK wants at each of its places."""
    local = np.rint(2.0 * np.asarray(ElementHex2.doflocs)).astype(np.int64)

    def places(wanted: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        index: npt.NDArray[np.int64] = (local[None] == wanted[:, None]).all(axis=2).argmax(axis=1)
        return index

    corner = elements.positions[elements.nodes[0]][places(_VTK_NODES[[0, 1, 3, 4]])]
    left_handed = (
        np.linalg.det(corner[1:] - corner[0]) < 0.0
    )  # of the mesh; VTK counts right-handed
    return places(_VTK_NODES[:, [1, 0, 2]] if left_handed else _VTK_NODES)
