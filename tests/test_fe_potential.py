"""Derivatives of the assembled gradient in the material's numbers, for every law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from material_laws import CONSTANTS, make

from fe import BlockPin, BlockPinModel, Contact
from fe.contact_memory import initial_memory
from fe.materials import Material
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


def gradient(material: Material, u: np.ndarray) -> np.ndarray:
    potential = with_material(material)
    p = potential.consistent_pressure(u)
    memory = initial_memory(DISCRETE.faces, DISCRETE.glued, potential.problem.pin)
    return potential.assemble(u, p, FAR_ABOVE, memory).gradient


@every_material
def test_constants_gradient_is_the_difference_quotient_in_each_constant(material):
    u, h = bent(), 1e-4
    found = with_material(material).constants_gradient(u)
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
    found = with_material(material).bulk_gradient(u)
    plus, minus = (gradient(replace(material, bulk=BULK + k * h), u) for k in (1, -1))
    expected = (plus - minus) / (2 * h)
    np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())


def test_ratio_gradient_is_a_contraction_of_the_constants_gradient():
    potential, u = Potential(problem()), bent()
    C10, C01, C11 = potential.constants_gradient(u).T
    columns = np.stack([C01 - C10, C11], axis=1)
    np.testing.assert_allclose(
        potential.ratio_gradient(u), columns, rtol=0, atol=1e-13 * np.abs(columns).max()
    )


def test_ratio_gradient_belongs_to_three_constants_of_mooney_and_rivlin():
    with pytest.raises(ValueError, match="law: expected mooney-rivlin-3, found yeoh"):
        with_material(make("yeoh", BULK)).ratio_gradient(bent())


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
