"""What field points see of nodal values, and how they pass the material as the geometry changes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from skfem import Basis

Array = npt.NDArray[np.float64]


class FieldProbe(NamedTuple):
    """What is seen of nodal values at the field points."""

    values: sp.csr_matrix
    """(n_point, n_node)"""
    slopes: tuple[sp.csr_matrix, ...]
    """d/dx, d/dy[, d/dz], (n_point, n_node) each, 1/mm"""


class FieldMotion(NamedTuple):
    """How field points move against the material, and what of u they see in doing so."""

    passed: Array
    """(n_point, n_dim, n_p) mm per unit of the parameter"""
    slopes: tuple[sp.csr_matrix, ...]
    """as of `FieldProbe`; none where no point moves"""

    def seen(self, u: Array) -> Array:
        """(n_point, 3, n_p) derivative of u (n_node, 3) mm at the points, nodal values held."""
        n_point, _, n_p = self.passed.shape
        if not self.slopes:
            return np.zeros((n_point, 3, n_p))
        gradient = np.stack([slope @ u for slope in self.slopes], axis=2)
        seen: Array = np.matmul(gradient, self.passed)
        return seen


def passing(passed: Array, probe: FieldProbe) -> FieldMotion:
    """Motion of the points of a probe by `passed` (n_point, n_dim, n_p) mm per unit.

    That is found by differencing, which leaves a little.
    """
    passed = np.where(np.abs(passed) < 1e-9, 0.0, passed)
    return FieldMotion(passed, probe.slopes if passed.any() else ())


def field_probe(basis: Basis, at: Array, n_hidden: int = 0) -> FieldProbe:
    """Values and derivatives at the points `at` (n_point, n_dim) mm of the mesh of a scalar basis.

    `n_hidden` nodes of the tables come after those of the basis and are not seen.  Raises
    ValueError for a point outside the mesh.
    """
    cells = basis.mesh.element_finder(mapping=basis.mapping)(*at.T)
    local = basis.mapping.invF(at.T[:, :, None], tind=cells)
    shapes = [basis.elem.lbasis(local, a) for a in range(basis.Nbfun)]
    reference = np.stack([slope[..., 0] for _, slope in shapes])
    inverse = basis.mapping.invDF(local, tind=cells)[..., 0]
    slopes = np.einsum("kin,akn->ain", inverse, reference)
    columns = basis.element_dofs[:, cells].ravel()
    rows = np.tile(np.arange(len(at)), basis.Nbfun)
    shape = (len(at), basis.N + n_hidden)

    def seen(entries: Array) -> sp.csr_matrix:
        """Matrix of entries (n_shape, n_point)."""
        return sp.coo_matrix((entries.ravel(), (rows, columns)), shape).tocsr()

    values = np.stack([np.broadcast_to(value, local.shape[1:])[:, 0] for value, _ in shapes])
    return FieldProbe(seen(values), tuple(seen(slopes[:, i]) for i in range(at.shape[1])))
