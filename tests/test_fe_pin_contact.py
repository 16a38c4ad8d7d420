"""What is said of a contact that few points resolve, or that is deep in the pin."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import fe
from fe import BlockPin, BlockPinModel, Contact, PenaltyLaw, Status, simulate
from fe.contact import FREE, TIED_TO_PIN
from fe.pin_contact import DEEP, doubts, touching

THETA = (0.01, 0.2)


def respond(travel, contact=("slide", "stick"), cells=(3, 2, 2), **geometry) -> fe.Response:
    block = BlockPin(**geometry)
    of = BlockPinModel(block, Contact(*contact), cells, travel, field_grid=(2, 2))
    return fe.simulate(of, "neo-hookean", THETA)


@pytest.mark.parametrize("contact", [("slide", "stick"), ("stick", "stick")])
def test_a_pin_that_falls_between_contact_points_is_told(contact):
    """A round pin thinner than the distance of points meets none of them, or few."""
    response = respond((0.05, 0.1), contact, pin="round", pin_width=0.02, pin_fillet=0.002)
    assert response.status is Status.CONVERGED
    assert response.force[0] == 0.0
    assert "only 0 contact points of the mesh touch the pin at a travel of 0.0500 mm" in (
        response.message
    )


def test_a_usual_pin_is_not_doubted():
    assert respond((0.1, 0.3)).message == "reached every asked travel"


def test_a_surface_deep_in_the_pin_is_told_with_the_height_left():
    response = respond((0.5, 2.45), ("slide", "slide"), (4, 2, 2))
    assert "mm inside the pin at a travel of 2.4500 mm, with 0.05 mm of height" in response.message
    assert "the contact's stiffness is part of the force" in response.message


@pytest.mark.parametrize(("share", "told"), [(0.99, False), (1.01, True)])
def test_a_surface_is_deep_from_a_twentieth_of_the_height_left_on(share, told):
    model = BlockPinModel(BlockPin(pin_width=40.0), Contact("slide", "slide"), (3, 2, 2), (0.1,))
    faces = model.discretise().faces
    pin, tied = model.specimen.rigid_pin(10.0, 0.1, 1e3), np.full(faces.weights.shape, FREE)
    left = 2.5 - 0.4
    travel_of_surface = 0.4 - share * DEEP * left
    u = np.zeros(model.discretise().elements.positions.shape)
    u[:, 1] = -travel_of_surface * model.discretise().elements.positions[:, 1] / 2.5
    kinds = [kind for kind, _ in doubts(u, faces, tied, 0.4, pin)]
    assert kinds == (["penetration"] if told else [])


def test_points_and_depth_are_those_of_the_moved_surface():
    """All of the top 0.02 mm inside a platen that has come down by 0.1 mm; sides just beside it."""
    model = BlockPinModel(BlockPin(pin_width=40.0), Contact("slide", "slide"), (3, 2, 2), (0.1,))
    discrete = model.discretise()
    pin = model.specimen.rigid_pin(10.0, 0.1, 1e3)
    faces = discrete.faces
    u = np.zeros(discrete.elements.positions.shape)
    u[:, 1] = -0.08 * discrete.elements.positions[:, 1] / 2.5
    tied = np.full(faces.weights.shape, FREE)
    top = np.isclose(faces.points[..., 1], 2.5)
    n, deepest, mean = touching(u, faces, tied, 0.1, pin)
    in_pin = faces.points[..., 1] * (1.0 - 0.08 / 2.5) > 2.4
    assert n == in_pin.sum() >= top.sum()
    assert deepest == pytest.approx(0.02, abs=1e-12)
    assert deepest < DEEP * 2.4
    depth = np.maximum(faces.points[..., 1] * (1.0 - 0.08 / 2.5) - 2.4, 0.0)
    pressed = faces.weights * depth**2  # below the ramp pressure goes with the square
    assert mean == pytest.approx((pressed * depth).sum() / pressed.sum(), rel=1e-9)
    assert mean < deepest
    assert touching(u, faces, np.full_like(tied, TIED_TO_PIN), 0.1, pin)[0] == tied.size
    assert touching(0.0 * u, faces, tied, -0.1, pin) == (0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("contact", "s", "told"),
    [("slide", 0.05, False), ("slide", 0.5, True), (0.3, 0.5, True)],
)
def test_a_contact_that_takes_a_twentieth_of_the_force_is_told(contact, s, told):
    """What is said is what pins four times as stiff show, to a quarter of it."""
    theta = {"C10": 0.5, "C01": 0.5, "C11": s, "bulk": 200.0}
    # close to the last travel, so that the growth of the force is that there
    of = Contact(contact, contact)
    model = BlockPinModel(BlockPin(), of, (12, 4, 2), (1.18, 1.2), sensitivities=())
    response = simulate(model, "mooney-rivlin-3", theta)
    stiffer = replace(model, penalty=PenaltyLaw().stiffened(4))
    with_stiffer = simulate(stiffer, "mooney-rivlin-3", theta)
    rigid = 4.0 / 3.0 * (with_stiffer.force[-1] / response.force[-1] - 1.0)
    found = re.search("a rigid pin would need some ([0-9]+) % more force", response.message)
    assert (found is not None) is told
    if found is not None:
        assert int(found[1]) == pytest.approx(100.0 * rigid, rel=0.25)
        assert "rigid pin" not in with_stiffer.message
