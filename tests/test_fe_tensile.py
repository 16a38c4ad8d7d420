"""The notched plate: symmetry, energy balance, scale symmetry, derivatives, large stretches."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from material_laws import make

from fe import NotchedPlate, Status, TensileModel
from fe.discretisation import elements
from fe.driven import DrivenProblem, equations, unknowns
from fe.driving import DrivenState, solve
from fe.materials import Material

PLATE = NotchedPlate()
MODEL = TensileModel(PLATE, (2, 4, 1), (3.0, 6.0), field_grid=(3, 5))


def states(model: TensileModel, problem: DrivenProblem, material: Material) -> list[DrivenState]:
    return solve(
        problem,
        material,
        model.travel,
        steps=model.steps,
        newton=model.newton,
    ).states


@pytest.mark.parametrize("ratios", [(0.0, 0.0), (1.0, 0.0), (0.0, 0.5), (1.0, 0.5)])
@pytest.mark.parametrize("bulk_ratio", [5.0, 2000.0])
def test_half_the_length_of_stretch_is_reached_at_the_corners_of_the_design(ratios, bulk_ratio):
    model = replace(MODEL, travel=(7.5, 15.0), bulk_ratio=bulk_ratio)
    response = model(np.array(ratios))
    assert response.status is Status.CONVERGED, response.message
    assert (response.negative_pivots == 0).all()
    assert response.force[1] > response.force[0] > 0.0


def test_the_force_is_the_derivative_of_the_stored_energy():
    h = 1e-3
    model = replace(MODEL, travel=(6.0 - h, 6.0, 6.0 + h))
    problem = model.discretise().problem
    low, middle, high = states(model, problem, make("yeoh", 20.0))
    np.testing.assert_allclose(middle.pin_force, (high.energy - low.energy) / (2 * h), rtol=1e-6)


def test_a_quarter_between_two_clamps_gives_the_force_of_the_eighth():
    material = make("mooney-rivlin-3", 40.0)
    upper = MODEL.mesh()
    table, _ = elements(upper + upper.mirrored((0.0, 1.0, 0.0)))
    x = table.positions
    fixed = np.zeros(x.shape, dtype=bool)
    fixed[x[:, 0] < 1e-9, 0] = True
    fixed[x[:, 2] < 1e-9, 2] = True
    fixed[np.abs(x[:, 1]) > PLATE.length / 2 - 1e-9] = True
    motion = np.zeros(x.shape)
    motion[x[:, 1] > PLATE.length / 2 - 1e-9, 1] = 1.0
    quarter = DrivenProblem(table, unknowns(table.nodes, equations(fixed)), motion)
    found = [4.0 * state.pin_force for state in states(MODEL, quarter, material)]
    np.testing.assert_allclose(found, MODEL.respond(material).force, rtol=1e-8)


def test_force_scales_with_the_material_and_the_field_does_not():
    ratios, kappa = np.array([0.4, 0.1]), 0.037
    one = MODEL(ratios)
    material = make("mooney-rivlin-3")
    constants = kappa * np.array([0.6, 0.4, 0.1])
    material = replace(material, constants=tuple(constants), bulk=400.0 * kappa)
    two = MODEL.respond(material)
    np.testing.assert_allclose(two.force, kappa * one.force, rtol=1e-9)
    np.testing.assert_allclose(two.displacement, one.displacement, atol=1e-9)
    by_ratio = kappa * (two.force_gradient[:, 1] - two.force_gradient[:, 0])
    np.testing.assert_allclose(by_ratio, kappa * one.force_gradient[:, 0], rtol=1e-6)


def test_gradients_are_those_of_central_differences():
    material = make("ogden-2", 6.0, "simo-miehe")
    model = replace(MODEL, travel=(6.0,))
    response = model.respond(material)
    numbers = np.array([*material.constants, material.bulk])
    direction, h = np.array([0.3, -0.5, 0.2, 0.4, 1.0]), 1e-4
    plus, minus = (
        model.respond(
            replace(
                material,
                constants=tuple((numbers + k * h * direction)[:-1]),
                bulk=float((numbers + k * h * direction)[-1]),
            )
        )
        for k in (1, -1)
    )
    force = (plus.force - minus.force) / (2 * h)
    field = (plus.displacement - minus.displacement) / (2 * h)
    np.testing.assert_allclose(response.force_gradient @ direction, force, rtol=1e-6)
    scale = np.abs(field).max()
    np.testing.assert_allclose(response.displacement_gradient @ direction, field, atol=1e-5 * scale)


def test_field_points_lie_on_the_front_face_and_are_moved_with_it():
    discrete = MODEL.discretise()
    at = discrete.probe.values @ discrete.problem.elements.positions
    np.testing.assert_allclose(at[:, :2], MODEL.points(), atol=1e-12)
    np.testing.assert_allclose(at[:, 2], PLATE.thickness / 2, atol=1e-12)
    response = MODEL(np.array([0.5, 0.1]))
    u = response.displacement[-1].reshape(5, 3, 3)
    assert (u[..., 0] < 0.0).all(), "the waist gets narrower"
    assert (np.diff(u[:, 0, 1]) > 0.0).all(), "the middle line is stretched"
    assert (u[..., 2] < 0.0).all(), "the plate gets thinner"


def test_field_points_may_be_given_by_their_places_and_stay_there():
    """So that their gradient by the width is that of what is seen at one place."""
    grid = replace(MODEL, sensitivities=("width",), travel=(3.0,))
    of_grid = grid([0.5, 0.1])
    fixed = replace(grid, field_grid=tuple(map(tuple, MODEL.points().tolist())))
    np.testing.assert_array_equal(fixed([0.5, 0.1]).displacement, of_grid.displacement)
    within = replace(grid, field_grid=((1.3, 2.1), (4.1, 0.7), (7.7, 13.0)))  # of elements
    step = 1e-4
    wider, less = (
        replace(within, specimen=replace(PLATE, width=PLATE.width + d), sensitivities=())
        for d in (step, -step)
    )
    by = (wider([0.5, 0.1]).displacement - less([0.5, 0.1]).displacement) / (2.0 * step)
    found = within([0.5, 0.1]).displacement_gradient[..., 0]
    np.testing.assert_allclose(found, by, atol=2e-6)
    edge = replace(fixed, field_grid=((10.0, 15.0), (6.0, 0.0), (0.0, 0.0)))
    assert np.isfinite(edge([0.5, 0.1]).displacement_gradient).all(), "on the edges, too"


@pytest.mark.parametrize("place", [(-0.1, 1.0), (7.0, 0.0), (1.0, 15.1), (1.0, -0.1)])
def test_field_points_beside_the_face_are_refused(place):
    with pytest.raises(ValueError, match="field_grid: expected points with x from 0 to half"):
        replace(MODEL, field_grid=((1.0, 1.0), place))


def test_the_notch_is_the_circle_asked_for():
    y = np.linspace(0.0, PLATE.length / 2, 50)
    half = PLATE.half_width(y)
    np.testing.assert_allclose(half[0], PLATE.width / 2 - PLATE.notch_depth)
    centre = PLATE.width / 2 + PLATE.notch_radius - PLATE.notch_depth
    inside = y < PLATE.notch_reach
    np.testing.assert_allclose(np.hypot(half - centre, y)[inside], PLATE.notch_radius)
    assert (half[~inside] == PLATE.width / 2).all()


def test_the_model_survives_pickling():
    copy = pickle.loads(pickle.dumps(MODEL))
    assert copy == MODEL
    ratios = np.array([0.2, 0.1])
    assert copy(ratios).displacement.tobytes() == MODEL(ratios).displacement.tobytes()


@pytest.mark.parametrize(
    ("make_model", "message"),
    [
        (lambda: NotchedPlate(width=-1.0), "width: expected a length above 0 mm"),
        (lambda: NotchedPlate(notch_depth=5.0), "notch_depth: expected less than the radius"),
        (lambda: NotchedPlate(length=8.0), "notch_radius: expected notches that end"),
        (lambda: TensileModel(PLATE, (1, 1, 1), (1.0,)), "cells: expected 3 whole numbers of"),
        (lambda: TensileModel(PLATE, (1, 2), (1.0,)), "cells: expected 3 whole numbers"),
        (lambda: TensileModel(PLATE, (1, 2, 1), (1.0,), field_grid=(0, 3)), "field_grid: expected"),
        (lambda: TensileModel(PLATE, (1, 2, 1), (0.0,)), "travel: expected increasing"),
        (lambda: TensileModel(PLATE, (1, 2, 1), (1.0, np.inf)), "travel: expected increasing"),
        (lambda: TensileModel(PLATE, (1, 2, 1), (1.0,), bulk_ratio=0.0), "bulk_ratio: expected"),
        (lambda: MODEL(np.array([0.1])), "ratios: expected two finite numbers"),
    ],
)
def test_wrong_arguments_are_refused(make_model, message):
    with pytest.raises(ValueError, match=message):
        make_model()
