"""MKL Pardiso called with arrays prepared once.

pypardiso finds and loads MKL and knows the signature for the machine; its own call copies and
shifts the matrix's structure each time, which costs as much as a small back-substitution.
Pardiso is what makes a design affordable: a supernodal factorisation with nested dissection, and
it counts negative pivots.
"""

from __future__ import annotations

import ctypes
import os
from typing import Any

import numpy as np
import numpy.typing as npt

# The same bits for the same input on the same machine; MKL reads this once, when it is loaded.
os.environ.setdefault("MKL_CBWR", "AUTO,STRICT")

from pypardiso import PyPardisoSolver

from fe.singular_tangent import SingularTangentError

Array = npt.NDArray[np.float64]
Int32Array = npt.NDArray[np.int32]

NAME = "MKL Pardiso"
_SYMMETRIC_INDEFINITE, _GENERAL = -2, 11
_OPTIONS = {1: 1, 2: 3, 8: 0, 10: 8, 11: 0, 13: 0, 21: 1, 35: 1}
"""MKL iparm (1-based): own values; nested dissection; no iterative refinement, which triples the
cost of a solve and gains no digit here (residual 6e-14 without); pivot perturbation 1e-8; no
scaling or matching; analysed for Bunch-Kaufman pivots (see `factorise`); indices from 0"""
_TRANSPOSED, _PIVOTING, _PERTURBED, _NEGATIVE = 11, 20, 13, 22  # places in iparm, counted from 0
_ANALYSE, _FACTORISE, _SOLVE, _RELEASE = 11, 22, 33, -1


class PardisoMatrix:
    """Factorisations of one sparsity pattern, the upper triangle of it when `symmetric`.

    Raises ImportError where MKL is not found.
    """

    def __init__(self, indptr: Int32Array, indices: Int32Array, *, symmetric: bool) -> None:
        loaded = PyPardisoSolver()
        # pypardiso searches the whole environment for MKL each time, up to a second, unless told
        os.environ.setdefault("PYPARDISO_MKL_RT", loaded.libmkl._name)
        signature = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 16)
        self._pardiso: Any = signature(("pardiso", loaded.libmkl))
        self._handle = np.zeros(64, dtype=loaded.pt.dtype)
        self._options = np.zeros(64, dtype=np.int32)
        for number, value in _OPTIONS.items():
            self._options[number - 1] = value
        self._indptr = np.ascontiguousarray(indptr, dtype=np.int32)
        self._indices = np.ascontiguousarray(indices, dtype=np.int32)
        self._data = np.zeros(self._indices.size)
        self._n = self._indptr.size - 1
        self._symmetric = symmetric
        # maxfct, mnum, type, phase, n, number of right-hand sides, message level, error
        kind = _SYMMETRIC_INDEFINITE if symmetric else _GENERAL
        self._numbers = np.array([1, 1, kind, 0, self._n, 1, 0, 0], dtype=np.int32)
        self._nothing = np.zeros(self._n)
        self._analysed = False
        self._was_indefinite = False

    def factorise(self, data: Array) -> int:
        """Factorise the matrix with these entries; returns negative pivots of a symmetric one.

        Without pivoting, which is stable and counts right where no pivot is negative or tiny, else
        with Bunch-Kaufman pivots.  The first try is what the matrix before needed.
        """
        self._data = np.ascontiguousarray(data, dtype=np.float64)
        if not self._analysed:
            self._call(_ANALYSE, self._nothing, self._nothing)
            self._analysed = True
        if not self._symmetric:
            self._call(_FACTORISE, self._nothing, self._nothing)
            return 0
        for pivoting in (1,) if self._was_indefinite else (0, 1):
            self._options[_PIVOTING] = pivoting  # the solves must see what the factor is of
            self._call(_FACTORISE, self._nothing, self._nothing)
            if self._options[_NEGATIVE] == 0 and self._options[_PERTURBED] == 0:
                break
        negative = int(self._options[_NEGATIVE])
        self._was_indefinite = negative > 0
        return negative

    def solve(self, b: Array, *, transposed: bool = False) -> Array:
        """Solution for b (n,) or (n, k), with the transpose if asked."""
        self._options[_TRANSPOSED] = 2 if transposed else 0
        right = np.asfortranarray(b, dtype=np.float64)
        x = np.empty_like(right)
        self._call(_SOLVE, right, x)
        return np.ascontiguousarray(x)

    def close(self) -> None:
        """Release MKL's memory."""
        if self._analysed:
            self._call(_RELEASE, self._nothing, self._nothing)
            self._analysed = False

    def _call(self, phase: int, b: Array, x: Array) -> None:
        numbers = self._numbers
        numbers[3], numbers[5], numbers[7] = phase, 1 if b.ndim == 1 else b.shape[1], 0
        maxfct, mnum, kind, at, n, count, level, error = (
            numbers.ctypes.data + 4 * i for i in range(8)
        )
        self._pardiso(
            self._handle.ctypes.data,
            maxfct,
            mnum,
            kind,
            at,
            n,
            self._data.ctypes.data,
            self._indptr.ctypes.data,
            self._indices.ctypes.data,
            self._nothing.ctypes.data,  # a permutation, not asked for
            count,
            self._options.ctypes.data,
            level,
            b.ctypes.data,
            x.ctypes.data,
            error,
        )
        if numbers[7] != 0:
            raise SingularTangentError(f"MKL Pardiso: error {numbers[7]} in phase {phase}")
