"""Element kernels of the mixed u-p weak form, pressure condensed element by element.

Potential (per element e): Pi = int W_iso(F) + p (J - 1) - p^2 / (2 K) dV with p discontinuous and
linear in the reference coordinates, displacement triquadratic (Q2/P1, inf-sup stable: Brezzi and
Fortin, Mixed and Hybrid FEM, 1991, section VI).  Stationarity in p gives the displacement-only
energy E = int W_iso + K/2 b' M^-1 b with b = int psi (J - 1), M = int psi psi', whose gradient is
the condensed right-hand side of the u-p Newton step, so a line search on E costs nothing extra.

Any other volumetric law K u(J) = K/2 (J - 1)^2 + K v(J) is taken at the projected dilation
theta = psi' M^-1 b (three fields, as in Simo, Taylor and Pister, CMAME 51, 1985):
E = int W_iso + K/2 b' M^-1 b + K int v(1 + theta).  The pressure is M^-1 int psi K u'(1 + theta),
and M^-1 (int psi psi' K u'') M^-1 takes the place of K M^-1 in the tangent.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.condensed_tangent import element_tangent, left_factors, weighted_tangent
from fe.materials.invariant import cofactor
from fe.materials.isochoric import isochoric_energy, isochoric_stress
from fe.materials.material import KernelMaterial
from fe.materials.volumetric import QUADRATIC, deviation
from fe.volume_condensation import (
    add_deviation,
    add_pressure_tangent,
    dilation,
)

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class Elements(NamedTuple):
    """Q2 displacement and discontinuous P1 pressure at the volume quadrature points."""

    nodes: IntArray
    """(n_elem, n_a), n_a = 27"""
    positions: Array
    """(n_node, 3) mm"""
    gradients: Array
    """(n_elem, n_q, 3, n_a) dN/dX, 1/mm"""
    weights: Array
    """(n_elem, n_q) mm3"""
    psi: Array
    """(n_q, n_p) pressure functions"""
    mass_inverse: Array
    """(n_elem, n_p, n_p) inverse of int psi psi' dV, 1/mm3"""


class ElementSystem(NamedTuple):
    """Work arrays that `element_system` fills."""

    residual: Array
    """(n_elem, n_a, 3) gradient of the displacement-only energy, N"""
    coupling: Array
    """(n_elem, n_p, n_a, 3) derivative of b = int psi (J - 1) in u, mm2"""
    constraint: Array
    """(n_elem, n_p) b + int psi v'(1 + theta) - M p / K, mm3; v = 0 for the quadratic law"""
    volume_stiffness: Array
    """(n_elem, n_p, n_p) M^-1 (int psi psi' K v'') M^-1, MPa/mm3; 0 for the quadratic law"""
    tangent: Array
    """(n_elem, n_a, 3, 3, n_a) condensed tangent indexed [a, i, k, b], N/mm"""


class _Point(NamedTuple):
    """Work arrays of one quadrature point."""

    F: Array
    cof: Array
    P: Array
    A: Array


def empty_system(elements: Elements) -> ElementSystem:
    """Zeroed work arrays of the right shapes."""
    n_elem, n_a = elements.nodes.shape
    n_p = elements.psi.shape[1]
    return ElementSystem(
        residual=np.zeros((n_elem, n_a, 3)),
        coupling=np.zeros((n_elem, n_p, n_a, 3)),
        constraint=np.zeros((n_elem, n_p)),
        volume_stiffness=np.zeros((n_elem, n_p, n_p)),
        tangent=np.zeros((n_elem, n_a, 3, 3, n_a)),
    )


@kernel()
def _displacement_gradient(u: Array, elements: Elements, e: int) -> Array:
    """(3 n_q, 3) rows [3 q + j], columns i: du_i/dX_j at the points of element e."""
    n_quad, n_a = elements.weights.shape[1], elements.nodes.shape[1]
    ue = np.empty((n_a, 3))
    for a in range(n_a):
        for i in range(3):
            ue[a, i] = u[elements.nodes[e, a], i]
    H: Array = np.dot(elements.gradients[e].reshape(n_quad * 3, n_a), ue)
    return H


@kernel()
def _deformation_gradient(H: Array, q: int, F: Array) -> None:
    """Fill F (3, 3) at point q from the displacement gradients H (3 n_q, 3)."""
    for i in range(3):
        for j in range(3):
            F[i, j] = H[3 * q + j, i]
        F[i, i] += 1.0


@kernel()
def element_energy(u: Array, elements: Elements, material: KernelMaterial) -> float:
    """Displacement-only energy of all elements, N mm; inf where some det F <= 0.

    u (n_node, 3) mm.  Where a law is not finite at 1 + theta <= 0, the energy is inf there too.
    """
    n_elem, n_quad = elements.weights.shape
    n_p = elements.psi.shape[1]
    F = np.empty((3, 3))
    cof = np.empty((3, 3))
    b = np.empty(n_p)
    energy = 0.0
    for e in range(n_elem):
        H = _displacement_gradient(u, elements, e)
        b[:] = 0.0
        for q in range(n_quad):
            _deformation_gradient(H, q, F)
            J = cofactor(F, cof)
            if not J > 0.0:
                return np.inf
            energy += elements.weights[e, q] * isochoric_energy(
                material.law, F, J, material.constants
            )
            for m in range(n_p):
                b[m] += elements.weights[e, q] * elements.psi[q, m] * (J - 1.0)
        for m in range(n_p):
            for n in range(n_p):
                energy += 0.5 * material.bulk * b[m] * elements.mass_inverse[e, m, n] * b[n]
        if material.volumetric != QUADRATIC:
            for q in range(n_quad):
                theta = dilation(b, elements.psi[q], elements.mass_inverse[e])
                v = deviation(material.volumetric, theta)[0]
                energy += material.bulk * elements.weights[e, q] * v
    return energy


