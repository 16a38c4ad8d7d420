"""Exact solutions: homogeneous states to rounding, a manufactured one with the element's order.

The manufactured solution is nearly incompressible: a large shear that keeps the volume, and a part
of the size mu/K that changes it, so that the exact pressure p = K (J - 1) is of the size of the
shear stress.  The load int P : grad v dV makes it the solution; P comes from the energy by complex
steps, not from `fe`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import brentq
from skfem import Basis, ElementHex2, MeshHex

from benchmarks.dirichlet import DirichletProblem

CONSTANTS = np.array([0.2, 0.1, 0.15])
BULK_RATIO = 1000.0
BULK = BULK_RATIO * 2.0 * (CONSTANTS[0] + CONSTANTS[1])


def displacement(X: np.ndarray) -> np.ndarray:
    """X (..., 3) to u (..., 3)."""
    x, y, z = np.moveaxis(X, -1, 0)
    u = 0.2 * np.sin(2.0 * y) * np.cos(z)
    v = 0.15 * np.sin(1.5 * z + 0.3)
    w = 0.4 * np.sin(x + y) * np.cos(2.0 * z) / BULK_RATIO
    return np.stack([u, v, w], axis=-1)


def deformation_gradient(X: np.ndarray) -> np.ndarray:
    """X (..., 3) to F (..., 3, 3), by complex steps of the displacement."""
    h = 1e-30
    columns = [displacement(X + 1j * h * e).imag / h for e in np.eye(3)]
    return np.eye(3) + np.stack(columns, axis=-1)


def energy(F: np.ndarray) -> np.ndarray:
    """W (...,) of F (..., 3, 3), complex F allowed, written out from its definition."""
    J = (
        F[..., 0, 0] * (F[..., 1, 1] * F[..., 2, 2] - F[..., 1, 2] * F[..., 2, 1])
        - F[..., 0, 1] * (F[..., 1, 0] * F[..., 2, 2] - F[..., 1, 2] * F[..., 2, 0])
        + F[..., 0, 2] * (F[..., 1, 0] * F[..., 2, 1] - F[..., 1, 1] * F[..., 2, 0])
    )
    C = np.swapaxes(F, -1, -2) @ F
    trace = np.trace(C, axis1=-2, axis2=-1)
    i1 = J ** (-2 / 3) * trace - 3.0
    i2 = J ** (-4 / 3) * 0.5 * (trace**2 - np.trace(C @ C, axis1=-2, axis2=-1)) - 3.0
    c10, c01, c11 = CONSTANTS
    return c10 * i1 + c01 * i2 + c11 * i1 * i2 + BULK / 2.0 * (J - 1.0) ** 2


def stress(F: np.ndarray) -> np.ndarray:
    """P = dW/dF (..., 3, 3) by complex steps."""
    h = 1e-30
    P = np.empty(F.shape)
    for i in range(3):
        for j in range(3):
            step = np.zeros((3, 3), dtype=complex)
            step[i, j] = 1j * h
            P[..., i, j] = energy(F + step).imag / h
    return P


class Errors(NamedTuple):
    """L2 norms of the errors over the body."""

    displacement: float
    pressure: float
    stress: float


def load(mesh: MeshHex) -> np.ndarray:
    """(n_node, 3) int P : grad N dV with quadrature far finer than the element's."""
    basis = Basis(mesh, ElementHex2(), intorder=9)
    X = np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1)
    P = stress(deformation_gradient(X))
    total = np.zeros((basis.N, 3))
    for a, phi in enumerate(basis.basis):
        grad = np.asarray(phi[0].grad)
        nodal = np.einsum("eqij,jeq,eq->ei", P, grad, basis.dx)
        np.add.at(total, basis.element_dofs[a], nodal)
    return total


def errors(mesh: MeshHex) -> Errors:
    """Solve with u prescribed on all faces but z = 1, which is loaded."""
    problem = DirichletProblem(mesh, CONSTANTS, BULK)
    table = problem.elements
    fixed = np.zeros(table.positions.shape, dtype=bool)
    x, y, z = table.positions.T
    fixed[(x < 1e-9) | (x > 1 - 1e-9) | (y < 1e-9) | (y > 1 - 1e-9) | (z < 1e-9)] = True
    problem.prescribe(fixed)
    exact = displacement(table.positions)
    problem.u[:] = exact  # Newton's start; what it ends at does not depend on it
    problem.solve(exact, load(mesh))
    problem.close()
    X = np.moveaxis(np.asarray(problem.basis.global_coordinates()), 0, -1)
    shape = np.stack([np.asarray(phi[0]) for phi in problem.basis.basis])
    shape = np.broadcast_to(shape, (27, *table.weights.shape))
    u = np.einsum("aeq,eai->eqi", shape, problem.u[table.nodes])
    F = np.eye(3) + np.einsum("eai,eqja->eqij", problem.u[table.nodes], table.gradients)
    p = np.einsum("qm,em->eq", table.psi, problem.p)
    exact_F = deformation_gradient(X)
    exact_p = BULK * (np.linalg.det(exact_F) - 1.0)
    cofactor = np.linalg.det(F)[..., None, None] * np.swapaxes(np.linalg.inv(F), -1, -2)
    own_p = BULK * (np.linalg.det(F) - 1.0)
    P = stress(F) + (p - own_p)[..., None, None] * cofactor  # the mixed pressure, not K (J - 1)

    def norm(difference: np.ndarray) -> float:
        square = difference.reshape(*table.weights.shape, -1) ** 2
        return float(np.sqrt(np.sum(table.weights * square.sum(axis=-1))))

    return Errors(norm(u - displacement(X)), norm(p - exact_p), norm(P - stress(exact_F)))


