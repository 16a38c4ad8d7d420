"""Geometry, energy, derivatives and memory of the contact with pin and floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fe.contact import (
    FREE,
    TIED_TO_FLOOR,
    TIED_TO_PIN,
    PenaltyLaw,
    contact_system,
    empty_system,
    penalty,
)
from fe.contact_memory import initial_memory
from fe.pin_surface import RigidPin, bar_distance
from fe.specimens.block_pin import BlockPin, BlockPinModel, Contact

PIN = RigidPin(height=2.5, half_width=2.0, fillet=0.3, stiffness=500.0, ramp=0.1)


def patch(base="slide"):
    """A block of rough displacement; with friction its base stands on springs."""
    model = BlockPinModel(BlockPin(), Contact(base, base), (4, 2, 2), (0.5,))
    discrete = model.discretise()
    rng = np.random.default_rng(5)
    u = 0.15 * rng.standard_normal(discrete.elements.positions.shape)
    u[:, 1] -= 0.1
    return discrete, u


def evaluate(discrete, u, memory, travel, pin=PIN):
    system = empty_system(discrete.faces)
    ties = memory.ties
    tied = ties.kind, ties.hold, ties.anchor
    energy, force = contact_system(u, discrete.faces, *tied, travel, pin, True, system)
    return energy, force, system


def mixed_memory(discrete):
    memory = initial_memory(discrete.faces, np.zeros(discrete.faces.weights.shape, bool), PIN)
    memory.ties.kind[::3, ::2] = TIED_TO_PIN
    memory.ties.kind[1::3, ::3] = TIED_TO_FLOOR
    memory.ties.hold[...] = np.random.default_rng(6).uniform(0.0, 1.0, memory.ties.hold.shape)
    memory.ties.hold[::2] = 1.0
    memory.ties.anchor[...] += 0.05
    return memory


@pytest.mark.parametrize(
    ("x", "y", "distance"),
    [
        (0.5, 1.5, 0.5),  # below the flat bottom at y = 2
        (0.5, 2.2, -0.2),  # inside, above the bottom
        (2.4, 3.0, 0.4),  # beside the wall
        (1.7, 2.3, -0.3),  # centre of the fillet
        (1.7 + 0.5 * np.sqrt(0.5), 2.3 - 0.5 * np.sqrt(0.5), 0.2),  # off the rounded edge
    ],
)
def test_distance_to_the_bar_is_euclidean(x, y, distance):
    assert bar_distance(x, y, 2.0, 0.3, 2.0)[0] == pytest.approx(distance, abs=1e-12)


@pytest.mark.parametrize("point", [(0.4, 1.9), (1.9, 2.05), (1.8, 2.1), (2.05, 2.6)])
def test_normal_and_hessian_are_derivatives_of_the_distance(point):
    h = 1e-6
    x, y = point
    _, nx, ny, hxx, hxy, hyy = bar_distance(x, y, 2.0, 0.3, 2.0)
    up, down = bar_distance(x + h, y, 2.0, 0.3, 2.0), bar_distance(x - h, y, 2.0, 0.3, 2.0)
    left, right = bar_distance(x, y + h, 2.0, 0.3, 2.0), bar_distance(x, y - h, 2.0, 0.3, 2.0)
    gradient = [(up[0] - down[0]) / (2 * h), (left[0] - right[0]) / (2 * h)]
    np.testing.assert_allclose([nx, ny], gradient, atol=1e-8)
    np.testing.assert_allclose([hxx, hxy], [(up[k] - down[k]) / (2 * h) for k in (1, 2)], atol=1e-7)
    np.testing.assert_allclose(hyy, (left[2] - right[2]) / (2 * h), atol=1e-7)


@pytest.mark.parametrize("gap", [0.05, -0.02, -0.09, -0.25])
def test_penalty_derivatives_match_finite_differences(gap):
    h = 1e-6
    energy = [penalty(gap + k * h, 500.0, 0.1)[0] for k in (-1, 1)]
    slope = [penalty(gap + k * h, 500.0, 0.1)[1] for k in (-1, 1)]
    assert penalty(gap, 500.0, 0.1)[1] == pytest.approx((energy[1] - energy[0]) / (2 * h), abs=1e-6)
    assert penalty(gap, 500.0, 0.1)[2] == pytest.approx((slope[1] - slope[0]) / (2 * h), abs=1e-4)


@pytest.mark.parametrize("base", ["slide", 0.3])
def test_contact_force_is_the_gradient_of_its_energy_and_tangent_its_derivative(base):
    discrete, u = patch(base)
    assert discrete.faces.base.any() == (base != "slide")
    memory, pin = mixed_memory(discrete), PIN._replace(base_stiffness=2e4)
    memory.ties.kind[discrete.faces.base] = FREE
    _, _, system = evaluate(discrete, u, memory, 0.4, pin)
    rng = np.random.default_rng(1)
    du = rng.standard_normal(u.shape)
    h = 1e-6
    plus, minus = (evaluate(discrete, u + k * h * du, memory, 0.4, pin) for k in (1, -1))
    along = np.sum(system.force * du[discrete.faces.nodes])
    assert along == pytest.approx((plus[0] - minus[0]) / (2 * h), rel=1e-6)
    change = np.einsum("caikb,cbk->cai", system.tangent, du[discrete.faces.nodes])
    expected = (plus[2].force - minus[2].force) / (2 * h)
    np.testing.assert_allclose(change, expected, atol=2e-5 * np.abs(expected).max())


def test_travel_derivative_of_the_force_matches_finite_differences():
    discrete, u = patch()
    memory = mixed_memory(discrete)
    _, _, system = evaluate(discrete, u, memory, 0.4)
    h = 1e-6
    plus, minus = (evaluate(discrete, u, memory, 0.4 + k * h) for k in (1, -1))
    expected = (plus[2].force - minus[2].force) / (2 * h)
    np.testing.assert_allclose(system.by_travel, expected, atol=2e-5 * np.abs(expected).max())


def test_pin_force_is_the_derivative_of_the_energy_in_the_travel():
    discrete, u = patch()
    memory = mixed_memory(discrete)
    h = 1e-6
    plus, minus = (evaluate(discrete, u, memory, 0.4 + k * h)[0] for k in (1, -1))
    assert evaluate(discrete, u, memory, 0.4)[1] == pytest.approx(
        (plus - minus) / (2 * h), rel=1e-6
    )


def test_glued_points_of_the_base_are_refused():
    model = BlockPinModel(BlockPin(), Contact(0.3, 0.3), (4, 2, 2), (0.5,))
    faces = model.discretise().faces
    assert faces.base.any()
    initial_memory(faces, np.repeat(~faces.base[:, None], faces.weights.shape[1], axis=1), PIN)
    with pytest.raises(ValueError, match="other faces than those of the base"):
        initial_memory(faces, np.ones(faces.weights.shape, bool), PIN)


@pytest.mark.parametrize("depth", [0.01, 0.09, 0.3])
def test_a_stiffened_law_gives_way_that_many_times_less_at_every_pressure(depth):
    law = PenaltyLaw()
    stiff = law.stiffened(4.0)
    pressure = penalty(-depth, law.stiffness, law.ramp)[1]
    assert penalty(-depth / 4.0, stiff.stiffness, stiff.ramp)[1] == pytest.approx(
        pressure, rel=1e-12
    )
    assert law.stiffened(1.0) == law


@pytest.mark.lasting
@pytest.mark.parametrize("interface", ["slide", "stick"])
def test_two_stiffer_pins_foretell_the_same_rigid_one(interface):
    """What a force misses falls as the penetration, so that two laws tell that of a rigid pin."""
    model = BlockPinModel(BlockPin(), Contact(interface, interface), (10, 4, 1), (0.4, 0.8))
    default, *stiff = (
        replace(model, penalty=PenaltyLaw().stiffened(times), sensitivities=())(
            np.array([0.4, 0.1])
        ).force
        for times in (1.0, 4.0, 8.0)
    )
    missed = [
        (force / default - 1.0) * times / (times - 1.0)
        for force, times in zip(stiff, (4.0, 8.0), strict=True)
    ]
    assert np.min(missed) > 0.004
    np.testing.assert_allclose(missed[0], missed[1], rtol=0.1)


@pytest.mark.parametrize("times", [0.0, -1.0, np.nan, np.inf])
def test_a_law_is_not_stiffened_by_what_is_no_number_above_zero(times):
    with pytest.raises(ValueError, match="times: expected a finite number above 0"):
        PenaltyLaw().stiffened(times)
