"""Element kernels: energy, gradient, condensed tangent, patch test on distorted elements."""

from __future__ import annotations

import numpy as np
import pytest
from material_laws import CONSTANTS, make, stress
from skfem import MeshHex

from fe.discretisation import elements
from fe.materials.material import KernelMaterial
from fe.materials.volumetric import VOLUMETRIC_CODES, pressure
from fe.weak_form import Elements, ElementSystem, element_energy, element_system, empty_system

BULK = 60.0
MATERIALS = {
    **{name: make(name, BULK).kernel() for name in CONSTANTS},
    "logarithmic": make("mooney-rivlin-3", BULK, "logarithmic").kernel(),
    "simo-miehe": make("mooney-rivlin-3", BULK, "simo-miehe").kernel(),
    "compressible": make("ogden-2", 2.0, "simo-miehe").kernel(),
}
every_material = pytest.mark.parametrize("material", MATERIALS.values(), ids=MATERIALS.keys())


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


def project(table: Elements, values: np.ndarray) -> np.ndarray:
    """P1 coefficients (n_elem, 4) of values (n_elem, n_q) at the quadrature points."""
    b = np.einsum("eq,qm,eq->em", table.weights, table.psi, values)
    return np.einsum("emn,en->em", table.mass_inverse, b)


def dilation(table: Elements, u: np.ndarray) -> np.ndarray:
    F = np.einsum("eai,eqja->eqij", u[table.nodes], table.gradients) + np.eye(3)
    return project(table, np.linalg.det(F) - 1.0) @ table.psi.T


def consistent_pressure(table: Elements, u: np.ndarray, m: KernelMaterial) -> np.ndarray:
    theta = dilation(table, u)
    slope = np.vectorize(lambda t: pressure(m.volumetric, t))(theta)
    return project(table, m.bulk * slope)


def evaluate(
    table: Elements, u: np.ndarray, p: np.ndarray, m: KernelMaterial
) -> tuple[float, ElementSystem]:
    system = empty_system(table)
    energy, _ = element_system(u, p, table, m, True, system)
    return energy, system


def state(table: Elements, seed: int) -> tuple[np.ndarray, np.random.Generator]:
    """A displacement with dilations of up to a tenth, in which volumetric laws differ."""
    rng = np.random.default_rng(seed)
    return 0.05 * table.positions**2 + 0.01 * rng.standard_normal(table.positions.shape), rng


def test_weights_add_up_to_the_volume_and_gradients_to_zero():
    table, _ = elements(distorted_mesh())
    np.testing.assert_allclose(table.weights.sum(), 1.0 * 1.2 * 0.8, rtol=1e-12)
    np.testing.assert_allclose(table.gradients.sum(axis=3), 0.0, atol=1e-11)


@every_material
def test_gradient_is_the_derivative_of_the_energy_whatever_the_pressure(material):
    table, _ = elements(distorted_mesh())
    u, rng = state(table, 1)
    p = rng.standard_normal((table.nodes.shape[0], 4))
    energy, system = evaluate(table, u, p, material)
    np.testing.assert_allclose(energy, element_energy(u, table, material), rtol=1e-12)
    du = rng.standard_normal(u.shape)
    h = 1e-6
    slope = (
        element_energy(u + h * du, table, material) - element_energy(u - h * du, table, material)
    ) / (2 * h)
    np.testing.assert_allclose(np.sum(nodal(table, system.residual) * du), slope, rtol=1e-7)


@every_material
def test_condensed_tangent_is_the_hessian_at_consistent_pressure(material):
    table, _ = elements(distorted_mesh())
    u, rng = state(table, 2)
    _, system = evaluate(table, u, consistent_pressure(table, u, material), material)
    np.testing.assert_allclose(system.constraint, 0.0, atol=1e-14)
    du = rng.standard_normal(u.shape)
    h = 1e-6
    plus, minus = (
        evaluate(table, u + k * h * du, np.zeros((table.nodes.shape[0], 4)), material)[1].residual
        for k in (1, -1)
    )
    expected = (plus - minus) / (2 * h)
    change = np.einsum("eaikb,ebk->eai", system.tangent, du[table.nodes])
    np.testing.assert_allclose(change, expected, atol=1e-6 * np.abs(expected).max())


