"""Direct solves with the whole tangent of friction, which is not symmetric, and its transpose.

Newton's steps deal with friction's coupling by iteration; sensitivities in many parameters need the
same matrix solved for many right-hand sides to many digits, and there one more factorisation of
structurally symmetric kind is cheaper than the iteration.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from numba import njit
from pypardiso import PyPardisoSolver

from fe.discretisation import Pattern

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Int32Array = npt.NDArray[np.int32]

_STRUCTURALLY_SYMMETRIC = 1
_OPTIONS = {1: 1, 2: 3, 8: 0, 10: 13, 11: 0, 13: 0}
"""MKL iparm (1-based): own values; nested dissection; no refinement; pivot perturbation 1e-13; no
scaling or matching"""
ACCURACY = 1e-9
"""of a solution, its residual relative to the load"""
_ANALYSE, _FACTORISE, _SOLVE = 11, 22, 33
_TRANSPOSED = 12


class WholeTangent:
    """Factorisations of upper-triangular data plus the coupling of faces."""

    def __init__(self, pattern: Pattern, face_nodes: IntArray) -> None:
        n = pattern.indptr.size - 1
        slots = np.arange(1, pattern.indices.size + 1)
        upper = sp.csr_matrix((slots, pattern.indices, pattern.indptr), (n, n))
        full = (upper + sp.triu(upper, 1).T).tocsr()
        full.sort_indices()
        self._from_upper = full.data - 1
        self._indptr, self._indices = full.indptr, full.indices
        self._face_slots = _slots(face_nodes, pattern.number, full.indptr, full.indices)
        self._matrix = sp.csr_matrix((n, n))
        self._pardiso: Any = PyPardisoSolver(mtype=_STRUCTURALLY_SYMMETRIC)
        for number, value in _OPTIONS.items():
            self._pardiso.set_iparm(number, value)
        self._analysed = False

    def factorise(self, data: Array, coupling: Array) -> None:
        """Factorise the matrix of upper-triangular `data` plus `coupling` (n_face, a, 3, 3, a)."""
        whole = data[self._from_upper]
        _add(coupling, self._face_slots, whole)
        n = self._indptr.size - 1
        self._matrix = sp.csr_matrix((whole, self._indices, self._indptr), (n, n))
        if not self._analysed:
            self._call(_ANALYSE, np.zeros(n))
            self._analysed = True
        self._call(_FACTORISE, np.zeros(n))

    def solve(self, b: Array, *, transposed: bool = False) -> Array:
        """Solution of the matrix factorised last, or its transpose, for b (n,) or (n, k).

        NaN where the residual of one mix of the columns is above `ACCURACY`, relative.
        """
        self._pardiso.set_iparm(_TRANSPOSED, 2 if transposed else 0)
        x = self._call(_SOLVE, b)
        mix = np.cos(np.arange(b.reshape(len(b), -1).shape[1]))
        one, load = (part.reshape(len(b), -1) @ mix for part in (x, b))
        missed = (self._matrix.T if transposed else self._matrix) @ one - load
        good = np.linalg.norm(missed) <= ACCURACY * np.linalg.norm(load)
        return x if good else np.full(x.shape, np.nan)

    def close(self) -> None:
        """Release MKL's memory."""
        self._pardiso.free_memory(everything=True)

    def _call(self, phase: int, b: Array) -> Array:
        self._pardiso.set_phase(phase)
        solution: Array = self._pardiso._call_pardiso(self._matrix, np.asfortranarray(b))
        return solution


@njit(cache=True)
def _slots(
    nodes: IntArray, number: IntArray, indptr: Int32Array, indices: Int32Array
) -> Int32Array:
    """(n, a, 3, 3, a) slots in full CSR data of the entries of faces (n, a), -1 where dropped."""
    n_face, n_a = nodes.shape
    slots = np.full((n_face, n_a, 3, 3, n_a), -1, dtype=np.int32)
    for c in range(n_face):
        for a in range(n_a):
            for i in range(3):
                row = number[3 * nodes[c, a] + i]
                if row < 0:
                    continue
                columns = indices[indptr[row] : indptr[row + 1]]
                for b in range(n_a):
                    for k in range(3):
                        column = number[3 * nodes[c, b] + k]
                        if column >= 0:
                            at = indptr[row] + np.searchsorted(columns, column)
                            slots[c, a, i, k, b] = at
    return slots


@njit(cache=True)
def _add(coupling: Array, slots: Int32Array, data: Array) -> None:
    for value, slot in zip(coupling.ravel(), slots.ravel()):  # noqa: B905 - not known to numba
        if slot >= 0 and value != 0.0:
            data[slot] += value
