"""Quarter, half and full models: where they agree, and what a shifted or turned pin does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fe import BlockPin, BlockPinModel, Contact, Status
from fe.newton import NewtonOptions

RATIOS = np.array([0.4, 0.1])
PINS = pytest.mark.parametrize("pin", ["bar", "round"])


def model(symmetry: str = "auto", contact=("stick", "stick"), **geometry) -> BlockPinModel:
    return BlockPinModel(
        BlockPin(**geometry),
        Contact(*contact),
        (3, 1, 2),
        (0.1, 0.2),
        field_grid=(4, 2),
        newton=NewtonOptions(tolerance=1e-9),
        symmetry=symmetry,
    )


def mirrored(field: np.ndarray) -> np.ndarray:
    """Field (n_step, n_point, 3, ...) of 4 x 2 points on half the front face, on all of it."""
    grid = field.reshape(len(field), 4, 2, *field.shape[2:])
    other = grid[:, ::-1].copy()
    other[:, :, :, 0] *= -1.0
    return np.concatenate([other, grid], axis=1).reshape(len(field), 16, *field.shape[2:])


@pytest.mark.lasting
@PINS
@pytest.mark.parametrize(
    "contact",
    [("stick", "stick"), ("slide", "stick"), ("stick", 0.3), (0.3, 0.2), (0.3, "slide")],
    ids=["glued", "pin", "rub", "both", "rub-slide"],
)
def test_half_and_full_models_agree_with_the_quarter(pin, contact):
    part = replace(model("quarter", contact, pin=pin), cells=(2, 1, 2))
    quarter = part(RATIOS)
    for symmetry in ("half", "full"):
        whole = replace(part, symmetry=symmetry)(RATIOS)
        assert whole.status is Status.CONVERGED
        np.testing.assert_allclose(whole.force, quarter.force, rtol=1e-6)
        np.testing.assert_allclose(whole.force_gradient, quarter.force_gradient, rtol=1e-5)
        assert whole.displacement.shape == (2, 16, 3)
        np.testing.assert_allclose(whole.displacement, mirrored(quarter.displacement), atol=1e-6)


@pytest.mark.parametrize(
    ("geometry", "part"),
    [
        ({}, "quarter"),
        ({"pin": "round"}, "quarter"),
        ({"pin_rotation": 180.0}, "quarter"),  # a bar turned to the same place
        ({"pin": "round", "pin_rotation": 7.0}, "quarter"),
        ({"pin_shift": (0.0, 0.4)}, "quarter"),  # along a bar that runs through anyway
        ({"pin_shift": (0.4, 0.0)}, "half"),
        ({"pin": "round", "pin_shift": (0.4, 0.0)}, "half"),
        ({"pin": "round", "pin_shift": (0.0, 0.4)}, "full"),
        ({"pin_rotation": 7.0}, "full"),
    ],
)
def test_the_smallest_part_that_stands_for_the_whole_is_chosen(geometry, part):
    m = model(**geometry)
    assert m.part == part
    lower = m.mesh().p.min(axis=1)
    assert (lower[0] < 0.0, lower[2] < 0.0) == (part != "quarter", part == "full")


@PINS
def test_a_pin_shifted_the_other_way_gives_the_mirrored_field(pin):
    right, left = (model(pin=pin, pin_shift=(s, 0.0))(RATIOS) for s in (0.5, -0.5))
    np.testing.assert_allclose(left.force, right.force, rtol=1e-7)
    flip = left.displacement.reshape(2, 8, 2, 3)[:, ::-1].reshape(2, 16, 3) * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose(flip, right.displacement, atol=1e-7)


@PINS
def test_the_front_face_bulges_more_on_the_side_to_which_the_pin_is_shifted(pin):
    m = model(pin=pin, pin_shift=(0.8, 0.0))
    assert m.points()[0, 0] < 0.0 < m.points()[-1, 0]
    shifted = m(RATIOS).displacement[-1].reshape(8, 2, 3)[..., 2]
    centred = model("half", pin=pin)(RATIOS).displacement[-1].reshape(8, 2, 3)[..., 2]
    assert (shifted[-1] > centred[-1]).all()
    assert (shifted[0] < centred[0]).all()


def test_a_round_pin_shifted_along_z_is_one_shifted_along_x_seen_from_the_side():
    m = replace(model(pin="round", pin_shift=(0.0, 0.5)), cells=(2, 1, 2))
    along_z, along_x = (
        replace(m, specimen=replace(m.specimen, pin_shift=s), symmetry="full")(RATIOS)
        for s in ((0.0, 0.5), (0.5, 0.0))
    )
    np.testing.assert_allclose(along_z.force, along_x.force, rtol=1e-6)
    # the pin is nearer to the front face, which moves out further
    assert along_z.displacement[-1, :, 2].max() > along_x.displacement[-1, :, 2].max()


@pytest.mark.lasting
def test_a_bar_turned_either_way_gives_the_mirrored_field_and_breaks_the_symmetry():
    one, other = (model(pin_rotation=a)(RATIOS) for a in (6.0, -6.0))
    np.testing.assert_allclose(other.force, one.force, rtol=1e-7)
    flip = other.displacement.reshape(2, 8, 2, 3)[:, ::-1].reshape(2, 16, 3) * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose(flip, one.displacement, atol=1e-7)
    straight = model("full")(RATIOS)
    assert np.abs(one.displacement - straight.displacement).max() > 1e-3
    # in front, at z > 0, a bar turned from z towards x is on the side of x > 0
    u = one.displacement[-1].reshape(8, 2, 3)
    assert (u[-1, :, 0] > -u[0, :, 0]).all()


@pytest.mark.parametrize("shift", [[0.2, 0.0], np.array([0.2, 0.0]), (np.float64(0.2), 0)])
def test_a_shift_is_a_pair_of_floats_whatever_it_was_given_as(shift):
    found = BlockPin(pin_shift=shift)
    assert found == BlockPin(pin_shift=(0.2, 0.0)) and hash(found) is not None
    assert type(found.pin_shift) is tuple and {type(x) for x in found.pin_shift} == {float}


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: BlockPin(pin="cone"), "pin: expected 'bar' or 'round', found 'cone'"),
        (lambda: BlockPin(pin_shift=(5.0, 0.0)), "pin_shift: expected a pin axis over the block"),
        (lambda: BlockPin(pin_rotation=np.nan), "pin_rotation: expected a finite angle"),
        (lambda: model("third"), "symmetry: expected 'auto', 'quarter', 'half' or 'full'"),
        (
            lambda: model("quarter", pin_shift=(0.4, 0.0)),
            "symmetry: expected 'half' or more .* shifted by .0.4, 0.0. mm",
        ),
        (
            lambda: model("half", ("slide", "slide")),
            "contact: expected a pin or base that sticks or has friction in a half model",
        ),
        (
            lambda: model(contact=(0.0, "slide"), pin_rotation=5.0),
            "contact: expected a pin or base that sticks or has friction in a full model",
        ),
    ],
)
def test_impossible_input_is_refused_by_name(make, words):
    with pytest.raises(ValueError, match=words):
        make()


@pytest.mark.lasting
@pytest.mark.parametrize("contact", [(0.3, "stick"), (0.3, 0.2), ("slide", 0.02)])
def test_friction_under_a_shifted_bar_is_that_under_one_shifted_the_other_way(contact):
    """Also where nothing but friction holds the block against the push of the fillets."""
    right, left = (model(contact=contact, pin_shift=(s, 0.0))(RATIOS) for s in (0.5, -0.5))
    assert right.status is Status.CONVERGED
    np.testing.assert_allclose(left.force, right.force, rtol=1e-7)
    flip = left.displacement.reshape(2, 8, 2, 3)[:, ::-1].reshape(2, 16, 3) * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose(flip, right.displacement, atol=1e-7)
