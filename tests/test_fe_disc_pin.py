"""A round disc under a round pin: closed forms, other models, energy balance, derivatives."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from fe import (
    BlockPin,
    BlockPinModel,
    Contact,
    Cylinder,
    CylinderModel,
    Disc,
    DiscPinModel,
    Status,
    simulate,
)
from fe.closed_forms import uniaxial
from fe.contact import PenaltyLaw
from fe.materials import material
from fe.newton import NewtonOptions
from fe.steps import StepOptions

STUCK, SLIDING, RUBBING = Contact(), Contact("slide", "slide"), Contact(0.3, 0.2)
CONTACTS = pytest.mark.parametrize(
    "contact", [STUCK, SLIDING, RUBBING], ids=["stick", "slide", "friction"]
)
LAW = (0.3, 0.2, 0.05, 20.0)
"""C10, C01, C11, bulk modulus, MPa"""
OF_LAW = ("C10", "C01", "C11", "bulk")
TIGHT = NewtonOptions(tolerance=1e-11)


def rubber(numbers=LAW):
    return material("mooney-rivlin-3", numbers[:-1], numbers[-1])


def small(contact: Contact, step: float = 0.1) -> DiscPinModel:
    steps = StepOptions(step, step)
    return DiscPinModel(
        Disc(), contact, (5, 2), (0.1, 0.2, 0.3), n_point=4, newton=TIGHT, steps=steps
    )


def test_a_frictionless_platen_gives_the_uniaxial_closed_form_through_the_penalty():
    m = rubber()
    model = DiscPinModel(Disc(pin_width=14.0), SLIDING, (2, 2), (0.3, 0.9))
    response = model.respond(m)
    assert response.status is Status.CONVERGED, response.message
    law = model.penalty

    def stress(travel: float, depth: float) -> float:
        return float(uniaxial(m, np.array([1.0 - (travel - depth) / 2.5]))[0])

    def force(travel: float) -> float:
        def missed(depth: float) -> float:  # of the surface into the platen
            pressure = law.stiffness * m.shear_modulus * depth**2 / (2 * law.ramp)
            return pressure + stress(travel, depth)

        return -stress(travel, brentq(missed, 0.0, law.ramp)) * np.pi * 5.0**2

    np.testing.assert_allclose(response.force, [force(t) for t in model.travel], rtol=1e-5)


@pytest.mark.lasting
def test_a_platen_that_sticks_presses_as_the_bonded_ends_of_a_cylinder_do():
    """Springs of contact on both ends of the whole against prescribed motion of a half.

    Their meshes differ, and their corners are singular: fine meshes are compared.
    """
    m = rubber((0.3, 0.2, 0.05, 200.0))
    travel = (0.05, 0.1)
    disc = DiscPinModel(Disc(pin_width=14.0), STUCK, (32, 24), travel).respond(m)
    half = CylinderModel(Cylinder(10.0, 2.5), (24, 12), travel, "bonded").respond(m)
    np.testing.assert_allclose(disc.force, half.force, rtol=1e-3)


@pytest.mark.lasting
def test_a_flat_punch_on_a_thick_disc_presses_as_on_a_half_space():
    # F = 8 mu a d, incompressible and frictionless: Sneddon, Int. J. Eng. Sci. 3 (1965); a disc of
    # twenty radii is a few per cent stiffer
    mu, travel = 1.0, 1e-3
    hard = PenaltyLaw(1e6, 1e-3)
    model = DiscPinModel(Disc(40.0, 20.0, 2.0, 0.02), SLIDING, (48, 32), (travel,), penalty=hard)
    response = model.respond(material("neo-hookean", (mu / 2,), 2000.0))
    np.testing.assert_allclose(response.force, 8.0 * mu * travel, rtol=0.04)


@pytest.mark.lasting
def test_a_wide_disc_is_pressed_as_a_wide_block_is():
    """The solid model with a round pin, the same lines along radius, width and height."""
    m = rubber((0.3, 0.2, 0.05, 200.0))
    travel, cells = (0.3,), (8, 3)
    block = BlockPin(width=16.0, depth=16.0, pin="round")
    solid = BlockPinModel(block, SLIDING, (*cells, 8), travel, sensitivities=()).respond(m)
    section = DiscPinModel(Disc(16.0), SLIDING, cells, travel).respond(m)
    np.testing.assert_allclose(section.force, solid.force, rtol=0.015)


@CONTACTS
def test_the_work_of_the_pin_is_stored_or_rubbed_away(contact):
    travel = tuple(np.arange(0.02, 0.61, 0.02).tolist())
    model = DiscPinModel(Disc(), contact, (8, 4), travel, steps=StepOptions(0.02, 0.02))
    states, outcome, _ = model.solve_for(rubber())
    assert outcome.reached == travel[-1]
    force = np.array([0.0, *(state.pin_force for state in states)])
    work = np.trapezoid(force, [0.0, *travel])
    rubbed = states[-1].friction_work
    assert rubbed > 0.0 if contact is RUBBING else rubbed == 0.0
    assert work == pytest.approx(states[-1].energy + rubbed, rel=5e-3)


def size(model: DiscPinModel, name: str) -> float:
    if name in OF_LAW:
        return LAW[OF_LAW.index(name)]
    if name.startswith("contact_"):
        return getattr(model.penalty, name.removeprefix("contact_"))
    if name.startswith("friction_"):
        return getattr(model.contact, name.removeprefix("friction_"))
    return 0.1 if name == "travel_zero" else getattr(model.specimen, name)


def moved(model: DiscPinModel, name: str, h: float):
    """Model and material with one parameter changed by h."""
    model = replace(model, sensitivities=())
    value = size(model, name) + h
    if name in OF_LAW:
        return model, rubber(tuple(np.array(LAW) + h * np.eye(4)[OF_LAW.index(name)]))
    if name == "travel_zero":
        return replace(model, travel=tuple(t - h for t in model.travel)), rubber()
    for group, part in (("contact_", "penalty"), ("friction_", "contact")):
        if name.startswith(group):
            changed = replace(getattr(model, part), **{name.removeprefix(group): value})
            return replace(model, **{part: changed}), rubber()
    return replace(model, specimen=replace(model.specimen, **{name: value})), rubber()


def names(model: DiscPinModel) -> tuple[str, ...]:
    """All but the stiffness of the base's spring, which only serves to read pressure."""
    idle = {"contact_base"} | (set() if model.contact is RUBBING else {"contact_slip"})
    return tuple(name for name in model.parameter_names(rubber()) if name not in idle)