def distorted_cube() -> MeshHex:
    """2 x 2 x 2 elements whose inner and middle vertices are moved."""
    mesh = MeshHex.init_tensor(*(np.linspace(0.0, 1.0, 3) for _ in range(3)))
    p = mesh.p.copy()
    middle = np.all(np.abs(p - 0.5) < 0.25, axis=0)
    p[:, middle] += np.array([[0.08], [-0.06], [0.05]])
    return MeshHex(p, mesh.t)


@pytest.fixture(scope="module")
def refined() -> list[Errors]:
    """Errors on 8, 64 and 512 elements, each element cut into eight."""
    mesh = distorted_cube()
    meshes = [mesh, mesh.refined(1), mesh.refined(2)]
    return [errors(m) for m in meshes]


def test_the_manufactured_stress_is_not_small_beside_its_pressure():
    """The case is one: large shear, pressure of the size of the stress, volume nearly kept."""
    X = np.random.default_rng(0).uniform(0.0, 1.0, (2000, 3))
    F = deformation_gradient(X)
    J = np.linalg.det(F)
    assert np.abs(F - np.eye(3)).max() > 0.3
    assert np.abs(J - 1.0).max() < 0.01
    assert 0.1 < np.abs(BULK * (J - 1.0)).max() / np.abs(stress(F)).max() < 10.0


@pytest.mark.parametrize(("name", "order"), [("displacement", 3), ("pressure", 2), ("stress", 2)])
def test_errors_fall_with_the_order_of_the_element(refined, name, order):
    """Q2 displacement: third order in L2; P1 pressure and stress: second (Brezzi and Fortin)."""
    values = np.array([getattr(e, name) for e in refined])
    slopes = np.log2(values[:-1] / values[1:])
    assert ((slopes > order - 0.1) & (slopes < order + 0.2)).all(), (values, slopes)


FREE = -1.0
HOMOGENEOUS = {
    "uniaxial": (0.6, FREE, FREE),
    "equibiaxial": (1.3, 1.3, FREE),
    "pure shear": (1.4, 1.0, FREE),
    "confined": (0.999, 1.0, 1.0),
}
"""stretches along x, y, z; those that are FREE are found from zero stress"""


def stretches(kind: str) -> np.ndarray:
    """(3,) principal stretches, the free ones (equal) from the closed form of their stress."""
    given = np.array(HOMOGENEOUS[kind])
    free = given == FREE
    if not free.any():
        return given

    def lateral_stress(stretch: float) -> float:
        return stress(np.diag(np.where(free, stretch, given)))[free.argmax(), free.argmax()]

    return np.where(free, brentq(lateral_stress, 0.3, 2.0, xtol=1e-15, rtol=1e-14), given)


@pytest.mark.parametrize("kind", HOMOGENEOUS)
def test_a_distorted_mesh_gives_the_closed_form_of_a_homogeneous_state(kind):
    """Faces at 0 and 1 are moved in their normal only; forces and field to 1e-10."""
    problem = DirichletProblem(distorted_cube(), CONSTANTS, BULK)
    X = problem.elements.positions
    given = np.array(HOMOGENEOUS[kind])
    fixed = np.abs(X) < 1e-9
    fixed |= (np.abs(X - 1.0) < 1e-9) & (given != FREE)
    problem.prescribe(fixed)
    full = np.where(given == FREE, 1.0, given)
    for fraction in np.linspace(0.0, 1.0, 6)[1:]:
        reactions = problem.solve(X * fraction * (full - 1.0), tolerance=1e-12)
    problem.close()
    expected = stretches(kind)
    np.testing.assert_allclose(problem.u, X * (expected - 1.0), atol=1e-10)
    P = stress(np.diag(expected))
    forces = [reactions[np.abs(X[:, i] - 1.0) < 1e-9, i].sum() for i in range(3)]
    np.testing.assert_allclose(forces, np.diag(P), atol=1e-10 * np.abs(P).max())
