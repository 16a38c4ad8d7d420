"""Chain rule from the derivatives of a law in I1bar, I2bar to P and dP/dF, once for all their laws.

Index notation: P[i, j] = dW/dF[i, j], A[i, j, k, l] = dP[i, j]/dF[k, l].  Derivation: with
I1 = F:F, I2 = (I1^2 - C:C)/2 and dJ/dF = cof F, see e.g. Holzapfel, Nonlinear Solid Mechanics
(2000), sections 6.4 and 6.6; the tangent is tested against finite differences of P.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.materials.law_codes import invariant_derivatives

Array = npt.NDArray[np.float64]


@kernel()
def cofactor(F: Array, cof: Array) -> float:
    """Fill cof (3, 3) with dJ/dF = J F^-T and return J."""
    for i in range(3):
        i1 = (i + 1) % 3
        i2 = (i + 2) % 3
        for j in range(3):
            j1 = (j + 1) % 3
            j2 = (j + 2) % 3
            cof[i, j] = F[i1, j1] * F[i2, j2] - F[i1, j2] * F[i2, j1]
    J: float = F[0, 0] * cof[0, 0] + F[0, 1] * cof[0, 1] + F[0, 2] * cof[0, 2]
    return J


@kernel()
def invariant_energy(law: int, F: Array, J: float, constants: Array) -> float:
    """Isochoric energy W (MPa) of a law at F (3, 3) with J = det F > 0."""
    i1 = 0.0
    cc = 0.0
    for i in range(3):
        for j in range(3):
            i1 += F[i, j] * F[i, j]
            c = F[0, i] * F[0, j] + F[1, i] * F[1, j] + F[2, i] * F[2, j]
            cc += c * c
    j23 = J ** (-2.0 / 3.0)
    i2 = 0.5 * (i1 * i1 - cc)
    W, _, _, _, _, _ = invariant_derivatives(law, j23 * i1, j23 * j23 * i2, constants)
    return W


@kernel()
def invariant_stress(
    law: int,
    F: Array,
    cof: Array,
    J: float,
    constants: Array,
    P: Array,
    A: Array,
    with_tangent: bool,
) -> float:
    """Fill P (3, 3) and, if asked, A (3, 3, 3, 3) of the isochoric energy; return W (all MPa).

    `cof` is dJ/dF and `J` = det F > 0 at `F`.
    """
    work = np.empty((9, 3, 3))  # one allocation: nine cost as much as the arithmetic
    i1, i2, j23 = invariant_slopes(F, cof, J, work)
    j43 = j23 * j23
    D1, D2 = work[4], work[5]
    W, W1, W2, W11, W12, W22 = invariant_derivatives(law, j23 * i1, j43 * i2, constants)
    for i in range(3):
        for j in range(3):
            P[i, j] = W1 * D1[i, j] + W2 * D2[i, j]
    if not with_tangent:
        return W
    _invariant_tangent(
        F,
        work,
        (2.0 * W2 * j43, 2.0 * j23 * W1 + 2.0 * W2 * j43 * i1),
        2.0 / 3.0 * (W1 * j23 * i1 + 2.0 * W2 * j43 * i2),
        (W1, W2, W1 * j23, W2 * j43),
        (W11, W12, W22),
        A,
    )
    return W


@kernel()
def invariant_slopes(F: Array, cof: Array, J: float, work: Array) -> tuple[float, float, float]:
    """Fill work[4], work[5] (3, 3) with the derivatives of I1bar and I2bar in F.

    Returns (I1, I2, J^(-2/3)).  work[:4] are what the tangent is made of besides: F^-T, C, B = F F'
    and the derivative of I2.
    """
    T, C, B, G2 = work[0], work[1], work[2], work[3]
    D1, D2 = work[4], work[5]
    i1 = 0.0
    cc = 0.0
    for i in range(3):
        for j in range(3):
            T[i, j] = cof[i, j] / J
            i1 += F[i, j] * F[i, j]
            C[i, j] = F[0, i] * F[0, j] + F[1, i] * F[1, j] + F[2, i] * F[2, j]
            B[i, j] = F[i, 0] * F[j, 0] + F[i, 1] * F[j, 1] + F[i, 2] * F[j, 2]
            cc += C[i, j] * C[i, j]
    i2 = 0.5 * (i1 * i1 - cc)
    j23 = J ** (-2.0 / 3.0)
    j43 = j23 * j23
    for i in range(3):
        for j in range(3):
            D1[i, j] = 2.0 * j23 * (F[i, j] - i1 / 3.0 * T[i, j])
            FC = F[i, 0] * C[0, j] + F[i, 1] * C[1, j] + F[i, 2] * C[2, j]
            G2[i, j] = 2.0 * (i1 * F[i, j] - FC)
            D2[i, j] = j43 * (G2[i, j] - 4.0 / 3.0 * i2 * T[i, j])
    return i1, i2, j23


@kernel()
def _invariant_tangent(
    F: Array,
    work: Array,
    direct: tuple[float, float],
    turned: float,
    first: tuple[float, float, float, float],
    second: tuple[float, float, float],
    A: Array,
) -> None:
    """Fill A (3, 3, 3, 3) from what `invariant_stress` has in `work`.

    The sum of dyads of 3 x 3 matrices, the products with one index of each pair exchanged (for
    i <= k: A[i, j, k, m] = A[k, m, i, j]), and those with a unit matrix.
    """
    T, C, B, G2 = work[0], work[1], work[2], work[3]
    D1, D2, V, X, Y = work[4], work[5], work[6], work[7], work[8]
    c, identity = direct
    W1, W2, w1, w2 = first
    W11, W12, W22 = second
    for k in range(3):
        for m in range(3):
            V[k, m] = -4.0 / 3.0 * (w1 * F[k, m] + w2 * G2[k, m])
            X[k, m] = W11 * D1[k, m] + W12 * D2[k, m]
            Y[k, m] = W12 * D1[k, m] + W22 * D2[k, m]
    for i in range(3):
        for j in range(3):
            U = -2.0 / 3.0 * (W1 * D1[i, j] + 2.0 * W2 * D2[i, j])
            for k in range(i, 3):
                for m in range(3):
                    A[i, j, k, m] = (
                        2.0 * c * F[i, j] * F[k, m]
                        + U * T[k, m]
                        + T[i, j] * V[k, m]
                        + D1[i, j] * X[k, m]
                        + D2[i, j] * Y[k, m]
                        + turned * T[i, m] * T[k, j]
                        - c * F[i, m] * F[k, j]
                    )
                A[i, j, k, j] -= c * B[i, k]
            for m in range(3):
                A[i, j, i, m] -= c * C[j, m]
            A[i, j, i, j] += identity
    for i in range(1, 3):
        for k in range(i):
            for j in range(3):
                for m in range(3):
                    A[i, j, k, m] = A[k, m, i, j]
