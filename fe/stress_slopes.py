"""How the stress at a point changes with the mesh: along each entry of L = dV/dX, by rank-one F.

An entry L_kj = 1 changes F = I + H by -h e_j', h_i = du_i/dX_k.  Along such a change the stress of
a law of the invariants takes a third of the work of the whole tangent dP/dF, and no array of it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.materials.law_codes import invariant_derivatives, is_separable
from fe.materials.material import KernelMaterial
from fe.materials.stretch import separable_stress

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@kernel()
def stress_slopes(
    material: KernelMaterial,
    F: Array,
    cof: Array,
    J: float,
    pressure: float,
    H: Array,
    rows: IntArray,
    columns: IntArray,
    work: Array,
    invariants: tuple[float, float, float],
    P: Array,
    A: Array,
    slopes: Array,
) -> None:
    """Fill `slopes` (n_m, 9) [3 n + i] with d(S_in dN/dX_n dV) / (dN/dX_n dV) along L_kj, MPa.

    S = dW/dF + pressure cof F, k = rows[m], j = columns[m]; H (3, 3) has rows k of du_i/dX_k.
    `work` and `invariants` are what `fe.materials.invariant.invariant_slopes` left, for laws of
    these; P (3, 3) and A (3, 3, 3, 3) are work space.
    """
    if is_separable(material.law):
        separable_stress(material.law, F, J, material.constants, P, A, True)
        _contract(A, H, rows, columns, slopes)
    else:
        law, constants = material.law, material.constants
        _invariant_stress(law, work, invariants, constants, P)
        _invariant_changes(law, F, work, invariants, constants, H, rows, columns, slopes)
    for i in range(3):
        for n in range(3):
            P[i, n] += pressure * cof[i, n]
    for m in range(rows.size):
        k, j = rows[m], columns[m]
        a, b = (j + 1) % 3, (j + 2) % 3
        for i in range(3):  # columns of cof F are the vector products of columns of F
            i1, i2 = (i + 1) % 3, (i + 2) % 3
            slopes[m, 3 * a + i] -= pressure * (F[i1, b] * H[k, i2] - F[i2, b] * H[k, i1])
            slopes[m, 3 * b + i] -= pressure * (H[k, i1] * F[i2, a] - H[k, i2] * F[i1, a])
        if k == j:
            for i in range(3):
                slopes[m, 3 * a + i] += P[i, a]
                slopes[m, 3 * b + i] += P[i, b]
        else:
            for i in range(3):
                slopes[m, 3 * k + i] -= P[i, j]


@kernel()
def _contract(A: Array, H: Array, rows: IntArray, columns: IntArray, changes: Array) -> None:
    """Fill `changes` (n_m, 9) with -A[i, n, p, j] h_p."""
    for m in range(rows.size):
        k, j = rows[m], columns[m]
        for n in range(3):
            for i in range(3):
                value = A[i, n, 0, j] * H[k, 0] + A[i, n, 1, j] * H[k, 1] + A[i, n, 2, j] * H[k, 2]
                changes[m, 3 * n + i] = -value


@kernel()
def _invariant_stress(
    law: int, work: Array, invariants: tuple[float, float, float], constants: Array, P: Array
) -> None:
    """Fill P (3, 3) = dW/dF."""
    i1, i2, j23 = invariants
    _, W1, W2, _, _, _ = invariant_derivatives(law, j23 * i1, j23 * j23 * i2, constants)
    for i in range(3):
        for n in range(3):
            P[i, n] = W1 * work[4, i, n] + W2 * work[5, i, n]


@kernel()
def _invariant_changes(
    law: int,
    F: Array,
    work: Array,
    invariants: tuple[float, float, float],
    constants: Array,
    H: Array,
    rows: IntArray,
    columns: IntArray,
    changes: Array,
) -> None:
    """Fill `changes` (n_m, 9) with what dW/dF changes by along -h e_j'.

    The tangent of `fe.materials.invariant` contracted with that dyad, term by term.
    """
    i1, i2, j23 = invariants
    j43 = j23 * j23
    T, C, B, G2, D1, D2 = work[0], work[1], work[2], work[3], work[4], work[5]
    _, W1, W2, W11, W12, W22 = invariant_derivatives(law, j23 * i1, j43 * i2, constants)
    c = 2.0 * W2 * j43
    identity = 2.0 * j23 * W1 + c * i1
    turned = 2.0 / 3.0 * (W1 * j23 * i1 + 2.0 * W2 * j43 * i2)
    by_F, by_T = work[6, 0], work[6, 1]
    for m in range(rows.size):
        j = columns[m]
        h0, h1, h2 = -H[rows[m], 0], -H[rows[m], 1], -H[rows[m], 2]
        for n in range(3):
            by_F[n] = F[0, n] * h0 + F[1, n] * h1 + F[2, n] * h2
            by_T[n] = T[0, n] * h0 + T[1, n] * h1 + T[2, n] * h2
        f, t = by_F[j], by_T[j]
        g = G2[0, j] * h0 + G2[1, j] * h1 + G2[2, j] * h2
        d1 = 2.0 * j23 * (f - i1 / 3.0 * t)
        d2 = j43 * (g - 4.0 / 3.0 * i2 * t)
        on_F, on_T = 2.0 * c * f, -4.0 / 3.0 * (W1 * j23 * f + W2 * j43 * g)
        on_D1 = W11 * d1 + W12 * d2 - 2.0 / 3.0 * W1 * t
        on_D2 = W12 * d1 + W22 * d2 - 4.0 / 3.0 * W2 * t
        for i in range(3):
            h = -H[rows[m], i]
            turn, bend = turned * T[i, j], c * F[i, j]
            for n in range(3):
                changes[m, 3 * n + i] = (
                    on_F * F[i, n]
                    + on_T * T[i, n]
                    + on_D1 * D1[i, n]
                    + on_D2 * D2[i, n]
                    + turn * by_T[n]
                    - bend * by_F[n]
                    - c * h * C[j, n]
                )
            stretched = B[i, 0] * h0 + B[i, 1] * h1 + B[i, 2] * h2
            changes[m, 3 * j + i] += identity * h - c * stretched
