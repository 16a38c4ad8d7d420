"""Axisymmetric elements: derivatives, patch test, closed form."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from material_laws import energy as law_energy
from material_laws import make
from scipy.integrate import quad
from skfem import MeshQuad

from fe.driven import DrivenPotential, DrivenProblem, unknowns
from fe.driving import solve
from fe.materials import Material, material
from fe.newton import NewtonOptions
from fe.plane_elements import (
    axisymmetric_elements,
    hoop_equations,
    with_hoop,
)
from fe.steps import StepOptions

MATERIALS = {
    "mooney-rivlin-3": make("mooney-rivlin-3", 60.0),
    "ogden-2": make("ogden-2", 4.0, "simo-miehe"),
}
every_material = pytest.mark.parametrize("m", MATERIALS.values(), ids=MATERIALS.keys())


def distorted_mesh(left: float = 0.0) -> MeshQuad:
    """3 x 3 quadrilaterals of [left, left + 1.5] x [0, 1.2], the inner vertices moved."""
    mesh = MeshQuad.init_tensor(left + np.linspace(0.0, 1.5, 4), np.linspace(0.0, 1.2, 4))
    p = mesh.p.copy()
    inner = (p[0] > left + 0.01) & (p[0] < left + 1.49) & (p[1] > 0.01) & (p[1] < 1.19)
    p[:, inner] += 0.08 * np.random.default_rng(0).uniform(-1, 1, (2, int(inner.sum())))
    return MeshQuad(p, mesh.t)


def free_problem() -> DrivenProblem:
    """A distorted mesh with nothing prescribed but u_r on the axis."""
    table, basis = axisymmetric_elements(distorted_mesh())
    held = np.zeros((basis.N, 2), dtype=bool)
    held[basis.doflocs[0] < 1e-9, 0] = True
    equation = hoop_equations(held)
    return DrivenProblem(table, unknowns(table.nodes, equation), np.zeros(table.positions.shape))


@every_material
def test_gradient_and_tangent_are_derivatives_of_the_energy(m):
    potential = DrivenPotential(free_problem(), m)
    u, p = potential.zero_state()
    rng = np.random.default_rng(1)
    u = potential.expand(0.03 * rng.standard_normal(potential.n_unknowns))
    p = potential.consistent_pressure(u)
    free = rng.standard_normal(potential.n_unknowns)
    d = potential.expand(free)
    assembly = potential.assemble(u, p, 0.0, None)
    h = 1e-6

    def at(k: float) -> np.ndarray:
        x = u + k * h * d
        return potential.assemble(x, potential.consistent_pressure(x), 0.0, None).gradient

    energies = [potential.energy(u + k * h * d, 0.0, None) for k in (1, -1)]
    slope = assembly.gradient @ free
    np.testing.assert_allclose(slope, (energies[0] - energies[1]) / (2 * h), rtol=1e-6)
    pattern = potential.problem.pattern
    upper = sp.csr_matrix((assembly.data, pattern.indices, pattern.indptr))
    full = upper + sp.triu(upper, 1).T
    expected = (at(1) - at(-1)) / (2 * h)
    np.testing.assert_allclose(full @ free, expected, atol=1e-6 * np.abs(expected).max())


@every_material
def test_homogeneous_deformation_has_its_energy_and_no_forces_inside(m):
    problem = free_problem()
    x = problem.elements.positions[: len(problem.elements.positions) // 2, :2]
    H = np.diag([0.2, -0.1])
    u = with_hoop(x @ H.T)
    potential = DrivenPotential(problem, m)
    p = potential.consistent_pressure(u)
    assembly = potential.assemble(u, p, 0.0, None)
    F = np.eye(3)
    F[:2, :2] += H
    F[2, 2] = F[0, 0]
    W = law_energy(F, m.kernel())
    J = np.linalg.det(F)
    v = (J - 1) ** 2 / 2 if m.volumetric == "quadratic" else (J * J - 1 - 2 * np.log(J)) / 4
    volume = np.pi * 1.5**2 * 1.2
    np.testing.assert_allclose(assembly.energy, (W + m.bulk * v) * volume, rtol=1e-12)
    forces = np.abs(potential.expand(assembly.gradient))[: len(x)]
    inner = (x[:, 0] < 1.5 - 1e-9) & (x[:, 1] > 1e-9) & (x[:, 1] < 1.2 - 1e-9)
    assert inner.sum() > 20
    assert forces[inner].max() < 1e-11 * forces.max()


def tube_pressure(m: Material, inner: float, outer: float, swell: float) -> float:
    """Pressure (MPa) that widens an incompressible tube in plane strain: Green and Zerna (1954).

    p = integral over the wall of (lam^2 - lam^-2) mu / r dr with lam = r / R, for Mooney-Rivlin
    laws of two constants, which are neo-Hookean in plane strain.
    """
    a = inner + swell
    grown = a * a - inner * inner
    b = np.sqrt(outer * outer + grown)

    def slope(r: float) -> float:
        square = r * r / (r * r - grown)
        return m.shear_modulus * (square - 1.0 / square) / r

    return float(quad(slope, a, b)[0])


@pytest.mark.parametrize("swell", [0.3, 1.0])
def test_a_thick_tube_under_pressure_converges_to_the_closed_form(swell):
    inner, outer, height = 1.0, 2.0, 0.5
    m = material("mooney-rivlin-2", (0.2, 0.1), 1e5)
    errors = []
    for n in (1, 2, 4):
        mesh = MeshQuad.init_tensor(np.linspace(inner, outer, n + 1), np.array([0.0, height]))
        table, basis = axisymmetric_elements(mesh)
        fixed = np.zeros((basis.N, 2), dtype=bool)
        fixed[:, 1] = True
        wall = basis.doflocs[0] < inner + 1e-9
        fixed[wall, 0] = True
        motion = with_hoop(np.stack([wall.astype(float), np.zeros(basis.N)], axis=1))
        problem = DrivenProblem(table, unknowns(table.nodes, hoop_equations(fixed)), motion)
        solution = solve(
            problem,
            m,
            [swell],
            steps=StepOptions(0.05, 0.2, 1e-3),
            newton=NewtonOptions(1e-7, max_move=1.0),
        )
        pressure = solution.states[0].pin_force / (2 * np.pi * (inner + swell) * height)
        errors.append(abs(pressure / tube_pressure(m, inner, outer, swell) - 1))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 1e-4
    assert (rates > 2.5).all(), (errors, rates)


def test_a_section_across_the_axis_is_refused():
    with pytest.raises(ValueError, match=r"mesh: expected radii .* found -0\.5"):
        axisymmetric_elements(distorted_mesh(-0.5))
