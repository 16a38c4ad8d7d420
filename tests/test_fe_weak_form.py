"""Element kernels: energy, gradient, condensed tangent, patch test on distorted elements."""

from __future__ import annotations

import numpy as np
from skfem import MeshHex

from fe.discretisation import elements
from fe.weak_form import Elements, element_energy, element_system, empty_system

CONSTANTS = np.array([0.2, 0.1, 0.3])
BULK = 60.0


def distorted_mesh(seed: int = 0) -> MeshHex:
    """2 x 2 x 2 box with its inner node moved: hexahedra that are no parallelepipeds."""
    mesh = MeshHex.init_tensor(*(np.linspace(0.0, s, 3) for s in (1.0, 1.2, 0.8)))
    p = mesh.p.copy()
    inner = np.all((p > 1e-9) & (p < np.array([[1.0], [1.2], [0.8]]) - 1e-9), axis=0)
    p[:, inner] += 0.1 * np.random.default_rng(seed).uniform(-1, 1, (3, int(inner.sum())))
    return MeshHex(p, mesh.t)


def nodal(table: Elements, values: np.ndarray) -> np.ndarray:
    total = np.zeros(table.positions.shape)
    np.add.at(total, table.nodes, values)
    return total


def consistent_pressure(table: Elements, u: np.ndarray) -> np.ndarray:
    F = np.einsum("eai,eqja->eqij", u[table.nodes], table.gradients) + np.eye(3)
    b = np.einsum("eq,qm,eq->em", table.weights, table.psi, np.linalg.det(F) - 1.0)
    return BULK * np.einsum("emn,en->em", table.mass_inverse, b)


def evaluate(table: Elements, u: np.ndarray, p: np.ndarray):
    system = empty_system(table)
    energy, _ = element_system(u, p, table, CONSTANTS, BULK, True, system)
    return energy, system


def test_weights_add_up_to_the_volume_and_gradients_to_zero():
    table, _ = elements(distorted_mesh())
    np.testing.assert_allclose(table.weights.sum(), 1.0 * 1.2 * 0.8, rtol=1e-12)
    np.testing.assert_allclose(table.gradients.sum(axis=3), 0.0, atol=1e-11)


def test_gradient_is_the_derivative_of_the_energy_whatever_the_pressure():
    table, _ = elements(distorted_mesh())
    rng = np.random.default_rng(1)
    u = 0.01 * rng.standard_normal(table.positions.shape)
    p = rng.standard_normal((table.nodes.shape[0], 4))
    energy, system = evaluate(table, u, p)
    np.testing.assert_allclose(energy, element_energy(u, table, CONSTANTS, BULK), rtol=1e-12)
    du = rng.standard_normal(u.shape)
    h = 1e-6
    slope = (
        element_energy(u + h * du, table, CONSTANTS, BULK)
        - element_energy(u - h * du, table, CONSTANTS, BULK)
    ) / (2 * h)
    np.testing.assert_allclose(np.sum(nodal(table, system.residual) * du), slope, rtol=1e-7)


def test_condensed_tangent_is_the_hessian_at_consistent_pressure():
    table, _ = elements(distorted_mesh())
    rng = np.random.default_rng(2)
    u = 0.01 * rng.standard_normal(table.positions.shape)
    _, system = evaluate(table, u, consistent_pressure(table, u))
    du = rng.standard_normal(u.shape)
    h = 1e-6
    plus, minus = (
        evaluate(table, u + k * h * du, np.zeros((table.nodes.shape[0], 4)))[1].residual
        for k in (1, -1)
    )
    expected = (plus - minus) / (2 * h)
    change = np.einsum("eaikb,ebk->eai", system.tangent, du[table.nodes])
    np.testing.assert_allclose(change, expected, atol=1e-6 * np.abs(expected).max())


def test_tangent_is_symmetric():
    table, _ = elements(distorted_mesh())
    u = 0.01 * np.random.default_rng(3).standard_normal(table.positions.shape)
    _, system = evaluate(table, u, consistent_pressure(table, u))
    K = system.tangent.transpose(0, 1, 2, 4, 3).reshape(table.nodes.shape[0], 81, 81)
    np.testing.assert_allclose(K, K.transpose(0, 2, 1), atol=1e-10 * np.abs(K).max())


def test_homogeneous_deformation_of_distorted_elements_is_an_equilibrium():
    """Patch test: constant P leaves no residual at interior nodes."""
    table, _ = elements(distorted_mesh())
    gradient = np.array([[0.1, 0.3, 0.0], [-0.1, -0.2, 0.1], [0.2, 0.0, 0.15]])
    X = table.positions
    u = X @ gradient.T
    _, system = evaluate(table, u, consistent_pressure(table, u))
    inside = np.all((X > 1e-9) & (np.array([1.0, 1.2, 0.8]) - 1e-9 > X), axis=1)
    residual = nodal(table, system.residual)
    assert inside.any()
    np.testing.assert_allclose(residual[inside], 0.0, atol=1e-12 * np.abs(residual).max() * 10)


def test_an_inverted_element_has_infinite_energy():
    table, _ = elements(distorted_mesh())
    u = np.zeros(table.positions.shape)
    u[:, 1] = -1.5 * table.positions[:, 1]
    assert element_energy(u, table, CONSTANTS, BULK) == np.inf
    assert evaluate(table, u, np.zeros((table.nodes.shape[0], 4)))[0] == np.inf
