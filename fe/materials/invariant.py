"""Chain rule from the derivatives of a law in I1bar, I2bar to P and dP/dF, once for all their laws.

Index notation: P[i, j] = dW/dF[i, j], A[i, j, k, l] = dP[i, j]/dF[k, l].  Derivation: with
I1 = F:F, I2 = (I1^2 - C:C)/2 and dJ/dF = cof F, see e.g. Holzapfel, Nonlinear Solid Mechanics
(2000), sections 6.4 and 6.6; the tangent is tested against finite differences of P.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from fe.materials.law_codes import invariant_derivatives

Array = npt.NDArray[np.float64]


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
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
    C = np.zeros((3, 3))
    B = np.zeros((3, 3))
    FC = np.zeros((3, 3))
    T = np.empty((3, 3))
    i1 = 0.0
    for i in range(3):
        for j in range(3):
            T[i, j] = cof[i, j] / J
            i1 += F[i, j] * F[i, j]
            for k in range(3):
                C[i, j] += F[k, i] * F[k, j]
                B[i, j] += F[i, k] * F[j, k]
    cc = 0.0
    for i in range(3):
        for j in range(3):
            cc += C[i, j] * C[i, j]
            for k in range(3):
                FC[i, j] += F[i, k] * C[k, j]
    i2 = 0.5 * (i1 * i1 - cc)
    j23 = J ** (-2.0 / 3.0)
    j43 = j23 * j23
    W, W1, W2, W11, W12, W22 = invariant_derivatives(law, j23 * i1, j43 * i2, constants)
    D1 = np.empty((3, 3))
    D2 = np.empty((3, 3))
    G2 = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            D1[i, j] = 2.0 * j23 * (F[i, j] - i1 / 3.0 * T[i, j])
            G2[i, j] = 2.0 * (i1 * F[i, j] - FC[i, j])
            D2[i, j] = j43 * (G2[i, j] - 4.0 / 3.0 * i2 * T[i, j])
            P[i, j] = W1 * D1[i, j] + W2 * D2[i, j]
    if not with_tangent:
        return W
    for i in range(3):
        for j in range(3):
            for k in range(3):
                dik = 1.0 if i == k else 0.0
                for m in range(3):
                    djm = 1.0 if j == m else 0.0
                    TT = T[i, m] * T[k, j]
                    H1 = (
                        2.0 * j23 * (dik * djm + i1 / 3.0 * TT)
                        - 2.0 / 3.0 * D1[i, j] * T[k, m]
                        - 4.0 / 3.0 * j23 * T[i, j] * F[k, m]
                    )
                    H2 = (
                        j43
                        * (
                            2.0
                            * (
                                2.0 * F[i, j] * F[k, m]
                                + i1 * dik * djm
                                - B[i, k] * djm
                                - F[i, m] * F[k, j]
                                - dik * C[m, j]
                            )
                            - 4.0 / 3.0 * T[i, j] * G2[k, m]
                            + 4.0 / 3.0 * i2 * TT
                        )
                        - 4.0 / 3.0 * D2[i, j] * T[k, m]
                    )
                    A[i, j, k, m] = (
                        W1 * H1
                        + W2 * H2
                        + W11 * D1[i, j] * D1[k, m]
                        + W22 * D2[i, j] * D2[k, m]
                        + W12 * (D1[i, j] * D2[k, m] + D2[i, j] * D1[k, m])
                    )
    return W
