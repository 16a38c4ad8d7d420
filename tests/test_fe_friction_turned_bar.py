"""Friction under a bar turned about its vertical axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from friction_derivatives import (
    LAW,
    STATES,
    TRAVEL,
    Patch,
    assert_frozen_potential_has_the_true_forces,
    assert_pull_of_anchors_and_coefficients_is_the_derivative_of_the_forces,
    assert_tangent_with_coupling_is_the_derivative_of_the_forces,
)

from fe import BlockPin, BlockPinModel, Contact, Status
from fe.contact_memory import initial_memory, slide_anchors
from fe.newton import NewtonOptions
from fe.pin_surface import RigidPin, pin_point
from fe.steps import StepOptions
from fe.surface_slopes import no_slopes
from fe.touch import chart_pin, empty_chart

ANGLE = np.radians(25.0)
STRAIGHT = RigidPin(2.5, 2.0, 0.3, 500.0, 0.1, base_stiffness=2e4)
TURNED = STRAIGHT._replace(x=0.2, z=-0.3, across_x=np.cos(ANGLE), across_z=-np.sin(ANGLE))
RATIOS = np.array([0.4, 0.1])
# columns are the axes of the bar, across and along it, in those of the block
TURN = np.array([[np.cos(ANGLE), 0, np.sin(ANGLE)], [0, 1, 0], [-np.sin(ANGLE), 0, np.cos(ANGLE)]])


def patch(slipped: float) -> Patch:
    """Faces, displacements that touch pin and floor, and anchors a random way `slipped` behind."""
    model = BlockPinModel(BlockPin(), Contact("stick", 0.7), (3, 1, 2), (0.1,), symmetry="full")
    faces = model.discretise().faces
    rng = np.random.default_rng(0)
    u = 0.1 * rng.standard_normal((faces.nodes.max() + 1, 3))
    u[:, 1] -= 0.15
    still = no_slopes(faces, 4)
    memory = initial_memory(faces, np.zeros(faces.weights.shape, bool), TURNED, still)
    slide_anchors(memory, faces, u, np.zeros((*u.shape, 4)), TRAVEL, TURNED, LAW, still)
    memory.slip.place[...] += slipped * rng.standard_normal(memory.slip.place.shape)
    memory.slip.gradient[...] = rng.standard_normal(memory.slip.gradient.shape)
    return Patch(faces, u, memory, TURNED)


def chart_at(x, pin=TURNED):
    chart = empty_chart()
    return chart_pin(np.array(x), TRAVEL, pin, chart), chart


@pytest.mark.parametrize("x", [(0.7, 2.05, 0.4), (1.9, 2.15, -0.6), (-1.5, 2.2, 1.2)])
def test_the_chart_is_that_of_a_straight_bar_in_the_axes_of_the_turned_one(x):
    gap, chart = chart_at(np.array([0.2, 0.0, -0.3]) + TURN @ x)
    other, straight = chart_at(x, STRAIGHT)
    assert gap == pytest.approx(other, abs=1e-14)
    np.testing.assert_allclose(chart.place, straight.place, atol=1e-14)
    np.testing.assert_allclose(chart.normal, TURN @ straight.normal, atol=1e-14)
    np.testing.assert_allclose(chart.tangent, straight.tangent @ TURN.T, atol=1e-14)
    np.testing.assert_allclose(chart.slope, straight.slope @ TURN.T, atol=1e-14)
    bend = np.einsum("ij,ajl,kl->aik", TURN, straight.bend, TURN)
    np.testing.assert_allclose(chart.bend, bend, atol=1e-13)


@pytest.mark.parametrize("x", [(0.7, 2.05, 0.4), (1.95, 2.2, -0.9), (-1.5, 2.2, -2.2)])
def test_the_chart_has_its_own_derivatives(x):
    gap, chart = chart_at(x)
    s = pin_point(np.array(x), TRAVEL, TURNED)
    assert gap == s.gap
    np.testing.assert_allclose(chart.normal, [s.nx, s.ny, s.nz], atol=1e-14)
    h = 1e-6
    for k, step in enumerate(np.eye(3) * h):
        plus, minus = chart_at(x + step)[1], chart_at(x - step)[1]
        slope, bend = (plus.place - minus.place) / (2 * h), (plus.tangent - minus.tangent) / (2 * h)
        np.testing.assert_allclose(chart.slope[:, k], slope, atol=1e-8)
        np.testing.assert_allclose(chart.bend[:, :, k], bend, atol=1e-7)


@STATES
def test_tangent_with_coupling_is_the_derivative_of_the_forces(slipped):
    assert_tangent_with_coupling_is_the_derivative_of_the_forces(patch(slipped))


@STATES
def test_frozen_potential_has_the_true_forces(slipped):
    assert_frozen_potential_has_the_true_forces(patch(slipped))


@STATES
def test_pull_of_anchors_and_coefficients_is_the_derivative_of_the_forces(slipped):
    assert_pull_of_anchors_and_coefficients_is_the_derivative_of_the_forces(patch(slipped))


def model(angle: float, pin: float = 0.3, base="stick", **changes) -> BlockPinModel:
    m = BlockPinModel(
        BlockPin(pin_rotation=angle),
        Contact(pin, base),
        (3, 1, 2),
        (0.1, 0.2),
        field_grid=(4, 2),
        newton=NewtonOptions(tolerance=1e-9),
        steps=StepOptions(0.05, 0.05),
        symmetry="full",
    )
    return replace(m, **changes)


def flipped(field: np.ndarray) -> np.ndarray:
    """Field (n_step, 16, 3) of 8 x 2 points across the front face, seen in the plane x = 0."""
    return field.reshape(2, 8, 2, 3)[:, ::-1].reshape(2, 16, 3) * [-1.0, 1.0, 1.0]


@pytest.mark.lasting
def test_a_bar_turned_either_way_gives_the_mirrored_field():
    one, other = model(6.0)(RATIOS), model(-6.0)(RATIOS)
    assert one.status is Status.CONVERGED
    np.testing.assert_allclose(other.force, one.force, rtol=1e-7)
    np.testing.assert_allclose(flipped(other.displacement), one.displacement, atol=1e-7)
    straight = model(0.0)(RATIOS)
    assert np.abs(one.displacement - straight.displacement).max() > 1e-3


def test_a_bar_that_is_hardly_turned_is_a_straight_one():
    """Of a straight bar a quarter is modelled."""
    quarter = model(0.0, symmetry="quarter")(RATIOS)
    turned = model(1e-4)(RATIOS)
    np.testing.assert_allclose(turned.force, quarter.force, rtol=1e-5)
    right = turned.displacement.reshape(2, 8, 2, 3)[:, 4:].reshape(2, 8, 3)
    np.testing.assert_allclose(right, quarter.displacement, atol=2e-5)


@pytest.mark.lasting
def test_friction_under_a_turned_bar_lies_between_sliding_and_sticking():
    force = [model(6.0, c)(RATIOS).force[-1] for c in ("slide", 0.1, 0.4, "stick")]
    assert (np.diff(force) > 0.0).all()


@pytest.mark.lasting
def test_sensitivities_match_central_differences():
    m, h = model(6.0, cells=(2, 1, 1)), 1e-4
    base = m(RATIOS)
    for j, step in enumerate(np.eye(2) * h):
        plus, minus = m(RATIOS + step), m(RATIOS - step)
        force = (plus.force - minus.force) / (2 * h)
        np.testing.assert_allclose(base.force_gradient[:, j], force, rtol=1e-4)
        field = (plus.displacement - minus.displacement) / (2 * h)
        np.testing.assert_allclose(
            base.displacement_gradient[..., j], field, atol=1e-4 * np.abs(field).max()
        )
