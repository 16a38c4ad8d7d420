"""Derivative of the element residual in material and mesh at a fixed displacement.

In the mesh: nodes that move by V change dN/dX by -dN/dX L and volumes by tr L, L = dV/dX, so that
F = I + H becomes F - H L (shape derivative of the discrete energy of `fe.weak_form`; e.g. Haslinger
and Maekinen, Introduction to Shape Optimization, SIAM 2003, section 3.3).  All that is linear in L:
stresses are differentiated once along each entry of L, and put together for each motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fe.directions import Directions
from fe.materials.invariant import cofactor, invariant_slopes
from fe.materials.isochoric import isochoric_stress
from fe.materials.law_codes import invariant_derivatives, is_separable
from fe.materials.material import KernelMaterial
from fe.materials.volumetric import QUADRATIC, deviation
from fe.volume_condensation import add_pressure_tangent, dilation
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]


class _Element(NamedTuple):
    """Deformation and mean dilation of one element."""

    J: Array
    """(n_q,)"""
    F: Array
    """(n_q, 3, 3)"""
    cof: Array
    """(n_q, 3, 3)"""
    b: Array
    """(n_p,) mm3"""
    pressure: Array
    """(n_p,) coefficients over K: M^-1 (b + int psi v')"""
    along: Array
    """(n_v, n_p) derivative of the pressure's coefficients in the mesh, MPa per unit"""


class _Point(NamedTuple):
    """Work arrays of one quadrature point."""

    P: Array
    A: Array
    work: Array
    """(9, 3, 3) see `fe.materials.invariant.invariant_slopes`"""
    slopes: Array
    """(n_m, 3, 3) derivative of the stress, times volume, along each entry of L"""


@njit(cache=True)
def residual_slopes(
    u: Array, elements: Elements, material: KernelMaterial, along: Directions, total: Array
) -> None:
    """Add to `total` (n_node, 3, n_c + 1 + n_v) the derivatives of the nodal forces, N per unit.

    In the order laws, bulk modulus, mesh; u (n_node, 3) mm.
    """
    n_elem, n_quad = elements.weights.shape
    n_a, n_p = elements.nodes.shape[1], elements.psi.shape[1]
    n_v, n_m = along.rates.shape[2:]
    first = along.laws.size + 1
    element = _Element(
        np.empty(n_quad),
        np.empty((n_quad, 3, 3)),
        np.empty((n_quad, 3, 3)),
        np.empty(n_p),
        np.empty(n_p),
        np.empty((n_v, n_p)),
    )
    point = _Point(
        np.empty((3, 3)), np.empty((3, 3, 3, 3)), np.empty((9, 3, 3)), np.empty((n_m, 3, 3))
    )
    stack = np.empty((3 * n_quad, 3, first + n_v))
    nodal = np.empty((n_a, 3))
    for e in range(n_elem):
        for a in range(n_a):
            nodal[a] = u[elements.nodes[e, a]]
        G = elements.gradients[e].reshape(3 * n_quad, n_a)
        H = np.dot(G, nodal)
        _fill_volume(H, elements, e, material, element)
        if n_v > 0:
            _fill_pressure_slopes(H, elements, e, material, along, element)
        for q in range(n_quad):
            rows, w = stack[3 * q : 3 * q + 3], elements.weights[e, q]
            dilating = np.dot(elements.psi[q], element.pressure)
            _stack_laws(element, q, w, dilating, along, point, rows[:, :, :first])
            if n_v > 0:
                pressure = material.bulk * dilating
                _stress_slopes(H[3 * q : 3 * q + 3], element, q, pressure, material, along, point)
                by_pressure = np.dot(element.along, elements.psi[q])
                _stack_motions(
                    along.rates[e, q], w, by_pressure, element.cof[q], point, rows[:, :, first:]
                )
        forces = np.dot(G.T, stack.reshape(3 * n_quad, -1))
        for a in range(n_a):
            total[elements.nodes[e, a]] += forces[a].reshape(3, -1)


@njit(cache=True)
def _fill_volume(
    H: Array, elements: Elements, e: int, material: KernelMaterial, element: _Element
) -> None:
    """Fill all of `element` but `along` from H (3 n_q, 3), rows j of du_i/dX_j."""
    n_quad, n_p = elements.psi.shape
    element.b[:] = 0.0
    for q in range(n_quad):
        F = element.F[q]
        for i in range(3):
            for j in range(3):
                F[i, j] = H[3 * q + j, i] + (1.0 if i == j else 0.0)
        element.J[q] = cofactor(F, element.cof[q])
        for m in range(n_p):
            element.b[m] += elements.weights[e, q] * elements.psi[q, m] * (element.J[q] - 1.0)
    whole = element.b.copy()
    if material.volumetric != QUADRATIC:
        for q in range(n_quad):
            theta = dilation(element.b, elements.psi[q], elements.mass_inverse[e])
            slope = deviation(material.volumetric, theta)[1]
            for m in range(n_p):
                whole[m] += elements.weights[e, q] * elements.psi[q, m] * slope
    element.pressure[:] = np.dot(elements.mass_inverse[e], whole)


@njit(cache=True)
def _fill_pressure_slopes(
    H: Array,
    elements: Elements,
    e: int,
    material: KernelMaterial,
    along: Directions,
    element: _Element,
) -> None:
    """Fill `along` of the element: how the pressure's coefficients depend on the mesh."""
    n_quad, n_p = elements.psi.shape
    n_v, n_m = along.rates.shape[2:]
    mass_inverse, psi = elements.mass_inverse[e], elements.psi
    db = np.zeros((n_v, n_p))
    by_entry = np.empty(n_m)
    for q in range(n_quad):
        cof = element.cof[q]
        for m in range(n_m):
            k, j = along.rows[m], along.columns[m]
            by_entry[m] = element.J[q] - 1.0 if k == j else 0.0
            for i in range(3):
                by_entry[m] -= cof[i, j] * H[3 * q + k, i]
        for v in range(n_v):
            change = 0.0
            for m in range(n_m):
                change += along.rates[e, q, v, m] * by_entry[m]
            for n in range(n_p):
                db[v, n] += elements.weights[e, q] * psi[q, n] * change
    theta_b = np.dot(mass_inverse, element.b)
    for v in range(n_v):
        d_mass = along.masses[e, v]
        whole = db[v] - np.dot(d_mass, element.pressure)
        if material.volumetric != QUADRATIC:
            d_theta = np.dot(mass_inverse, db[v] - np.dot(d_mass, theta_b))
            for q in range(n_quad):
                _, v1, v2 = deviation(material.volumetric, np.dot(psi[q], theta_b))
                change = along.stretch[e, q, v] * v1 + v2 * np.dot(psi[q], d_theta)
                whole += elements.weights[e, q] * change * psi[q]
        element.along[v] = material.bulk * np.dot(mass_inverse, whole)


@njit(cache=True)
def _stack_laws(
    element: _Element,
    q: int,
    w: float,
    dilating: float,
    along: Directions,
    point: _Point,
    rows: Array,
) -> None:
    """Fill rows [j, i, c] (3, 3, n_c + 1) with the weighted stresses dP_ij of laws and bulk.

    The derivatives of the invariants are common to all laws of these.
    """
    n_c = along.laws.size
    F, cof, J, P = element.F[q], element.cof[q], element.J[q], point.P
    i1 = i2 = j23 = 0.0
    if n_c > 0:
        i1, i2, j23 = invariant_slopes(F, cof, J, point.work)
    by_i1, by_i2 = point.work[4], point.work[5]
    for c in range(n_c):
        law, constants = along.laws[c], along.constants[c, : along.sizes[c]]
        if is_separable(law):
            isochoric_stress(law, F, cof, J, constants, P, point.A, False)
            for j in range(3):
                for i in range(3):
                    rows[j, i, c] = w * P[i, j]
            continue
        _, W1, W2, _, _, _ = invariant_derivatives(law, j23 * i1, j23 * j23 * i2, constants)
        for j in range(3):
            for i in range(3):
                rows[j, i, c] = w * (W1 * by_i1[i, j] + W2 * by_i2[i, j])
    for j in range(3):
        for i in range(3):
            rows[j, i, n_c] = w * dilating * cof[i, j]


@njit(cache=True)
def _stress_slopes(
    H: Array,
    element: _Element,
    q: int,
    pressure: float,
    material: KernelMaterial,
    along: Directions,
    point: _Point,
) -> None:
    """Fill the slopes of `point`: d(S_ij dN/dX_j dV) / (dN/dX_j dV) along each entry of L.

    At fixed coefficients of the pressure; H (3, 3) of the point, rows j of du_i/dX_j.
    """
    F, cof, S, A = element.F[q], element.cof[q], point.P, point.A
    isochoric_stress(material.law, F, cof, element.J[q], material.constants, S, A, True)
    add_pressure_tangent(A, F, pressure)
    for i in range(3):
        for j in range(3):
            S[i, j] += pressure * cof[i, j]
    for m in range(along.rows.size):
        k, j = along.rows[m], along.columns[m]
        slope = point.slopes[m]
        for i in range(3):
            for n in range(3):
                value = S[i, n] if k == j else 0.0
                for p in range(3):
                    value -= A[i, n, p, j] * H[k, p]
                slope[i, n] = value
            slope[i, k] -= S[i, j]


@njit(cache=True)
def _stack_motions(
    rates: Array, w: float, by_pressure: Array, cof: Array, point: _Point, rows: Array
) -> None:
    """Fill rows [j, i, v] (3, 3, n_v) with the weighted changes of the stress in each motion.

    `rates` (n_v, n_m) of the point, `by_pressure` (n_v,) MPa what the pressure changes by.
    """
    for j in range(3):
        for i in range(3):
            for v in range(by_pressure.size):
                value = by_pressure[v] * cof[i, j]
                for m in range(rates.shape[1]):
                    value += rates[v, m] * point.slopes[m, i, j]
                rows[j, i, v] = w * value
