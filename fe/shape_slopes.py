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

from fe.compiled import kernel
from fe.directions import Directions
from fe.materials.invariant import cofactor, invariant_slopes
from fe.materials.law_codes import invariant_derivatives, is_separable
from fe.materials.material import KernelMaterial
from fe.materials.stretch import separable_stress
from fe.materials.volumetric import QUADRATIC, deviation
from fe.stress_slopes import stress_slopes
from fe.volume_condensation import dilation
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
    """(n_m, 9) [3 j + i] derivative of the stress P_ij, times volume, along each entry of L"""


@kernel()
def residual_slopes(
    u: Array, elements: Elements, material: KernelMaterial, along: Directions, total: Array
) -> None:
    """Add to `total` (n_node, 3, n_c + 1 + n_v) the derivatives of the nodal forces, N per unit.

    In the order laws, bulk modulus, mesh; u (n_node, 3) mm.
    """
    n_elem, n_quad = elements.weights.shape
    n_a, n_p = elements.nodes.shape[1], elements.psi.shape[1]
    n_column = total.shape[2]
    element = _empty_element(n_quad, n_p, along.stretch.shape[2])
    point = _empty_point(along.rows.size)
    stack = np.empty((n_quad, 9, n_column))
    nodal = np.empty((n_a, 3))
    for e in range(n_elem):
        for a in range(n_a):
            for i in range(3):
                nodal[a, i] = u[elements.nodes[e, a], i]
        G = elements.gradients[e].reshape(3 * n_quad, n_a)
        H = np.dot(G, nodal)
        _fill_volume(H, elements, e, material, element)
        if along.rates.size > 0:
            _fill_pressure_slopes(H, elements, e, material, along, element)
        _fill_stack(H, elements, e, material, along, element, point, stack)
        forces = np.dot(G.T, stack.reshape(3 * n_quad, 3 * n_column))
        for a in range(n_a):
            at = elements.nodes[e, a]
            for i in range(3):
                for c in range(n_column):
                    total[at, i, c] += forces[a, i * n_column + c]


@kernel()
def _empty_element(n_quad: int, n_p: int, n_v: int) -> _Element:
    return _Element(
        np.empty(n_quad),
        np.empty((n_quad, 3, 3)),
        np.empty((n_quad, 3, 3)),
        np.empty(n_p),
        np.empty(n_p),
        np.zeros((n_v, n_p)),
    )


@kernel()
def _empty_point(n_m: int) -> _Point:
    return _Point(np.empty((3, 3)), np.empty((3, 3, 3, 3)), np.empty((9, 3, 3)), np.empty((n_m, 9)))


@kernel()
def _fill_stack(
    H: Array,
    elements: Elements,
    e: int,
    material: KernelMaterial,
    along: Directions,
    element: _Element,
    point: _Point,
    stack: Array,
) -> None:
    """Fill `stack` [q, 3 j + i, c] with the weighted slopes of the stress P_ij, MPa mm3."""
    n_c, n_v = along.laws.size, along.stretch.shape[2]
    separable = is_separable(material.law)
    for q in range(elements.weights.shape[1]):
        w = elements.weights[e, q]
        dilating = 0.0
        for m in range(elements.psi.shape[1]):
            dilating += elements.psi[q, m] * element.pressure[m]
        F, cof, J = element.F[q], element.cof[q], element.J[q]
        invariants = (0.0, 0.0, 0.0)
        if not separable:
            invariants = invariant_slopes(F, cof, J, point.work)
        _stack_laws(F, J, w, q, invariants, along, point, stack)
        for j in range(3):
            for i in range(3):
                stack[q, 3 * j + i, n_c] = w * dilating * cof[i, j]
        if n_v == 0:
            continue
        stress_slopes(
            material,
            F,
            cof,
            J,
            material.bulk * dilating,
            H[3 * q : 3 * q + 3],
            along.rows,
            along.columns,
            point.work,
            invariants,
            point.P,
            point.A,
            point.slopes,
        )
        _stack_motions(elements.psi, w, e, q, along, element, point, stack)


