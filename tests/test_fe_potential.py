"""Derivatives of the assembled gradient in the material's numbers, for every law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from material_laws import CONSTANTS, make

from fe import BlockPin, BlockPinModel, Contact
from fe.contact_memory import initial_memory
from fe.directions import directions
from fe.material_parameters import all_parameters, ratio_parameters
from fe.materials import Material
from fe.materials.material import mooney_rivlin_of_ratios
from fe.materials.volumetric import VOLUMETRIC_CODES
from fe.potential import Potential, Problem

BULK = 20.0
FAR_ABOVE = -10.0
"""travel (mm) at which the pin touches nothing"""
MODEL = BlockPinModel(BlockPin(), Contact("slide", "stick"), (2, 1, 1), (0.3,))
DISCRETE = MODEL.discretise()
RATIOS = np.array([0.4, 0.1])
MATERIALS = {name: make(name, BULK) for name in CONSTANTS} | {
    "logarithmic": make("ogden-2", BULK, "logarithmic"),
    "simo-miehe": make("yeoh", BULK, "simo-miehe"),
}
every_material = pytest.mark.parametrize("material", MATERIALS.values(), ids=MATERIALS.keys())


def problem() -> Problem:
    return MODEL.problem(DISCRETE, RATIOS)


def with_material(material: Material) -> Potential:
    return Potential(replace(problem(), material=material))


def bent() -> np.ndarray:
    """A displacement with large strains, lifted off the floor: its forces are no material's."""
    X = DISCRETE.elements.positions
    rng = np.random.default_rng(0)
    u = 0.06 * X * X[:, [1, 2, 0]] + 0.05 * rng.standard_normal(X.shape)
    u[:, 1] += 1.0
    return u


def inner_partials(material: Material, u: np.ndarray) -> np.ndarray:
    """(n_free, n_constant + 1) in every constant and, last, the bulk modulus."""
    changes, still = np.eye(len(material.constants)), np.zeros((0, *u.shape))
    along = directions(material, DISCRETE.elements, changes, still)
    return with_material(material).inner_partials(u, along)


def gradient(material: Material, u: np.ndarray) -> np.ndarray:
    potential = with_material(material)
    p = potential.consistent_pressure(u)
    memory = initial_memory(DISCRETE.faces, DISCRETE.glued, potential.problem.pin)
    return potential.assemble(u, p, FAR_ABOVE, memory).gradient


@every_material
def test_constants_gradient_is_the_difference_quotient_in_each_constant(material):
    u, h = bent(), 1e-4
    found = inner_partials(material, u)[:, :-1]
    for j, step in enumerate(np.eye(len(material.constants)) * h):
        plus, minus = (
            gradient(replace(material, constants=tuple(np.array(material.constants) + k * step)), u)
            for k in (1, -1)
        )
        expected = (plus - minus) / (2 * h)
        np.testing.assert_allclose(found[:, j], expected, atol=1e-6 * np.abs(expected).max())


@every_material
def test_bulk_gradient_is_the_difference_quotient_in_the_bulk_modulus(material):
    u, h = bent(), 1e-3
    found = inner_partials(material, u)[:, -1]
    plus, minus = (gradient(replace(material, bulk=BULK + k * h), u) for k in (1, -1))
    expected = (plus - minus) / (2 * h)
    np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())


def test_parameters_are_in_the_ratios_or_in_every_constant_and_the_bulk_modulus():
    law = mooney_rivlin_of_ratios(RATIOS, 0.02, BULK)
    ratios, every = ratio_parameters(law), all_parameters(law)
    assert ratios.names == ("r", "s", "bulk_ratio")
    np.testing.assert_allclose(ratios.constants, [[-0.02, 0.02, 0.0], [0.0, 0.0, 0.02], [0, 0, 0]])
    np.testing.assert_allclose(ratios.bulk, [0.0, 0.0, 0.04])
    assert not ratios.stiffness.any()
    assert every.names == ("C10", "C01", "C11", "bulk")
    np.testing.assert_array_equal(np.column_stack([every.constants, every.bulk]), np.eye(4))
    np.testing.assert_allclose(every.stiffness, [50.0, 50.0, 0.0, 0.0], atol=1e-12)


def test_contact_stiffness_goes_with_the_shear_modulus_of_exponents_too():
    law = make("ogden-2", BULK)
    h = 1e-6
    for j, found in enumerate(all_parameters(law).stiffness[:-1]):
        step = h * np.eye(4)[j]
        plus, minus = (
            np.log(replace(law, constants=tuple(law.constants + k * step)).shear_modulus)
            for k in (1, -1)
        )
        assert found == pytest.approx((plus - minus) / (2 * h), rel=1e-7)


@pytest.mark.parametrize("volumetric", VOLUMETRIC_CODES)
def test_the_consistent_pressure_leaves_nothing_in_the_volume_equation(volumetric):
    potential, u = with_material(make("ogden-3", BULK, volumetric)), bent()
    memory = initial_memory(DISCRETE.faces, DISCRETE.glued, potential.problem.pin)
    p = potential.consistent_pressure(u)
    assert np.abs(p).max() > 1e-2
    potential.assemble(u, p, 0.0, memory)
    still = potential.pressure_step(np.zeros_like(u))
    np.testing.assert_allclose(still, 0.0, atol=1e-12 * np.abs(p).max())


@pytest.mark.parametrize("volumetric", VOLUMETRIC_CODES)
def test_pressure_steps_are_the_derivative_of_the_consistent_pressure(volumetric):
    potential, u = with_material(make("ogden-3", BULK, volumetric)), bent()
    du = np.random.default_rng(3).standard_normal(u.shape)
    memory = initial_memory(DISCRETE.faces, DISCRETE.glued, potential.problem.pin)
    potential.assemble(u, potential.consistent_pressure(u), 0.0, memory)
    h = 1e-6
    plus, minus = (potential.consistent_pressure(u + k * h * du) for k in (1, -1))
    expected = (plus - minus) / (2 * h)
    step = potential.pressure_step(du)
    np.testing.assert_allclose(step, expected, atol=1e-7 * np.abs(expected).max())


def test_an_incompressible_material_is_refused():
    with pytest.raises(ValueError, match="material: expected a finite bulk modulus"):
        with_material(make("yeoh"))
