"""The volume of one element: projected dilation, other laws' deviation, tangent of the pressure.

Notation of fe.weak_form: b = int psi (J - 1), M = int psi psi', theta = psi' M^-1 b, n_p pressure
functions, n_a nodes, n_q quadrature points.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.materials.material import KernelMaterial
from fe.materials.volumetric import deviation

Array = npt.NDArray[np.float64]


@kernel()
def dilation(b: Array, psi: Array, mass_inverse: Array) -> float:
    """Projected dilation theta where the pressure functions are psi (n_p,); b (n_p,) mm3."""
    theta = 0.0
    for m in range(b.size):
        for n in range(b.size):
            theta += psi[m] * mass_inverse[m, n] * b[n]
    return theta


@kernel()
def add_deviation(
    b: Array,
    weights: Array,
    psi: Array,
    mass_inverse: Array,
    material: KernelMaterial,
    constraint: Array,
    volume_stiffness: Array,
) -> float:
    """What v = u - (J - 1)^2 / 2 adds: returns K int v (N mm), inf where 1 + theta <= 0.

    b (n_p,) mm3, weights (n_q,) mm3, psi (n_q, n_p), mass_inverse (n_p, n_p) 1/mm3.  Adds
    int psi v' to `constraint` (n_p,) mm3 and fills `volume_stiffness` (n_p, n_p) MPa/mm3 with
    M^-1 (int psi psi' K v'') M^-1.
    """
    n_p = b.size
    moment = np.zeros((n_p, n_p))
    energy = 0.0
    for q in range(weights.size):
        v, v1, v2 = deviation(material.volumetric, dilation(b, psi[q], mass_inverse))
        if v == np.inf:
            return np.inf
        w = material.bulk * weights[q]
        energy += w * v
        for m in range(n_p):
            constraint[m] += weights[q] * psi[q, m] * v1
            for n in range(n_p):
                moment[m, n] += w * v2 * psi[q, m] * psi[q, n]
    volume_stiffness[:] = np.dot(np.dot(mass_inverse, moment), mass_inverse)
    return energy


@kernel()
def add_pressure_tangent(A: Array, F: Array, pressure: float) -> None:
    """Add pressure (MPa) * d2J/dFdF to A (3, 3, 3, 3) MPa at F (3, 3).

    d cof[i, j] / dF[k, m] = eps_ikx eps_jmy F[x, y].
    """
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            A[i, j, i1, j1] += pressure * F[i2, j2]
            A[i, j, i2, j2] += pressure * F[i1, j1]
            A[i, j, i1, j2] -= pressure * F[i2, j1]
            A[i, j, i2, j1] -= pressure * F[i1, j2]