STEPS = np.array([1.0, 0.25])
RELATIVE = 1.6e-2
"""largest change of a parameter, relative to its size: the smallest remainder, of the force in C11,
is then a hundred times what the tolerance of the equilibria leaves open"""
OF_DIMENSION = 1e-3
"""the same of a dimension: points pass the corners of the fillet, where second derivatives jump"""


@pytest.mark.lasting
@CONTACTS
def test_the_remainder_of_taylor_falls_with_the_square_in_every_parameter(contact):
    model = small(contact)
    base = replace(model, sensitivities=names(model)).respond(rubber())
    assert base.status is Status.CONVERGED, base.message
    for j, name in enumerate(base.parameters):
        found = []
        relative = OF_DIMENSION if hasattr(model.specimen, name) else RELATIVE
        for h in STEPS * relative * size(model, name):
            changed, law = moved(model, name, h)
            there = changed.respond(law)
            force = there.force - base.force - h * base.force_gradient[:, j]
            field = there.displacement - base.displacement - h * base.displacement_gradient[..., j]
            found.append([np.linalg.norm(force), np.linalg.norm(field)])
        # what rounding can do is far below the smallest remainder
        assert found[-1][0] > 10.0 * TIGHT.tolerance * np.linalg.norm(base.force), (name, found)
        assert np.abs(base.displacement_gradient[..., j]).max() > 0.0
        orders = np.polyfit(np.log(STEPS), np.log(found), 1)[0]
        assert (orders > 1.8).all(), (name, found)


