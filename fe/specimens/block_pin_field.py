"""How the field points of a block under a pin pass its material when the geometry changes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from skfem import Basis, ElementHex2, MeshHex

from fe.specimens.block_pin_geometry import BlockPin
from fe.specimens.block_pin_parameters import by_geometry, mesh_motion

Array = npt.NDArray[np.float64]


def seen_motion(
    names: tuple[str, ...],
    specimen: BlockPin,
    lines: Callable[[BlockPin], MeshHex],
    points: Callable[[BlockPin], Array],
    u: Array,
) -> Array:
    """(n_point, 3, n_p) derivative of u (n_node, 3) mm at the field points, nodal values held.

    Points keep their fractions of width and height, elements go with the mesh's planes: what is
    between the two sees the gradient of u.  `points` are (n_point, 2), mm.
    """
    at = _on_front(specimen, points)
    passed = np.zeros((*at.shape, len(names)))
    for j, name in enumerate(names):
        moved = by_geometry(name, specimen, lambda changed: _on_front(changed, points))
        passed[..., j] = moved - mesh_motion(name, specimen, at, lines)
    passed[np.abs(passed) < 1e-9] = 0.0  # what differencing leaves
    if not passed.any():
        return passed
    seen: Array = np.einsum("pik,pkj->pij", _gradients(lines(specimen), at, u), passed)
    return seen


def _on_front(specimen: BlockPin, points: Callable[[BlockPin], Array]) -> Array:
    """(n_point, 3) field points, mm."""
    flat = points(specimen)
    return np.column_stack([flat, np.full(len(flat), specimen.depth / 2.0)])


def _gradients(mesh: MeshHex, at: Array, u: Array) -> Array:
    """(n_point, 3, 3) du_i/dX_k of u (n_node, 3) at the points (n_point, 3), mm."""
    basis = Basis(mesh, ElementHex2(), intorder=1)
    cells = mesh.element_finder(mapping=basis.mapping)(*at.T)
    local = basis.mapping.invF(at.T[:, :, None], tind=cells)
    found = np.zeros((len(at), 3, 3))
    for a in range(basis.Nbfun):
        slope = basis.elem.gbasis(basis.mapping, local, a, tind=cells)[0].grad[:, :, 0]
        found += u[basis.element_dofs[a, cells]][:, :, None] * slope.T[:, None, :]
    return found