@kernel()
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


@kernel()
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
    n_v = along.stretch.shape[2]
    mass_inverse, psi = elements.mass_inverse[e], elements.psi
    db = np.zeros((n_v, n_p))
    by_entry = np.empty(along.rows.size)
    for q in range(n_quad):
        cof = element.cof[q]
        for m in range(by_entry.size):
            k, j = along.rows[m], along.columns[m]
            by_entry[m] = element.J[q] - 1.0 if k == j else 0.0
            for i in range(3):
                by_entry[m] -= cof[i, j] * H[3 * q + k, i]
        for pair in range(along.motions.size):
            change = along.rates[e, q, pair] * by_entry[along.entries[pair]]
            for n in range(n_p):
                db[along.motions[pair], n] += elements.weights[e, q] * psi[q, n] * change
    whole = db - _times(along.masses[e], element.pressure)
    if material.volumetric != QUADRATIC:
        theta_b = np.dot(mass_inverse, element.b)
        d_theta = np.dot(db - _times(along.masses[e], theta_b), mass_inverse)
        for q in range(n_quad):
            _, v1, v2 = deviation(material.volumetric, np.dot(psi[q], theta_b))
            for v in range(n_v):
                change = along.stretch[e, q, v] * v1 + v2 * np.dot(psi[q], d_theta[v])
                whole[v] += elements.weights[e, q] * change * psi[q]
    element.along[:, :] = material.bulk * np.dot(whole, mass_inverse)


@kernel()
def _times(matrices: Array, x: Array) -> Array:
    """(n, k) products of symmetric matrices (n, k, k) and one vector (k,)."""
    n, k, _ = matrices.shape
    found: Array = np.dot(matrices.reshape(n * k, k), x).reshape(n, k)
    return found


@kernel()
def _stack_laws(
    F: Array,
    J: float,
    w: float,
    q: int,
    invariants: tuple[float, float, float],
    along: Directions,
    point: _Point,
    stack: Array,
) -> None:
    """Fill columns c < n_c of `stack` [q, 3 j + i, c] with the weighted stresses dP_ij of dW/dh.

    The derivatives of the invariants are common to all laws of these.
    """
    P = point.P
    i1, i2, j23 = invariants
    by_i1, by_i2 = point.work[4], point.work[5]
    for c in range(along.laws.size):
        law, constants = along.laws[c], along.constants[c, : along.sizes[c]]
        if is_separable(law):
            separable_stress(law, F, J, constants, P, point.A, False)
            for j in range(3):
                for i in range(3):
                    stack[q, 3 * j + i, c] = w * P[i, j]
            continue
        _, W1, W2, _, _, _ = invariant_derivatives(law, j23 * i1, j23 * j23 * i2, constants)
        for j in range(3):
            for i in range(3):
                stack[q, 3 * j + i, c] = w * (W1 * by_i1[i, j] + W2 * by_i2[i, j])


@kernel()
def _stack_motions(
    psi: Array,
    w: float,
    e: int,
    q: int,
    along: Directions,
    element: _Element,
    point: _Point,
    stack: Array,
) -> None:
    """Fill the last n_v columns of `stack` [q, 3 j + i, c] with weighted changes of stress."""
    first = along.laws.size + 1
    for v in range(along.stretch.shape[2]):
        by_pressure = 0.0
        for m in range(psi.shape[1]):
            by_pressure += psi[q, m] * element.along[v, m]
        by_pressure *= w
        for j in range(3):
            for i in range(3):
                stack[q, 3 * j + i, first + v] = by_pressure * element.cof[q, i, j]
    for pair in range(along.motions.size):
        rate, m = w * along.rates[e, q, pair], along.entries[pair]
        c = first + along.motions[pair]
        for row in range(9):
            stack[q, row, c] += rate * point.slopes[m, row]