@every_material
def test_tangent_is_symmetric(material):
    table, _ = elements(distorted_mesh())
    u, _ = state(table, 3)
    _, system = evaluate(table, u, consistent_pressure(table, u, material), material)
    K = system.tangent.transpose(0, 1, 2, 4, 3).reshape(table.nodes.shape[0], 81, 81)
    np.testing.assert_allclose(K, K.transpose(0, 2, 1), atol=1e-10 * np.abs(K).max())


@pytest.mark.parametrize("volumetric", VOLUMETRIC_CODES)
def test_volumetric_energy_is_that_of_the_projected_dilation(volumetric):
    u_of_J = {
        "quadratic": lambda J: (J - 1) ** 2 / 2,
        "logarithmic": lambda J: np.log(J) ** 2 / 2,
        "simo-miehe": lambda J: (J**2 - 1 - 2 * np.log(J)) / 4,
    }[volumetric]
    table, _ = elements(distorted_mesh())
    u, _ = state(table, 4)
    only_volume = KernelMaterial(0, np.zeros(1), BULK, VOLUMETRIC_CODES[volumetric])
    expected = BULK * np.sum(table.weights * u_of_J(1.0 + dilation(table, u)))
    np.testing.assert_allclose(element_energy(u, table, only_volume), expected, rtol=1e-12)


@every_material
def test_homogeneous_deformation_has_the_stress_of_the_law(material):
    """Nodal forces on a distorted mesh are those of the constant P = P_iso + K u'(J) cof F."""
    table, _ = elements(distorted_mesh())
    F = np.eye(3) + np.array([[0.1, 0.3, 0.0], [-0.1, -0.2, 0.1], [0.2, 0.0, 0.15]])
    u = table.positions @ (F - np.eye(3)).T
    J = np.linalg.det(F)
    P = stress(F, material)[0]
    P += material.bulk * pressure(material.volumetric, J - 1.0) * J * np.linalg.inv(F).T
    system = evaluate(table, u, np.zeros((table.nodes.shape[0], 4)), material)[1]
    expected = np.einsum("eq,ij,eqja->eai", table.weights, P, table.gradients)
    np.testing.assert_allclose(system.residual, expected, atol=1e-12 * np.abs(expected).max())


@every_material
def test_homogeneous_deformation_of_distorted_elements_is_an_equilibrium(material):
    """Patch test: constant P leaves no residual at interior nodes."""
    table, _ = elements(distorted_mesh())
    gradient = np.array([[0.1, 0.3, 0.0], [-0.1, -0.2, 0.1], [0.2, 0.0, 0.15]])
    X = table.positions
    u = X @ gradient.T
    _, system = evaluate(table, u, consistent_pressure(table, u, material), material)
    inside = np.all((X > 1e-9) & (np.array([1.0, 1.2, 0.8]) - 1e-9 > X), axis=1)
    residual = nodal(table, system.residual)
    assert inside.any()
    np.testing.assert_allclose(residual[inside], 0.0, atol=1e-12 * np.abs(residual).max() * 10)


def test_an_inverted_element_has_infinite_energy():
    table, _ = elements(distorted_mesh())
    u = np.zeros(table.positions.shape)
    u[:, 1] = -1.5 * table.positions[:, 1]
    m = MATERIALS["mooney-rivlin-3"]
    assert element_energy(u, table, m) == np.inf
    assert evaluate(table, u, np.zeros((table.nodes.shape[0], 4)), m)[0] == np.inf


@pytest.mark.parametrize("volumetric", ["logarithmic", "simo-miehe"])
def test_a_projected_volume_below_zero_has_infinite_energy(volumetric):
    """The linear projection of J undershoots where J > 0 falls steeply towards one face."""
    table, _ = elements(MeshHex.init_tensor(*([np.array([0.0, 1.0])] * 3)))
    x = table.positions[:, 0]
    u = np.zeros(table.positions.shape)
    u[:, 0] = 0.75 * (x**2 - x)
    for axis in (1, 2):  # the cross-section grows with x too, so that J is a steep cubic
        u[:, axis] = 2.0 * x**2 * table.positions[:, axis]
    F = np.einsum("eai,eqja->eqij", u[table.nodes], table.gradients) + np.eye(3)
    assert np.linalg.det(F).min() > 0.0
    assert dilation(table, u).min() < -1.0
    m = make("neo-hookean", BULK, volumetric).kernel()
    assert element_energy(u, table, m) == np.inf
    assert evaluate(table, u, np.zeros((1, 4)), m)[0] == np.inf
    assert np.isfinite(element_energy(u, table, make("neo-hookean", BULK).kernel()))
