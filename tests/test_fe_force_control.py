"""Forces asked instead of travels: the same solutions, their derivatives, limit points."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import fe
from fe.closed_forms import uniaxial
from fe.contact import TIED_TO_PIN
from fe.contact_memory import (
    ContactMemory,
    initial_memory,
    slide_anchors,
    tie_touching,
)
from fe.materials import material
from fe.newton import NewtonOptions
from fe.pin_surface import BAR, ROUND, RigidPin
from fe.response import load_response, save_response
from fe.steps import StepOptions
from fe.surface_slopes import no_slopes
from fe.ties import Stick
from fe.touch import FrictionLaw

RATIOS = np.array([0.4, 0.1])
CONTACTS = pytest.mark.parametrize(
    "contact", [("slide", "slide"), ("stick", "stick"), (0.3, 0.2)], ids=["slide", "stick", "rub"]
)
THETA = {"C10": 0.02, "C01": 0.01, "C11": 0.003, "bulk": 6.0}


def block(contact, **changes) -> fe.BlockPinModel:
    """Each asked travel is one step: what sticks or rubs depends on the steps."""
    model = fe.BlockPinModel(
        fe.BlockPin(),
        fe.Contact(*contact),
        (3, 2, 1),
        (0.05, 0.1, 0.15),
        field_grid=(3, 2),
        newton=NewtonOptions(tolerance=1e-9),
        steps=StepOptions(0.08, 0.08),
    )
    return replace(model, **changes)


def at_forces_of(model, response):
    return replace(model, travel=(), force=tuple(response.force))


def test_forces_closer_than_the_hold_that_a_step_adds_say_so():
    """What has touched holds 0.3 % more once it sticks, at the same travel."""
    model = block(("stick", "stick"), travel=(), force=(0.1, 0.10005), cells=(4, 2, 2))
    response = fe.simulate(model, "mooney-rivlin-3", (0.008, 0.002, 0.001, 2.0))
    assert response.status is fe.Status.STOPPED
    assert response.force[0] == pytest.approx(0.1, rel=1e-8)
    assert "what has stuck holds more than the wanted force" in response.message
    assert "falls" not in response.message


@CONTACTS
@pytest.mark.parametrize("apart", [1e-11, 1e-10, 1e-7])
def test_forces_that_are_the_same_to_the_tolerance_do_not_end_a_run(contact, apart):
    model = block(contact, travel=(), newton=NewtonOptions(), force=(0.1, 0.1 * (1 + apart), 0.2))
    response = fe.simulate(model, "neo-hookean", (0.01, 0.2))
    assert response.status is fe.Status.CONVERGED, response.message
    np.testing.assert_allclose(response.force, model.force, rtol=2e-5)
    assert np.isfinite(response.force_gradient).all()
    assert np.isfinite(response.displacement_gradient).all()


@CONTACTS
def test_forces_of_asked_travels_give_back_the_travels_and_the_field(contact):
    model = block(contact)
    by_travel = model(RATIOS)
    by_force = at_forces_of(model, by_travel)(RATIOS)
    assert by_force.status is fe.Status.CONVERGED
    assert by_force.message == "reached every asked force"
    np.testing.assert_allclose(by_force.travel, by_travel.travel, atol=1e-8)
    np.testing.assert_allclose(by_force.force, by_travel.force, rtol=1e-9)
    np.testing.assert_allclose(by_force.displacement, by_travel.displacement, atol=1e-7)
    assert by_force.reached == by_force.travel[-1]


@pytest.mark.lasting
@CONTACTS
def test_derivatives_at_asked_forces_match_central_differences(contact):
    """Steps between the forces hang on the travel found at the last one, and move with it."""
    model = block(contact, steps=StepOptions(0.03, 0.03), travel=(), force=(7.0, 16.0))
    steps = []
    base = model(RATIOS)
    model.respond(material("mooney-rivlin-3", (0.6, 0.4, 0.1), 400.0), steps.append)
    assert len(steps) > len(model.force), "no step between the forces, nothing tested"
    assert not base.force_gradient.any()
    assert base.travel_gradient.shape == (2, 2)
    h = 1e-4
    for j, step in enumerate(h * np.eye(2)):
        plus, minus = model(RATIOS + step), model(RATIOS - step)
        travel = (plus.travel - minus.travel) / (2 * h)
        field = (plus.displacement - minus.displacement) / (2 * h)
        np.testing.assert_allclose(base.travel_gradient[:, j], travel, rtol=5e-5)
        np.testing.assert_allclose(
            base.displacement_gradient[..., j], field, atol=2e-5 * np.abs(field).max()
        )


def test_the_travel_at_a_force_is_that_of_the_force_over_kappa_at_kappa_one():
    model = block(("stick", "stick"), travel=(), force=(6.0, 12.0))
    r, s, kappa = *RATIOS, 0.03
    theta = (kappa * (1 - r), kappa * r, kappa * s, 2 * kappa * model.bulk_ratio)
    soft = replace(model, force=tuple(kappa * f for f in model.force))
    found = fe.simulate(soft, "mooney-rivlin-3", theta)
    np.testing.assert_allclose(found.travel, model(RATIOS).travel, rtol=1e-8)
    # a stiffer material needs less travel
    assert (found.travel_gradient[:, :2] < 0.0).all()


@pytest.mark.lasting
@pytest.mark.parametrize("shape", [BAR, ROUND], ids=["bar", "round"])
def test_anchors_follow_a_travel_that_depends_on_parameters(shape):
    """Those of stick and of friction; on the fillet the travel moves them sideways."""
    faces = block(("stick", "stick"), cells=(4, 2, 4)).discretise().faces
    pin = RigidPin(2.5, 2.0, 0.3, 500.0, 0.1, base_stiffness=2e4, shape=shape)
    law, travel = FrictionLaw(0.3, 0.2), 0.4
    rng = np.random.default_rng(0)
    u = 0.1 * rng.standard_normal((faces.nodes.max() + 1, 3)) - [0.0, 0.15, 0.0]
    du = rng.standard_normal((*u.shape, 3))
    dtravel = np.array([1.0, -0.7, 0.0])

    def after(step: float, j: int) -> ContactMemory:
        still = no_slopes(faces, 3)
        memory = initial_memory(faces, np.zeros(faces.weights.shape, bool), pin, still)
        at = (u + step * du[..., j], du, travel + step * dtravel[j], pin)
        seen = still._replace(height=still.height - dtravel)
        slide_anchors(memory, faces, *at, law, seen)
        tie_touching(memory, faces, *at, Stick(pin=True, floor=False), still, dtravel)
        return memory

    found, h = after(0.0, 0), 1e-7
    ties = found.ties
    tied = ties.kind == TIED_TO_PIN
    on_fillet = np.abs(ties.anchor[tied][:, 1] - 2.5) > 0.01
    assert np.count_nonzero(on_fillet) > 5
    for j in range(3):
        plus, minus = after(h, j), after(-h, j)
        anchor = (plus.ties.anchor - minus.ties.anchor)[tied] / (2 * h)
        np.testing.assert_allclose(ties.anchor_gradient[tied][..., j], anchor, atol=2e-5)
        place = (plus.slip.place - minus.slip.place) / (2 * h)
        np.testing.assert_allclose(found.slip.gradient[..., j], place, atol=2e-5)


SPECIMENS = {
    "uniaxial": fe.UniaxialModel(fe.Bar(), (0.2, 0.4), newton=NewtonOptions(1e-12)),
    "tensile": fe.TensileModel(fe.NotchedPlate(), (2, 2, 1), (2.0, 4.0), field_grid=(2, 3)),
    "cylinder": fe.CylinderModel(fe.Cylinder(), (3, 2), (2.0, 12.0), "bonded", n_point=4),
}


@pytest.mark.parametrize("name", SPECIMENS)
def test_every_specimen_takes_forces(name):
    model = replace(SPECIMENS[name], newton=NewtonOptions(1e-10, max_move=1.0))
    by_travel = fe.simulate(model, "mooney-rivlin-3", THETA)
    forced = at_forces_of(model, by_travel)
    by_force = fe.simulate(forced, "mooney-rivlin-3", THETA)
    assert by_force.status is fe.Status.CONVERGED, by_force.message
    np.testing.assert_allclose(by_force.travel, by_travel.travel, rtol=1e-8)
    np.testing.assert_allclose(by_force.displacement, by_travel.displacement, atol=1e-7)
    # no path to remember: dF/dp at fixed travel and dtravel/dp at fixed force are one implicit rule
    h = 1e-4
    plus, minus = (
        fe.simulate(forced, "mooney-rivlin-3", THETA | {"C10": 0.02 * (1 + k * h)}) for k in (1, -1)
    )
    travel = (plus.travel - minus.travel) / (2 * h * 0.02)
    field = (plus.displacement - minus.displacement) / (2 * h * 0.02)
    np.testing.assert_allclose(by_force.travel_gradient[:, 0], travel, rtol=1e-5)
    np.testing.assert_allclose(
        by_force.displacement_gradient[..., 0], field, atol=1e-5 * np.abs(field).max()
    )
    assert not by_force.force_gradient.any()


def test_with_friction_of_plates_the_travel_is_met():
    model = fe.CylinderModel(
        fe.Cylinder(), (3, 2), (1.0, 2.0), friction=0.2, steps=StepOptions(1.5, 1.5)
    )
    by_travel = model(RATIOS)
    by_force = at_forces_of(model, by_travel)(RATIOS)
    np.testing.assert_allclose(by_force.travel, by_travel.travel, rtol=1e-6)
    np.testing.assert_allclose(by_force.displacement, by_travel.displacement, atol=1e-6)
    assert np.isfinite(by_force.travel_gradient).all()


def test_a_force_beyond_a_limit_point_stops_and_names_travel_and_largest_force():
    soft = material("ogden-1", (1.0, 0.4), 1e3)  # its nominal stress has a maximum in tension

    def stress(stretch: float) -> float:
        return float(uniaxial(soft, np.array([stretch]))[0])

    top = minimize_scalar(lambda x: -stress(x), bounds=(1.2, 6.0), method="bounded").x
    assert stress(top) > stress(top + 1.0) > 0.0
    model = fe.UniaxialModel(fe.Bar(), force=(0.5 * stress(top), 1.05 * stress(top)))
    response = model.respond(soft)
    assert response.status is fe.Status.STOPPED
    assert response.force[0] == pytest.approx(0.5 * stress(top), rel=1e-9)
    assert np.isnan(response.force[1])
    assert np.isnan(response.travel[1])
    assert response.reached == pytest.approx(top - 1.0, abs=2e-3)
    assert "the force falls at a travel of" in response.message
    assert f"the largest force was {stress(top):.4g} N" in response.message


@pytest.mark.parametrize("direction", ["tension", "compression"])
def test_a_force_far_beyond_what_the_law_carries_stops_soon_and_says_how_far_it_came(direction):
    model = fe.UniaxialModel(fe.Bar(), force=(0.02, 1e6), direction=direction)
    response = fe.simulate(model, "neo-hookean", (0.02, 6.0))
    assert response.status is fe.Status.STOPPED
    assert response.force[0] == pytest.approx(0.02)
    assert np.isnan(response.force[1])
    assert response.n_factorisations < 1500
    assert response.reached > response.travel[0]
    assert "; the largest force was " in response.message
    if direction == "tension":
        assert response.message.startswith("the force was not met in 300 steps at a travel of ")


def test_a_force_that_the_block_cannot_carry_leaves_what_is_good():
    model = block(
        ("slide", "slide"), newton=NewtonOptions(max_iterations=12), travel=(), force=(5.0, 1e4)
    )
    response = model(RATIOS)
    assert response.status is fe.Status.STOPPED
    assert np.isfinite(response.displacement[0]).all()
    assert np.isnan(response.displacement[1]).all()
    assert response.reached >= response.travel[0]


def test_a_response_at_forces_survives_storage_and_its_model_pickling(tmp_path):
    model = block(("slide", "slide"), travel=(), force=(3.0,))
    assert pickle.loads(pickle.dumps(model)) == model
    response = model(RATIOS)
    save_response(tmp_path / "r.npz", response)
    loaded = load_response(tmp_path / "r.npz")
    np.testing.assert_array_equal(loaded.travel_gradient, response.travel_gradient)
    np.testing.assert_array_equal(loaded.travel, response.travel)


@pytest.mark.parametrize(
    "model",
    [
        fe.DiscPinModel(fe.Disc(), fe.Contact(), (4, 2), force=(2e3, 3e3)),
        fe.BlockPinModel(fe.BlockPin(pin_width=14.0), fe.Contact(), (3, 2, 2), force=(1e3, 1e5)),
        fe.CylinderModel(fe.Cylinder(5.0, 3.0), (3, 3), ends="bonded", force=(1e3, 1e5)),
    ],
    ids=["disc", "platen", "cylinder"],
)
def test_no_force_drives_pin_or_plates_through_the_specimen(model):
    response = fe.simulate(model, "neo-hookean", (0.015, 3.0))
    assert response.status is fe.Status.STOPPED
    assert response.reached < model.specimen.height
    assert np.isnan(response.force[-1])


def test_a_force_just_above_that_of_a_step_is_met_in_that_step():
    """It was refused: what sticks at the end of the short step before it holds more."""
    by_travel = block(("stick", "stick"))(RATIOS)
    for share in (0.9999, 0.999, 1.001):
        model = at_forces_of(block(("stick", "stick")), by_travel)
        model = replace(model, force=tuple(share * np.array(model.force)))
        steps = []
        constants = material("mooney-rivlin-3", (0.6, 0.4, 0.1), 400.0)
        response = replace(model, steps=StepOptions(0.05, 0.05)).respond(constants, steps.append)
        assert response.status is fe.Status.CONVERGED, response.message
        assert np.diff([0.0, *(step.travel for step in steps)]).max() < 1.1 * 0.05


@pytest.mark.lasting
def test_derivatives_with_a_pin_that_rubs_count_where_steps_between_forces_are():
    """A disc whose base hardly sticks: the anchors of its steps move with the travel of before."""
    of = fe.DiscPinModel(fe.Disc(), fe.Contact(1.0, 0.2), (5, 2), force=(0.2, 0.4, 0.6))
    model = replace(of, steps=StepOptions(0.03, 0.03), newton=NewtonOptions(tolerance=1e-9))

    def travel(c10: float) -> np.ndarray:
        return fe.simulate(model, "neo-hookean", (c10, 3.0)).travel

    found = fe.simulate(model, "neo-hookean", (0.015, 3.0)).travel_gradient[:, 0]
    slope = (travel(0.015 + 1e-6) - travel(0.015 - 1e-6)) / 2e-6
    np.testing.assert_allclose(found, slope, rtol=1e-4)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"travel": ()}, "travel: expected increasing travels above 0 mm"),
        ({"force": (1.0,)}, "force: expected travels or forces, found travel="),
        ({"travel": (), "force": (2.0, 1.0)}, "force: expected increasing forces above 0 N"),
        ({"travel": (), "force": (0.0, 1.0)}, "force: expected increasing forces above 0 N"),
        ({"travel": (), "force": (np.nan,)}, "force: expected increasing forces above 0 N"),
        ({"travel": (), "force": (1.0, np.inf)}, "force: expected increasing forces above 0 N"),
    ],
)
@pytest.mark.parametrize("model", [block(("stick", "stick")), *SPECIMENS.values()])
def test_targets_that_make_no_sense_are_refused(model, changes, words):
    with pytest.raises(ValueError, match=words):
        replace(model, **changes)
