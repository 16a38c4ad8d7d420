"""The one-element bar against the closed form, for every law, and its derivatives."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from material_laws import CONSTANTS, make

from fe import Bar, NewtonOptions, Status, StepOptions, UniaxialModel, material, simulate
from fe.closed_forms import uniaxial
from fe.materials.volumetric import VOLUMETRIC_CODES

BAR = Bar(2.0, 3.0, 1.5)
TRAVEL = (0.5, 1.8)
CASES = [(law, 50.0, "quadratic") for law in CONSTANTS]
CASES += [("ogden-2", 2.0, v) for v in VOLUMETRIC_CODES]
CASES += [("mooney-rivlin-3", 1000.0, "quadratic")]


@pytest.mark.parametrize("direction", ["tension", "compression"])
@pytest.mark.parametrize(("law", "bulk", "volumetric"), CASES)
def test_force_is_the_closed_form(law, bulk, volumetric, direction):
    material = make(law, bulk, volumetric)
    response = UniaxialModel(BAR, TRAVEL, direction).respond(material)
    assert response.status is Status.CONVERGED, response.message
    sign = 1.0 if direction == "tension" else -1.0
    stress = uniaxial(material, 1.0 + sign * response.travel / BAR.length)
    np.testing.assert_allclose(response.force, sign * stress * BAR.width * BAR.depth, rtol=1e-9)


def test_force_tends_to_the_incompressible_closed_form_as_one_over_the_bulk_modulus():
    incompressible = uniaxial(make("mooney-rivlin-3"), 1.0 + np.array(TRAVEL) / BAR.length)
    errors = []
    for bulk in (50.0, 500.0, 5000.0):
        response = UniaxialModel(BAR, TRAVEL).respond(make("mooney-rivlin-3", bulk))
        errors.append(response.force / (incompressible * BAR.width * BAR.depth) - 1.0)
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    np.testing.assert_allclose(ratios, 10.0, rtol=0.1)


def test_field_is_homogeneous_and_sides_are_free():
    model = UniaxialModel(BAR, TRAVEL, bulk_ratio=50.0)
    response = model(np.array([0.4, 0.1]))
    x, y = model.points().T
    for d, u in zip(response.travel, response.displacement, strict=True):
        np.testing.assert_allclose(u[:, 1], y * d / BAR.length, rtol=1e-12)
        np.testing.assert_allclose(u[:, 0] / x, u[:, 2] / BAR.depth, rtol=1e-9)


def test_gradients_are_those_of_central_differences():
    material = make("ogden-2", 4.0, "simo-miehe")
    model = UniaxialModel(BAR, TRAVEL, "compression")
    response = model.respond(material)
    assert response.parameters == ("mu1", "alpha1", "mu2", "alpha2", "bulk")
    numbers, h = np.array([*material.constants, material.bulk]), 1e-5
    for j in range(numbers.size):
        step = h * np.eye(numbers.size)[j]
        plus, minus = (
            model.respond(
                replace(
                    material,
                    constants=tuple((numbers + k * step)[:-1]),
                    bulk=float((numbers + k * step)[-1]),
                )
            )
            for k in (1, -1)
        )
        force = (plus.force - minus.force) / (2 * h)
        field = (plus.displacement - minus.displacement) / (2 * h)
        np.testing.assert_allclose(response.force_gradient[:, j], force, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(response.displacement_gradient[..., j], field, atol=1e-7)


def test_the_model_survives_pickling():
    model = UniaxialModel(BAR, TRAVEL)
    ratios = np.array([0.2, 0.1])
    copy = pickle.loads(pickle.dumps(model))
    assert copy == model
    assert copy(ratios).force.tobytes() == model(ratios).force.tobytes()


@pytest.mark.parametrize(
    ("make_model", "message"),
    [
        (lambda: Bar(width=0.0), "width: expected a length above 0 mm"),
        (lambda: UniaxialModel(BAR, (3.0,), "compression"), "travel: expected less than"),
        (lambda: UniaxialModel(BAR, (1.0, 0.5)), "travel: expected increasing"),
        (lambda: UniaxialModel(BAR, (1.0,), "torsion"), "direction: expected"),
        (lambda: UniaxialModel(BAR, (1.0,), bulk_ratio=-1.0), "bulk_ratio: expected a finite"),
        (lambda: UniaxialModel(BAR, (1.0,), field_grid=(2,)), "field_grid: expected 2 whole"),
        (lambda: UniaxialModel(BAR, ((0.1,), (0.2, 0.3))), "travel: expected a tuple of numbers"),
        (lambda: UniaxialModel(BAR, (1.0,), sensitivities=("r", "r")), "expected each name once"),
        (lambda: UniaxialModel(BAR, (1.0,), sensitivities=(1,)), "expected a tuple of names"),
        (lambda: UniaxialModel(BAR, (1.0,))("ab"), "ratios: expected two finite numbers"),
        (lambda: UniaxialModel(BAR, (1.0,)).respond("yeoh"), "material: expected fe.material"),
        (lambda: NewtonOptions(1.0), "tolerance: expected a share of the acting forces below 1"),
        (lambda: Bar(depth=float("inf")), "depth: expected a length above 0 mm, found inf"),
    ],
)
def test_wrong_arguments_are_refused(make_model, message):
    with pytest.raises(ValueError, match=message):
        make_model()


def test_short_steps_can_be_halved():
    assert StepOptions(0.0008).smallest == 1e-4
    assert StepOptions().smallest == 1e-3


def test_a_bar_whose_width_and_depth_part_is_no_oracle_and_says_so():
    """With C01 < 0 the square section turns into a strip, at less force than the closed form."""
    constants = (0.0198, -0.00525, 0.00025)
    theta = (*constants, 0.18)
    response = simulate(UniaxialModel(Bar(), (1.0, 2.0)), "mooney-rivlin-3", theta)
    assert response.status is Status.JUMPED
    assert "leaves the wanted branch of equilibria" in response.message
    assert 1.0 <= response.reached < 2.0  # what is beyond is there, and not counted as good
    expected = uniaxial(material("mooney-rivlin-3", constants, 0.18), np.array([2.0, 3.0]))
    assert response.force[0] == pytest.approx(expected[0], rel=1e-6)
    assert response.force[1] < 0.9 * expected[1]


@pytest.mark.parametrize(
    ("law", "theta", "force"),
    [("ogden-1", (2e-6, 1e4, 1.0), 0.505), ("neo-hookean", (0.01, 1e99), 0.0)],
)
def test_forces_that_are_no_numbers_are_no_equilibrium(law, theta, force):
    """Of 1e207 N it was said that all had converged."""
    response = simulate(UniaxialModel(Bar(), (0.05,)), law, theta)
    if response.status is Status.CONVERGED:
        assert response.force == pytest.approx(force, rel=1e-3)
    else:
        assert response.reached == 0.0


@pytest.mark.parametrize("size", [(1e8, 0.05, 1.0), (1e3, 0.05, 1.0), (1e-3, 1.0, 1.0)])
def test_bars_of_any_shape_have_their_force_or_none(size):
    width, length, depth = size
    response = simulate(UniaxialModel(Bar(*size), (0.1 * length,)), "neo-hookean", (0.01, 2.0))
    expected = width * depth * uniaxial(material("neo-hookean", (0.01,), 2.0), np.array([1.1]))
    if width < 1e8:
        assert response.status is Status.CONVERGED
    if response.status is Status.CONVERGED:
        assert response.force == pytest.approx(expected, rel=1e-6)
