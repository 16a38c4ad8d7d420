"""How field points pass the material of a specimen when its geometry changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from skfem import Basis

Array = npt.NDArray[np.float64]


class FieldMotion(NamedTuple):
    """How field points move against the material, and what of u they see in doing so."""

    passed: Array
    """(n_point, n_dim, n_p) mm per unit of the parameter"""
    slopes: tuple[sp.csr_matrix, ...]
    """d/dx, d/dy[, d/dz] at the points of nodal values, (n_point, n_node) each, 1/mm"""

    def seen(self, u: Array) -> Array:
        """(n_point, 3, n_p) derivative of u (n_node, 3) mm at the points, nodal values held."""
        n_point, _, n_p = self.passed.shape
        if not self.slopes:
            return np.zeros((n_point, 3, n_p))
        gradient = np.stack([slope @ u for slope in self.slopes], axis=2)
        seen: Array = np.matmul(gradient, self.passed)
        return seen


def passing(passed: Array, at: Array, basis: Callable[[], Basis], n_hidden: int = 0) -> FieldMotion:
    """Motion of the points `at` (n_point, n_dim) mm of the mesh of a scalar basis.

    `passed` (n_point, n_dim, n_p), mm, is found by differencing, which leaves a little.  `n_hidden`
    nodes of the tables come after those of the basis and are not seen.
    """
    passed = np.where(np.abs(passed) < 1e-9, 0.0, passed)
    return FieldMotion(passed, _slopes(basis(), at, n_hidden) if passed.any() else ())


def _slopes(basis: Basis, at: Array, n_hidden: int) -> tuple[sp.csr_matrix, ...]:
    """Matrices of the derivatives at the points (n_point, n_dim), mm."""
    cells = basis.mesh.element_finder(mapping=basis.mapping)(*at.T)
    local = basis.mapping.invF(at.T[:, :, None], tind=cells)
    reference = np.stack([basis.elem.lbasis(local, a)[1][..., 0] for a in range(basis.Nbfun)])
    inverse = basis.mapping.invDF(local, tind=cells)[..., 0]
    slopes = np.einsum("kin,akn->ain", inverse, reference)
    columns = basis.element_dofs[:, cells].ravel()
    rows = np.tile(np.arange(len(at)), basis.Nbfun)
    shape = (len(at), basis.N + n_hidden)
    return tuple(
        sp.coo_matrix((slopes[:, i].ravel(), (rows, columns)), shape).tocsr()
        for i in range(at.shape[1])
    )
