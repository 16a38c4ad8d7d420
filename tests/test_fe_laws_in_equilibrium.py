"""The whole solver with every law: a block under a frictionless platen, and its sensitivities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from material_laws import CONSTANTS, make

from fe import BlockPin, BlockPinModel, Contact
from fe.closed_forms import uniaxial
from fe.contact_memory import initial_memory
from fe.directions import directions
from fe.linear_solver import SymmetricSolver
from fe.materials import Material
from fe.materials.volumetric import VOLUMETRIC_CODES
from fe.newton import Equilibrium, NewtonOptions, equilibrate
from fe.potential import Potential

PLATEN = BlockPin(pin_width=40.0)
MODEL = BlockPinModel(PLATEN, Contact("slide", "slide"), (2, 1, 1), (0.3,))
DISCRETE = MODEL.discretise()
AREA = PLATEN.width * PLATEN.depth / 4.0
"""mm2 of the quarter that is modelled"""
CASES = [(law, "quadratic", 200.0) for law in CONSTANTS]
CASES += [("ogden-2", v, 14 / 3) for v in VOLUMETRIC_CODES]  # nu = 0.4
CASES += [("mooney-rivlin-3", v, 2000.0) for v in VOLUMETRIC_CODES]


def start(material: Material) -> tuple[Potential, SymmetricSolver]:
    problem = MODEL.problem(DISCRETE, np.array([0.5, 0.0]))
    return (
        Potential(replace(problem, material=material)),
        SymmetricSolver(DISCRETE.pattern.indptr, DISCRETE.pattern.indices),
    )


def compress(potential: Potential, solver: SymmetricSolver) -> list[Equilibrium]:
    """Equilibria at growing travels, each started from the one before."""
    memory = initial_memory(DISCRETE.faces, DISCRETE.glued, potential.problem.pin)
    u, p = potential.zero_state()
    found = []
    for travel in (0.1, 0.2, 0.3, 0.4):
        state = equilibrate(potential, solver, u, p, travel, memory, NewtonOptions(tolerance=1e-10))
        assert state.converged, (travel, state.reason)
        found.append(state)
        u, p = state.u, state.p
    return found


def solve(material: Material) -> list[Equilibrium]:
    potential, solver = start(material)
    states = compress(potential, solver)
    solver.close()
    return states


@pytest.mark.parametrize(("law", "volumetric", "ratio"), CASES)
def test_the_force_of_a_platen_is_the_uniaxial_closed_form(law, volumetric, ratio):
    material = make(law, ratio * make(law).shear_modulus, volumetric)
    top = DISCRETE.elements.positions[:, 1] > PLATEN.height - 1e-9
    for state in solve(material):
        stretch = 1.0 + state.u[top, 1] / PLATEN.height
        np.testing.assert_allclose(stretch, stretch[0], rtol=1e-7)
        expected = -uniaxial(material, stretch[0])[0] * AREA
        np.testing.assert_allclose(state.assembly.pin_force, expected, rtol=1e-7)


@pytest.mark.parametrize("volumetric", ["logarithmic", "simo-miehe"])
def test_newton_takes_as_many_iterations_as_with_the_quadratic_law(volumetric):
    bulk = 14 / 3 * make("ogden-2").shear_modulus
    quadratic, other = (solve(make("ogden-2", bulk, v)) for v in ("quadratic", volumetric))
    for a, b in zip(quadratic, other, strict=True):
        assert b.iterations <= a.iterations + 1


@pytest.mark.parametrize(("law", "volumetric"), [("ogden-2", "simo-miehe"), ("yeoh", "quadratic")])
def test_force_sensitivities_in_all_constants_and_the_bulk_modulus(law, volumetric):
    material = make(law, 10.0, volumetric)
    potential, solver = start(material)
    state = compress(potential, solver)[-1]
    solver.factorise(state.assembly.data)
    changes, still = np.eye(len(material.constants)), np.zeros((0, *state.u.shape))
    along = directions(material, potential.problem.elements, changes, still)
    slopes = state.assembly.by_travel @ solver.solve(-potential.inner_partials(state.u, along))
    solver.close()
    numbers, h = np.array([*material.constants, material.bulk]), 1e-4
    for j, slope in enumerate(slopes):
        plus, minus = (
            solve(
                replace(
                    material,
                    constants=tuple((numbers + k * h * np.eye(numbers.size)[j])[:-1]),
                    bulk=(numbers + k * h * np.eye(numbers.size)[j])[-1],
                )
            )[-1].assembly.pin_force
            for k in (1, -1)
        )
        np.testing.assert_allclose(slope, (plus - minus) / (2 * h), rtol=1e-5)