@kernel()
def element_system(
    u: Array,
    p: Array,
    elements: Elements,
    material: KernelMaterial,
    with_tangent: bool,
    system: ElementSystem,
) -> tuple[float, float]:
    """Residuals and condensed tangents of all elements; returns (energy N mm, smallest det F).

    u (n_node, 3) mm, p (n_elem, n_p) MPa; `system` is filled.
    Returns early with energy inf where `element_energy` is: the arrays are then incomplete.
    """
    bulk = material.bulk
    n_elem, n_quad = elements.weights.shape
    n_a, n_p = elements.nodes.shape[1], elements.psi.shape[1]
    point = _Point(np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3, 3, 3)))
    stack = np.empty((n_quad * 3, 3 * (1 + n_p)))
    left = left_factors(n_a, 3 * n_quad + n_p)
    right = np.empty((3 * n_quad + n_p, n_a))
    energy = 0.0
    smallest = np.inf
    for e in range(n_elem):
        H = _displacement_gradient(u, elements, e)
        G = elements.gradients[e].reshape(n_quad * 3, n_a)
        energy, smallest = _stack_element(
            energy,
            smallest,
            H,
            G,
            p[e],
            elements,
            e,
            material,
            with_tangent,
            point,
            stack,
            left,
            system.constraint[e],
        )
        if energy == np.inf:
            return energy, smallest
        energy += _condensed_residual(np.dot(G.T, stack), p[e], elements, e, material, system)
        if energy == np.inf:
            return energy, smallest
        if with_tangent:
            right[: 3 * n_quad] = G
            stiffness = bulk * elements.mass_inverse[e] + system.volume_stiffness[e]
            element_tangent(left, right, system.coupling[e], stiffness, system.tangent[e])
    return energy, smallest


@kernel()
def _stack_element(
    energy: float,
    smallest: float,
    H: Array,
    G: Array,
    p: Array,
    elements: Elements,
    e: int,
    material: KernelMaterial,
    with_tangent: bool,
    point: _Point,
    stack: Array,
    left: tuple[Array, Array, Array],
    constraint: Array,
) -> tuple[float, float]:
    """Fill stack, constraint (n_p,) and, if asked, left factors of element e at its points.

    Returns the energy so far with that of the law added, inf where det F <= 0, and the smallest
    det F so far.
    """
    constraint[:] = 0.0
    for q in range(elements.weights.shape[1]):
        w = elements.weights[e, q]
        _deformation_gradient(H, q, point.F)
        J = cofactor(point.F, point.cof)
        smallest = min(smallest, J)
        if not J > 0.0:
            return np.inf, smallest
        pressure = 0.0
        for m in range(p.size):
            pressure += elements.psi[q, m] * p[m]
        energy += w * isochoric_stress(
            material.law,
            point.F,
            point.cof,
            J,
            material.constants,
            point.P,
            point.A,
            with_tangent,
        )
        for m in range(p.size):
            gap = J - 1.0 - pressure / material.bulk
            constraint[m] += w * elements.psi[q, m] * gap
        _stack_forces(stack, q, w, pressure, point, elements.psi[q])
        if with_tangent:
            add_pressure_tangent(point.A, point.F, pressure)
            weighted_tangent(left, G, q, w, point.A)
    return energy, smallest


@kernel()
def _stack_forces(
    stack: Array, q: int, w: float, pressure: float, point: _Point, psi: Array
) -> None:
    """Weighted stress in the first three columns of rows 3 q + j, psi_m cof F in the others."""
    for j in range(3):
        for i in range(3):
            stack[3 * q + j, i] = w * (point.P[i, j] + pressure * point.cof[i, j])
            for m in range(psi.size):
                stack[3 * q + j, 3 * (m + 1) + i] = w * psi[m] * point.cof[i, j]


@kernel()
def _condensed_residual(
    forces: Array,
    p: Array,
    elements: Elements,
    e: int,
    material: KernelMaterial,
    system: ElementSystem,
) -> float:
    """Fill coupling and residual of element e from its stacked nodal forces (n_a, 3 (1 + n_p)).

    Returns the volumetric energy K/2 b' M^-1 b + K int v, where b = constraint + M p / K.
    """
    bulk = material.bulk
    n_a, n_p = forces.shape[0], p.size
    b = np.zeros(n_p)
    lagrange = np.zeros(n_p)
    for m in range(n_p):
        b[m] = system.constraint[e, m]
        for q in range(elements.weights.shape[1]):
            pressure = 0.0
            for n in range(n_p):
                pressure += elements.psi[q, n] * p[n]
            b[m] += elements.weights[e, q] * elements.psi[q, m] * pressure / bulk
    energy = 0.0
    if material.volumetric != QUADRATIC:
        energy += add_deviation(
            b,
            elements.weights[e],
            elements.psi,
            elements.mass_inverse[e],
            material,
            system.constraint[e],
            system.volume_stiffness[e],
        )
    for m in range(n_p):
        for n in range(n_p):
            lagrange[m] += bulk * elements.mass_inverse[e, m, n] * system.constraint[e, n]
            energy += 0.5 * bulk * b[m] * elements.mass_inverse[e, m, n] * b[n]
    for a in range(n_a):
        for i in range(3):
            system.residual[e, a, i] = forces[a, i]
            for m in range(n_p):
                system.coupling[e, m, a, i] = forces[a, 3 * (m + 1) + i]
                system.residual[e, a, i] += forces[a, 3 * (m + 1) + i] * lagrange[m]
    return energy
