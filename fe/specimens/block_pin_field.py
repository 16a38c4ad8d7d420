"""How the field points of a block under a pin pass its material when the geometry changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from skfem import Basis, ElementHex2, MeshHex

from fe.specimens.block_pin_geometry import BlockPin
from fe.specimens.block_pin_parameters import by_geometry, mesh_motion

Array = npt.NDArray[np.float64]


class FieldMotion(NamedTuple):
    """How field points move against the material, and what of u they see in doing so."""

    passed: Array
    """(n_point, 3, n_p) mm per unit of the parameter"""
    slopes: tuple[sp.csr_matrix, ...]
    """d/dx, d/dy, d/dz at the points of nodal values, (n_point, n_node) each, 1/mm"""

    def seen(self, u: Array) -> Array:
        """(n_point, 3, n_p) derivative of u (n_node, 3) mm at the points, nodal values held."""
        n_point, _, n_p = self.passed.shape
        if not self.slopes:
            return np.zeros((n_point, 3, n_p))
        gradient = np.stack([slope @ u for slope in self.slopes], axis=2)
        seen: Array = np.matmul(gradient, self.passed)
        return seen


def field_motion(
    names: tuple[str, ...],
    specimen: BlockPin,
    lines: Callable[[BlockPin], MeshHex],
    points: Callable[[BlockPin], Array],
) -> FieldMotion:
    """Motion in the named parameters; `points` are (n_point, 2), mm, `lines` makes the mesh.

    Points keep their fractions of width and height, elements go with the mesh's planes.
    """
    at = _on_front(specimen, points)
    passed = np.zeros((*at.shape, len(names)))
    for j, name in enumerate(names):
        moved = by_geometry(name, specimen, lambda changed: _on_front(changed, points))
        if moved is not None:
            passed[..., j] = moved - mesh_motion(name, specimen, at, lines)
    passed[np.abs(passed) < 1e-9] = 0.0  # what differencing leaves
    return FieldMotion(passed, _slopes(lines(specimen), at) if passed.any() else ())


def _on_front(specimen: BlockPin, points: Callable[[BlockPin], Array]) -> Array:
    """(n_point, 3) field points, mm."""
    flat = points(specimen)
    return np.column_stack([flat, np.full(len(flat), specimen.depth / 2.0)])


def _slopes(mesh: MeshHex, at: Array) -> tuple[sp.csr_matrix, ...]:
    """Matrices of the three derivatives at the points (n_point, 3), mm."""
    basis = Basis(mesh, ElementHex2(), intorder=1)
    cells = mesh.element_finder(mapping=basis.mapping)(*at.T)
    local = basis.mapping.invF(at.T[:, :, None], tind=cells)
    slopes = np.stack(
        [
            basis.elem.gbasis(basis.mapping, local, a, tind=cells)[0].grad[:, :, 0]
            for a in range(basis.Nbfun)
        ]
    )
    columns = basis.element_dofs[:, cells].ravel()
    rows = np.tile(np.arange(len(at)), basis.Nbfun)
    shape = (len(at), basis.N)
    return tuple(
        sp.coo_matrix((slopes[:, i].ravel(), (rows, columns)), shape).tocsr() for i in range(3)
    )
