"""SciPy's SuperLU for platforms without MKL: several times slower, the same answers.

In symmetric mode and with no threshold for pivots it keeps to the diagonal, so L U = L D L', and
by Sylvester's law the signs of U's diagonal are those of the matrix's eigenvalues (X. Li, ACM TOMS
31, 2005, on the symmetric mode).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu

from fe.singular_tangent import SingularTangentError

Array = npt.NDArray[np.float64]
Int32Array = npt.NDArray[np.int32]

NAME = "SciPy SuperLU"
_SHIFT = 1e-12
"""of the largest diagonal entry: moves a pivot off zero; refinement moves the solution back"""
_REFINEMENTS, _RESIDUAL = 5, 1e-13
"""of a solution, at most, down to this residual relative to the right side"""


class SuperLUMatrix:
    """Factorisations of one sparsity pattern, the upper triangle of it when `symmetric`."""

    def __init__(self, indptr: Int32Array, indices: Int32Array, *, symmetric: bool) -> None:
        self._n = indptr.size - 1
        self._symmetric = symmetric
        shape = (self._n, self._n)
        places = sp.csr_matrix((np.arange(1.0, indices.size + 1), indices, indptr), shape)
        if symmetric:
            places = places + sp.triu(places, 1).T
        columns = places.tocsc()
        columns.sort_indices()
        self._from = columns.data.astype(np.int64) - 1
        self._indices, self._indptr = columns.indices, columns.indptr
        self._lu: SuperLU | None = None
        self._matrix: sp.csc_matrix | None = None

    def factorise(self, data: Array) -> int:
        """Factorise the matrix with these entries; returns negative pivots of a symmetric one.

        Raises SingularTangentError when a matrix is singular.
        """
        matrix = sp.csc_matrix(
            (np.asarray(data)[self._from], self._indices, self._indptr), (self._n, self._n)
        )
        self._matrix = matrix
        shift = _SHIFT * float(np.abs(matrix.diagonal()).max())
        for attempt in range(3 if self._symmetric else 1):
            try:
                self._lu = splu(
                    matrix + attempt * shift * sp.identity(self._n, format="csc"),
                    permc_spec="MMD_AT_PLUS_A",
                    diag_pivot_thresh=0.0 if self._symmetric else 0.1,
                    options={"SymmetricMode": True},
                )
            except RuntimeError:
                continue
            if not self._symmetric:
                return 0
            if np.array_equal(self._lu.perm_r, self._lu.perm_c):  # all pivots on the diagonal
                return int(np.sum(self._lu.U.diagonal() < 0.0))
        raise SingularTangentError("SuperLU: the matrix is singular")

    def solve(self, b: Array, *, transposed: bool = False) -> Array:
        """Solution for b (n,) or (n, k), with the transpose if asked.

        Refined: factors without pivoting may be inaccurate.
        """
        if self._lu is None or self._matrix is None:
            raise RuntimeError("factorise a matrix first")
        right = np.asarray(b, dtype=np.float64)
        matrix = self._matrix.T if transposed else self._matrix
        trans = "T" if transposed else "N"
        lu: Any = self._lu  # its stub does not know of the transpose
        x = lu.solve(right, trans)
        for _ in range(_REFINEMENTS):
            missing = right - matrix @ x
            if not np.linalg.norm(missing) > _RESIDUAL * np.linalg.norm(right):
                break
            x = x + lu.solve(missing, trans)
        return np.ascontiguousarray(x)

    def close(self) -> None:
        """Forget the factors."""
        self._lu = self._matrix = None
