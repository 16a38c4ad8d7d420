"""Eigenvalues and vectors of a symmetric 3 x 3 matrix by Jacobi rotations.

Rotations keep the vectors orthonormal to rounding however close the eigenvalues are, which closed
formulas and their cross products do not (Golub and Van Loan, Matrix Computations, section 8.5).
LAPACK through numba allocates, and raises on infinite input, which a line search may produce.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel

Array = npt.NDArray[np.float64]

SWEEPS = 20
"""convergence is quadratic: five to six sweeps are used"""
NEGLIGIBLE = 1e-17
"""an off-diagonal entry below this part of its diagonal ones is zero to rounding"""


@kernel()
def symmetric_eigen(C: Array, vectors: Array) -> None:
    """Diagonalise C (3, 3) in place; column a of `vectors` (3, 3) belongs to C[a, a]."""
    for i in range(3):
        for j in range(3):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(SWEEPS):
        rotated = False
        for p in range(2):
            for q in range(p + 1, 3):
                if abs(C[p, q]) > NEGLIGIBLE * math.sqrt(abs(C[p, p] * C[q, q])):
                    _rotate(C, vectors, p, q)
                    rotated = True
        if not rotated:
            return


@kernel()
def _rotate(C: Array, vectors: Array, p: int, q: int) -> None:
    """One rotation in the plane (p, q) that makes C[p, q] zero."""
    theta = (C[q, q] - C[p, p]) / (2.0 * C[p, q])
    t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
    if theta < 0.0:
        t = -t
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    C[p, p] -= t * C[p, q]
    C[q, q] += t * C[p, q]
    C[p, q] = C[q, p] = 0.0
    r = 3 - p - q
    rp, rq = C[r, p], C[r, q]
    C[r, p] = C[p, r] = c * rp - s * rq
    C[r, q] = C[q, r] = s * rp + c * rq
    for i in range(3):
        vp, vq = vectors[i, p], vectors[i, q]
        vectors[i, p] = c * vp - s * vq
        vectors[i, q] = s * vp + c * vq
