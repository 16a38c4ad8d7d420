"""Axisymmetric Q2/P1 elements as tables of the three-dimensional kernel.

The kernel of fe.weak_form builds F = I + sum_a u_a (x) G_a from three displacements a node and any
gradients G_a.  In cylindrical axes the third column of F is (0, 0, 1 + u_r / r): the hoop stretch
is a third displacement with the gradient (0, 0, N_a / r) that is equal to u_r.  Each node therefore
has a second, *hoop* node at its place, in the same element, whose third displacement shares the
equation of the node's first.  Kernel, condensed pressure and laws are those of the solid.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from skfem import Basis, ElementQuad2, MeshQuad

from fe.discretisation import VOLUME_ORDER
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


def axisymmetric_elements(mesh: MeshQuad) -> tuple[Elements, Basis]:
    """Tables of a mesh of the half section (r, z), r >= 0 mm, of a body of revolution.

    Nodes n_node .. 2 n_node - 1 are the hoop nodes of 0 .. n_node - 1; `hoop_equations` ties them.
    Also returns the scikit-fem basis of one displacement.
    Raises ValueError when the section reaches across the axis.
    """
    if not mesh.p[0].min() >= -1e-12:
        raise ValueError(f"mesh: expected radii of 0 mm and more, found {mesh.p[0].min()}")
    basis = Basis(mesh, ElementQuad2(), intorder=VOLUME_ORDER)
    radius = np.asarray(basis.global_coordinates())[0]
    in_plane = np.stack([np.asarray(phi[0].grad) for phi in basis.basis]).transpose(2, 3, 1, 0)
    gradients = np.concatenate([in_plane, np.zeros_like(in_plane[:, :, :1])], axis=2)
    hoop = np.zeros_like(gradients)
    shape = np.stack([np.broadcast_to(np.asarray(phi[0]), radius.shape) for phi in basis.basis])
    hoop[:, :, 2, :] = (shape / radius).transpose(1, 2, 0)
    nodes = basis.element_dofs.T
    positions = np.vstack([basis.doflocs, np.zeros(basis.N)]).T
    return _table(
        basis,
        np.concatenate([gradients, hoop], axis=3),
        np.ascontiguousarray(np.hstack([nodes, nodes + basis.N]), dtype=np.int64),
        np.vstack([positions, positions]),
        2.0 * np.pi * radius * np.asarray(basis.dx),
    ), basis


def hoop_equations(fixed: npt.NDArray[np.bool_]) -> IntArray:
    """(6 n_node,) equation of each unknown, -1 where prescribed, of an axisymmetric table.

    `fixed` (n_node, 2) marks prescribed (u_r, u_z).  The third unknown of a hoop node has the
    equation of u_r of its node; its others and the third of ordinary nodes are unused.
    """
    n_node = len(fixed)
    equation = np.full((2 * n_node, 3), -1, dtype=np.int64)
    free = ~fixed
    equation[:n_node, :2][free] = np.arange(int(free.sum()))
    equation[n_node:, 2] = equation[:n_node, 0]
    return equation.ravel()


def with_hoop(values: Array) -> Array:
    """(2 n_node, 3) vectors of an axisymmetric table from (u_r, u_z) (n_node, 2), mm."""
    n_node = len(values)
    full = np.zeros((2 * n_node, 3))
    full[:n_node, :2] = values
    full[n_node:, 2] = values[:, 0]
    return full


def _table(
    basis: Basis, gradients: Array, nodes: IntArray, positions: Array, weights: Array
) -> Elements:
    reference = basis.quadrature[0] - 0.5
    psi = np.vstack([np.ones(reference.shape[1]), reference]).T.copy()
    mass = np.einsum("eq,qm,qn->emn", weights, psi, psi)
    return Elements(
        nodes=nodes,
        positions=np.ascontiguousarray(positions),
        gradients=np.ascontiguousarray(gradients),
        weights=np.ascontiguousarray(weights),
        psi=psi,
        mass_inverse=np.linalg.inv(mass),
    )
