"""Derivative of the element residual in material and mesh at a fixed displacement.

In the mesh: nodes that move by V change dN/dX by -dN/dX L and volumes by tr L, L = dV/dX, so that
F = I + H becomes F - H L (shape derivative of the discrete energy of `fe.weak_form`; e.g. Haslinger
and Maekinen, Introduction to Shape Optimization, SIAM 2003, section 3.3).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fe.materials.invariant import cofactor
from fe.materials.isochoric import isochoric_stress
from fe.materials.material import KernelMaterial, Material
from fe.materials.volumetric import deviation
from fe.volume_condensation import add_pressure_tangent, dilation
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class Directions(NamedTuple):
    """What the residual is differentiated along: n_c changes of the law, bulk, n_v of the mesh."""

    laws: IntArray
    """(n_c,) codes of the laws dW/dh"""
    constants: Array
    """(n_c, n_constant) of those laws, of which the first `sizes` count"""
    sizes: IntArray
    """(n_c,)"""
    motion: Array
    """(n_v, n_node, 3) of the nodes, mm per unit"""


def directions(material: Material, changes: Array, motion: Array) -> Directions:
    """Along `changes` (n_c, n_constant) of the constants and `motion` (n_v, n_node, 3) of nodes."""
    slopes = [material.slope(change) for change in changes]
    sizes = np.array([s.constants.size for s in slopes], dtype=np.int64)
    constants = np.zeros((len(slopes), max([1, *sizes.tolist()])))
    for row, slope in zip(constants, slopes, strict=True):
        row[: slope.constants.size] = slope.constants
    codes = np.array([s.law for s in slopes], dtype=np.int64)
    return Directions(codes, constants, sizes, np.ascontiguousarray(motion))


class _Volume(NamedTuple):
    """Mean dilation of one element and its pressure lambda = K M^-1 (b + int psi v')."""

    J: Array
    """(n_q,)"""
    F: Array
    """(n_q, 3, 3)"""
    cof: Array
    """(n_q, 3, 3)"""
    b: Array
    """(n_p,) mm3"""
    pressure: Array
    """(n_p,) coefficients over K"""


@njit(cache=True)
def residual_slopes(
    u: Array, elements: Elements, material: KernelMaterial, along: Directions, total: Array
) -> None:
    """Add to `total` (n_c + 1 + n_v, n_node, 3) the derivatives of the nodal forces, N per unit.

    In the order laws, bulk modulus, mesh; u (n_node, 3) mm.
    """
    n_elem, n_quad = elements.weights.shape
    n_a, n_p = elements.nodes.shape[1], elements.psi.shape[1]
    n_c, n_v = along.laws.size, along.motion.shape[0]
    volume = _Volume(
        np.empty(n_quad),
        np.empty((n_quad, 3, 3)),
        np.empty((n_quad, 3, 3)),
        np.empty(n_p),
        np.empty(n_p),
    )
    P, A = np.empty((3, 3)), np.empty((3, 3, 3, 3))
    none = np.empty((3, 3, 3, 3))
    stack = np.zeros((3 * n_quad, 3 * (n_c + 1 + n_v)))
    nodal = np.empty((n_a, 3 * (1 + n_v)))
    for e in range(n_elem):
        for a in range(n_a):
            node = elements.nodes[e, a]
            nodal[a, :3] = u[node]
            for v in range(n_v):
                nodal[a, 3 * v + 3 : 3 * v + 6] = along.motion[v, node]
        G = elements.gradients[e].reshape(3 * n_quad, n_a)
        H = np.dot(G, nodal)
        _fill_volume(H, elements, e, material, volume)
        changed = _pressure_slopes(H, elements, e, material, volume, n_v)
        for q in range(n_quad):
            w, F, cof, J = elements.weights[e, q], volume.F[q], volume.cof[q], volume.J[q]
            for c in range(n_c):
                constants = along.constants[c, : along.sizes[c]]
                isochoric_stress(along.laws[c], F, cof, J, constants, P, none, False)
                for j in range(3):
                    for i in range(3):
                        stack[3 * q + j, 3 * c + i] = w * P[i, j]
            dilating = 0.0
            for m in range(n_p):
                dilating += elements.psi[q, m] * volume.pressure[m]
            for j in range(3):
                for i in range(3):
                    stack[3 * q + j, 3 * n_c + i] = w * dilating * cof[i, j]
            if n_v == 0:
                continue
            pressure = material.bulk * dilating
            isochoric_stress(material.law, F, cof, J, material.constants, P, A, True)
            add_pressure_tangent(A, F, pressure)
            for j in range(3):
                for i in range(3):
                    P[i, j] += pressure * cof[i, j]
            for v in range(n_v):
                by_pressure = 0.0
                for m in range(n_p):
                    by_pressure += elements.psi[q, m] * changed[v, m]
                rows = stack[3 * q : 3 * q + 3, 3 * (n_c + 1 + v) : 3 * (n_c + 2 + v)]
                _stress_slope(H[3 * q : 3 * q + 3], v, w, P, A, cof, by_pressure, rows)
        forces = np.dot(G.T, stack)
        for a in range(n_a):
            node = elements.nodes[e, a]
            for column in range(n_c + 1 + n_v):
                for i in range(3):
                    total[column, node, i] += forces[a, 3 * column + i]


@njit(cache=True)
def _fill_volume(
    H: Array, elements: Elements, e: int, material: KernelMaterial, volume: _Volume
) -> None:
    """Fill `volume` from H (3 n_q, 3 (1 + n_v)), whose first columns are rows j of du_i/dX_j."""
    n_quad, n_p = elements.psi.shape
    volume.b[:] = 0.0
    for q in range(n_quad):
        F = volume.F[q]
        for i in range(3):
            for j in range(3):
                F[i, j] = H[3 * q + j, i] + (1.0 if i == j else 0.0)
        volume.J[q] = cofactor(F, volume.cof[q])
        for m in range(n_p):
            volume.b[m] += elements.weights[e, q] * elements.psi[q, m] * (volume.J[q] - 1.0)
    whole = volume.b.copy()
    for q in range(n_quad):
        theta = dilation(volume.b, elements.psi[q], elements.mass_inverse[e])
        slope = deviation(material.volumetric, theta)[1]
        for m in range(n_p):
            whole[m] += elements.weights[e, q] * elements.psi[q, m] * slope
    volume.pressure[:] = np.dot(elements.mass_inverse[e], whole)


@njit(cache=True)
def _pressure_slopes(
    H: Array, elements: Elements, e: int, material: KernelMaterial, volume: _Volume, n_v: int
) -> Array:
    """(n_v, n_p) derivative of the pressure's coefficients in the mesh, MPa per unit."""
    n_quad, n_p = elements.psi.shape
    mass_inverse, psi = elements.mass_inverse[e], elements.psi
    changed = np.empty((n_v, n_p))
    dF = np.empty((3, 3))
    for v in range(n_v):
        db, d_mass = np.zeros(n_p), np.zeros((n_p, n_p))
        for q in range(n_quad):
            w = elements.weights[e, q]
            stretch = _gradient_slope(H[3 * q : 3 * q + 3], v, dF)
            d_volume = w * stretch * (volume.J[q] - 1.0)
            for i in range(3):
                for j in range(3):
                    d_volume += w * volume.cof[q, i, j] * dF[i, j]
            for m in range(n_p):
                db[m] += psi[q, m] * d_volume
                for n in range(n_p):
                    d_mass[m, n] += w * stretch * psi[q, m] * psi[q, n]
        theta_b = np.dot(mass_inverse, volume.b)
        d_theta = np.dot(mass_inverse, db - np.dot(d_mass, theta_b))
        whole = db - np.dot(d_mass, volume.pressure)
        for q in range(n_quad):
            w = elements.weights[e, q]
            stretch = H[3 * q, 3 * v + 3] + H[3 * q + 1, 3 * v + 4] + H[3 * q + 2, 3 * v + 5]
            theta = along = 0.0
            for m in range(n_p):
                theta += psi[q, m] * theta_b[m]
                along += psi[q, m] * d_theta[m]
            _, v1, v2 = deviation(material.volumetric, theta)
            for m in range(n_p):
                whole[m] += w * psi[q, m] * (stretch * v1 + v2 * along)
        changed[v] = material.bulk * np.dot(mass_inverse, whole)
    return changed


@njit(cache=True)
def _gradient_slope(H: Array, v: int, dF: Array) -> float:
    """Fill dF (3, 3) = -(F - I) L of mesh motion v; returns tr L.  H (3, 3 (1 + n_v)) of a point.

    L_kj = dV_k/dX_j is in row j, column 3 (v + 1) + k.
    """
    for i in range(3):
        for j in range(3):
            dF[i, j] = 0.0
            for k in range(3):
                dF[i, j] -= H[k, i] * H[j, 3 * v + 3 + k]
    stretch: float = H[0, 3 * v + 3] + H[1, 3 * v + 4] + H[2, 3 * v + 5]
    return stretch


@njit(cache=True)
def _stress_slope(
    H: Array,
    v: int,
    w: float,
    S: Array,
    A: Array,
    cof: Array,
    by_pressure: float,
    rows: Array,
) -> None:
    """Fill rows [j, i] (3, 3) with d(w S_ij dN/dX_j) / (dN/dX_j) in mesh motion v."""
    dF = np.empty((3, 3))
    stretch = _gradient_slope(H, v, dF)
    for i in range(3):
        for j in range(3):
            value = stretch * S[i, j] + by_pressure * cof[i, j]
            for k in range(3):
                value -= S[i, k] * H[k, 3 * v + 3 + j]
                for m in range(3):
                    value += A[i, j, k, m] * dF[k, m]
            rows[j, i] = w * value
