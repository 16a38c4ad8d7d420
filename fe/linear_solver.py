"""Direct solves with the tangents: symmetric indefinite with inertia, and unsymmetric.

By MKL Pardiso where pypardiso finds MKL, elsewhere by SciPy's SuperLU.  The number of negative
pivots tells a stable equilibrium from an unstable one.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, gmres

from fe import superlu
from fe.conjugate_gradients import conjugate_gradients, symmetric_product

try:
    from fe import pardiso
except ImportError:  # pypardiso is not for this platform
    pardiso = None  # type: ignore[assignment]

Array = npt.NDArray[np.float64]
Int32Array = npt.NDArray[np.int32]


MOST_PRODUCTS = 25
"""of an iterative solve: more cost as much as a factorisation of a small matrix"""
MOST_BACK_SUBSTITUTIONS = 15
"""the same, where both matrices are symmetric: it does the work of half a factorisation"""


class GeneralMatrix(NamedTuple):
    """An unsymmetric matrix in CSR."""

    indptr: Int32Array
    indices: Int32Array
    data: Array

    def sparse(self) -> sp.csr_matrix:
        """The same for scipy, nothing copied."""
        n = self.indptr.size - 1
        return sp.csr_matrix((self.data, self.indices, self.indptr), (n, n))


class DirectMatrix(Protocol):
    """Factorisations of one sparsity pattern by some library."""

    def factorise(self, data: Array) -> int:
        """Factorise the matrix with these entries; returns negative pivots of a symmetric one."""
        ...

    def solve(self, b: Array, *, transposed: bool = False) -> Array:
        """Solution for b (n,) or (n, k), with the transpose if asked."""
        ...

    def close(self) -> None:
        """Release its memory."""
        ...


class Library(NamedTuple):
    """What factorises."""

    name: str
    matrix: Callable[..., DirectMatrix]
    """of (indptr, indices, symmetric=)"""


SUPERLU = Library(superlu.NAME, superlu.SuperLUMatrix)


@functools.cache
def installed_library() -> Library:
    """MKL Pardiso where it can be loaded, else SuperLU."""
    if pardiso is None:
        return SUPERLU
    try:
        pardiso.PardisoMatrix(np.array([0, 1], np.int32), np.array([0], np.int32), symmetric=True)
    except (ImportError, OSError):  # pypardiso without MKL
        return SUPERLU
    return Library(pardiso.NAME, pardiso.PardisoMatrix)


class SymmetricSolver:
    """Factorisations of one symmetric pattern, and of unsymmetric matrices near it.

    The symbolic analysis is done once for each.  By default with the `installed_library`.
    """

    def __init__(
        self, indptr: Int32Array, indices: Int32Array, library: Library | None = None
    ) -> None:
        self.library = installed_library() if library is None else library
        self._indptr = indptr
        self._indices = indices
        self._n = indptr.size - 1
        self._upper = self.library.matrix(indptr, indices, symmetric=True)
        self._data: Array | None = None
        self._negative = 0
        self._general: DirectMatrix | None = None
        self._general_data: Any = None
        self.n_factorisations = 0

    @property
    def data(self) -> Array:
        """Upper-triangular entries of the symmetric matrix factorised last."""
        if self._data is None:
            raise RuntimeError("factorise a matrix first")
        return self._data

    @property
    def matrix(self) -> sp.csr_matrix:
        """The symmetric matrix factorised last (upper triangle)."""
        return sp.csr_matrix((self.data, self._indices, self._indptr), (self._n, self._n))

    def shifted(self, data: Array, share: float) -> Array:
        """Upper-triangular data with a share of the median of the diagonal's sizes added to it."""
        diagonal, moved = self._indptr[:-1], data.copy()  # rows begin with theirs
        moved[diagonal] += share * np.median(np.abs(data[diagonal]))
        return moved

    def factorise(self, data: Array) -> int:
        """Factorise the matrix with the given upper-triangular data; returns negative pivots.

        Does nothing when that array was factorised last: do not write to it.
        """
        if data is not self._data:
            self._data = None  # should it fail, nothing is factorised
            self._negative = self._upper.factorise(data)
            self._data = data
            self.n_factorisations += 1
        return self._negative

    def solve(self, b: Array) -> Array:
        """Solution of the last factorised symmetric system for b (n,) or (n, k)."""
        return self._upper.solve(b)

    def solve_positive(self, data: Array, b: Array, tolerance: float) -> Array | None:
        """Solution with another matrix of upper-triangular `data`, for b (n,), by the factor held.

        To a residual of `tolerance`, relative: a few products and back-substitutions in place of a
        factorisation.  None where what is factorised is not positive definite, and where the matrix
        is met to curve down or is too far from it.
        """
        if self._data is None or self._negative > 0:
            return None
        return conjugate_gradients(
            lambda x: symmetric_product(self._indptr, self._indices, data, x),
            self._upper.solve,
            b,
            tolerance,
            MOST_BACK_SUBSTITUTIONS,
        )

    def solve_general(self, matrix: GeneralMatrix, b: Array, *, transposed: bool = False) -> Array:
        """Solution with an unsymmetric matrix, or its transpose, for b (n,) or (n, k).

        All of one solver have the same pattern; an array of entries is factorised when it is new.
        """
        if self._general is None:
            self._general = self.library.matrix(matrix.indptr, matrix.indices, symmetric=False)
        if matrix.data is not self._general_data:
            self._general_data = None
            self._general.factorise(matrix.data)
            self._general_data = matrix.data
            self.n_factorisations += 1
        return self._general.solve(b, transposed=transposed)

    def solve_near(self, matrix: GeneralMatrix, b: Array, tolerance: float) -> Array:
        """Solution with an unsymmetric matrix for b (n,), to a residual of `tolerance`, relative.

        By GMRES about the factor of the symmetric one factorised last, which should be near (in
        Newton's last steps it is of an earlier iterate): a few products and back-substitutions in
        place of a factorisation. Up to twice the tolerance is taken. By `solve_general` where it
        does not get there; not where that happens to have the factor, so that a march has the same
        bits with derivatives and without.
        """
        size = float(np.linalg.norm(b))
        if not 0.0 < size < np.inf:
            return self.solve_general(matrix, b)
        whole = matrix.sparse()
        about = LinearOperator(
            (self._n, self._n), matvec=lambda y: whole @ self._upper.solve(y), dtype=np.float64
        )
        y, _ = gmres(about, b, rtol=tolerance, restart=MOST_PRODUCTS, maxiter=1)
        x = self._upper.solve(y)
        if np.linalg.norm(whole @ x - b) <= 2.0 * tolerance * size:
            return x
        return self.solve_general(matrix, b)

    def close(self) -> None:
        """Release the memory of all factors."""
        self._upper.close()
        if self._general is not None:
            self._general.close()