@pytest.mark.lasting
@CONTACTS
def test_the_adjoint_agrees_with_the_direct_derivatives(contact):
    model = small(contact)
    model = replace(model, sensitivities=names(model))
    rng = np.random.default_rng(0)
    weights = rng.standard_normal((3, len(model.points()), 3))
    base = model.respond(rubber())
    found = model.objective_gradients(rubber(), lambda i, field, force: (weights[i], 0.3))
    expected = 0.3 * base.force_gradient
    expected = expected + np.einsum("ipk,ipkj->ij", weights, base.displacement_gradient)
    assert (np.abs(found - expected).max(axis=0) <= 1e-8 * np.abs(expected).max(axis=0)).all()


def test_forces_of_asked_travels_give_back_the_travels():
    model = small(RUBBING, 0.18)  # one step to each: friction depends on the way
    by_travel = model(np.array([0.4, 0.1]))
    by_force = replace(model, travel=(), force=tuple(by_travel.force))(np.array([0.4, 0.1]))
    np.testing.assert_allclose(by_force.travel, by_travel.travel, atol=1e-8)


def test_it_is_simulated_like_any_specimen_and_survives_pickling():
    model = pickle.loads(pickle.dumps(small(SLIDING)))
    assert model == small(SLIDING)
    told = []
    response = simulate(model, "mooney-rivlin-3", LAW, progress=told.append)
    assert response.force.tobytes() == small(SLIDING).respond(rubber()).force.tobytes()
    assert told[-1].force == response.force[-1]
    np.testing.assert_array_equal(response.points, model.points())
    assert (response.displacement[..., 0] > 0.0).all(), "the side bulges"
    assert (response.displacement[..., 2] == 0.0).all()


@pytest.mark.parametrize(
    ("make_model", "message"),
    [
        (lambda: Disc(diameter=0.0), "diameter: expected a length above 0 mm"),
        (lambda: Disc(pin_fillet=3.0), "pin_fillet: expected less than half"),
        (lambda: DiscPinModel(Disc(), STUCK, (0, 1), (0.1,)), "cells: expected 2 whole numbers of"),
        (lambda: DiscPinModel(Disc(), STUCK, (2, 1, 1), (0.1,)), "cells: expected 2 whole number"),
        (lambda: replace(small(STUCK), n_point=0), "n_point: expected a whole number"),
        (lambda: DiscPinModel(Disc(), STUCK, (2, 1), (2.5,)), "travel: expected less than the hei"),
        (lambda: DiscPinModel(Disc(), STUCK, (2, 1), ()), "travel: expected increasing"),
        (lambda: DiscPinModel(Disc(), STUCK, (2, 1), (1.0,), bulk_ratio=0.0), "bulk_ratio: exp"),
        (lambda: small(STUCK)(np.array([1.0])), "ratios: expected two finite numbers"),
        (
            lambda: replace(small(STUCK), sensitivities=("width",)).respond(rubber()),
            "sensitivities: expected names among .*, found 'width'",
        ),
    ],
)
def test_wrong_arguments_are_refused(make_model, message):
    with pytest.raises(ValueError, match=message):
        make_model()


@pytest.mark.parametrize("contact", [Contact(0.3, 0.3), Contact(0.05, 0.3), Contact(1.0, 1.0)])
def test_a_disc_that_rubs_starts_from_however_small_a_travel(contact):
    """At rest the springs under the base hold the body though they carry nothing yet."""
    model = DiscPinModel(Disc(), contact, (5, 2), (0.001, 0.1), n_point=4)
    whole = replace(model, travel=(0.1,))
    found, alone = model.respond(rubber()), whole.respond(rubber())
    assert found.status is Status.CONVERGED, found.message
    assert 0.0 < found.force[0] < 0.05 * found.force[1]
    assert found.force[1] == pytest.approx(alone.force[0], rel=1e-3)  # along other steps


def test_a_block_that_rubs_is_pressed_with_however_small_a_force():
    model = BlockPinModel(BlockPin(), Contact(0.3, 0.3), (4, 2, 1), (), force=(1e-4, 1e-2))
    found = model.respond(rubber())
    assert found.status is Status.CONVERGED, found.message
    assert found.force == pytest.approx([1e-4, 1e-2], rel=1e-4)
