"""Chain rule from a law's derivatives in the isochoric principal stretches to P and dP/dF.

With F = sum_a lam_a n_a N_a', logarithms e_a = ln lam_a - ln(J) / 3 and W = sum_a w(e_a), the
principal values of P are tau_a / lam_a with tau_a = w'(e_a) - mean w'.  The tangent in the basis
n_a N_b' is that of Ogden, Non-linear Elastic Deformations (1984), chapter 6; its quotients
(tau_a - tau_b) / (lam_a^2 - lam_b^2) are taken as divided differences, so that equal and nearly
equal stretches need no special case and no perturbation.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.materials.eigen import symmetric_eigen
from fe.materials.ogden import derivatives, divided_difference, sinhc

Array = npt.NDArray[np.float64]


@kernel()
def principal_logarithms(F: Array, J: float, N: Array, lam: Array, e: Array) -> None:
    """Fill N (3, 3) columns N_a, stretches lam (3,) and isochoric logarithms e (3,) of F."""
    C = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                C[i, j] += F[k, i] * F[k, j]
    symmetric_eigen(C, N)
    mean = math.log(J) / 3.0
    for a in range(3):
        lam[a] = math.sqrt(C[a, a])
        e[a] = math.log(lam[a]) - mean


@kernel()
def separable_energy(law: int, F: Array, J: float, constants: Array) -> float:
    """Isochoric energy W (MPa) at F (3, 3) with J = det F > 0."""
    N = np.empty((3, 3))
    lam, e = np.empty(3), np.empty(3)
    principal_logarithms(F, J, N, lam, e)
    energy = 0.0
    for a in range(3):
        energy += derivatives(law, e[a], constants)[0]
    return energy


@kernel()
def separable_stress(
    law: int, F: Array, J: float, constants: Array, P: Array, A: Array, with_tangent: bool
) -> float:
    """Fill P (3, 3) and, if asked, A (3, 3, 3, 3) of the isochoric energy; return W (all MPa)."""
    N = np.empty((3, 3))
    lam, e, w1, w2 = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    principal_logarithms(F, J, N, lam, e)
    energy = 0.0
    for a in range(3):
        w, w1[a], w2[a] = derivatives(law, e[a], constants)
        energy += w
    tau = w1 - (w1[0] + w1[1] + w1[2]) / 3.0
    n = np.empty((3, 3))
    for a in range(3):
        for i in range(3):
            n[i, a] = (F[i, 0] * N[0, a] + F[i, 1] * N[1, a] + F[i, 2] * N[2, a]) / lam[a]
    for i in range(3):
        for j in range(3):
            P[i, j] = 0.0
            for a in range(3):
                P[i, j] += tau[a] / lam[a] * n[i, a] * N[j, a]
    if with_tangent:
        _rotate_tangent(_principal_tangent(law, lam, e, tau, w2, constants), n, N, A)
    return energy


@kernel()
def _principal_tangent(
    law: int, lam: Array, e: Array, tau: Array, w2: Array, constants: Array
) -> Array:
    """(9, 9) tangent in the basis n_a N_b' numbered 3 a + b."""
    M = np.zeros((9, 9))
    total = w2[0] + w2[1] + w2[2]
    for a in range(3):
        for b in range(3):
            normal = total / 9.0 - (w2[a] + w2[b]) / 3.0
            if a == b:
                normal += w2[a] - tau[a]
            M[4 * a, 4 * b] = normal / (lam[a] * lam[b])
        for b in range(a):
            quotient = divided_difference(law, e[a], e[b], constants) / (
                2.0 * lam[a] * lam[b] * sinhc(e[a] - e[b])
            )
            cross = lam[b] / lam[a] * quotient - tau[b] / (lam[a] * lam[b])
            M[3 * a + b, 3 * a + b] = M[3 * b + a, 3 * b + a] = quotient
            M[3 * a + b, 3 * b + a] = M[3 * b + a, 3 * a + b] = cross
    return M


@kernel()
def _rotate_tangent(M: Array, n: Array, N: Array, A: Array) -> None:
    """Fill A (3, 3, 3, 3) from its components M (9, 9) in the basis n_a N_b'."""
    dyads = np.empty((9, 9))
    for a in range(3):
        for b in range(3):
            for i in range(3):
                for j in range(3):
                    dyads[3 * a + b, 3 * i + j] = n[i, a] * N[j, b]
    half = np.zeros((9, 9))
    for x in range(9):
        for y in range(9):
            if M[x, y] != 0.0:
                for z in range(9):
                    half[x, z] += M[x, y] * dyads[y, z]
    for i in range(3):
        for j in range(3):
            for k in range(3):
                for m in range(3):
                    value = 0.0
                    for x in range(9):
                        value += dyads[x, 3 * i + j] * half[x, 3 * k + m]
                    A[i, j, k, m] = value
