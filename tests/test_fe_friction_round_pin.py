"""Friction on a round pin: tangents, derivatives, tractions, energy, between slide and stick."""

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
from fe.pin_surface import ROUND, RigidPin, pin_point
from fe.surface_slopes import no_slopes
from fe.touch import chart_pin, empty_chart

RIGID = RigidPin(2.5, 2.0, 0.3, 500.0, 0.1, base_stiffness=2e4, shape=ROUND, x=0.2, z=-0.3)
RATIOS = np.array([0.4, 0.1])
ON_PIN = [(0.7, 2.05, 0.4), (1.9, 2.1, -0.6), (-1.0, 2.2, 1.2), (0.4, 2.8, 1.69)]


def model(pin, base="stick", **changes) -> BlockPinModel:
    m = BlockPinModel(
        BlockPin(pin="round"),
        Contact(pin, base),
        (3, 2, 3),
        (0.2, 0.4),
        field_grid=(3, 2),
        newton=NewtonOptions(tolerance=1e-9),
    )
    return replace(m, **changes)


def patch(slipped: float) -> Patch:
    """Faces, displacements that touch pin and floor, and anchors a random way `slipped` behind."""
    specimen = BlockPin(pin="round", pin_shift=(0.2, -0.3))
    rubs = Contact("stick", 0.7)  # for the faces of the base; the law is LAW
    faces = model(0.3, specimen=specimen, contact=rubs, cells=(2, 1, 2)).discretise().faces
    rng = np.random.default_rng(0)
    u = 0.1 * rng.standard_normal((faces.nodes.max() + 1, 3))
    u[:, 1] -= 0.15
    none = no_slopes(faces, 4)
    memory = initial_memory(faces, np.zeros(faces.weights.shape, bool), RIGID, none)
    slide_anchors(memory, faces, u, np.zeros((*u.shape, 4)), TRAVEL, RIGID, LAW)
    memory.slip.place[...] += slipped * rng.standard_normal(memory.slip.place.shape)
    memory.slip.gradient[...] = rng.standard_normal(memory.slip.gradient.shape)
    return Patch(faces, u, memory, RIGID)


def chart_at(x):
    chart = empty_chart()
    gap = chart_pin(np.array(x), TRAVEL, RIGID, chart)
    return gap, chart


@pytest.mark.parametrize("x", ON_PIN)
def test_the_chart_has_tangents_of_the_surface_and_its_own_derivatives(x):
    gap, chart = chart_at(x)
    s = pin_point(np.array(x), TRAVEL, RIGID)
    assert gap == s.gap
    np.testing.assert_allclose(chart.normal, [s.nx, s.ny, s.nz], atol=1e-14)
    frame = np.vstack([chart.tangent, chart.normal])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-13)
    h = 1e-6
    for k, step in enumerate(np.eye(3) * h):
        plus, minus = chart_at(x + step)[1], chart_at(x - step)[1]
        slope, bend = (plus.place - minus.place) / (2 * h), (plus.tangent - minus.tangent) / (2 * h)
        np.testing.assert_allclose(chart.slope[:, k], slope, atol=1e-8)
        np.testing.assert_allclose(chart.bend[:, :, k], bend, atol=1e-7)


def test_under_the_flat_a_place_is_x_and_z_from_the_axis():
    _, chart = chart_at((0.7, 2.05, 0.4))
    np.testing.assert_allclose(chart.place, [0.5, 0.7], atol=1e-14)
    np.testing.assert_allclose(chart.tangent, [[1, 0, 0], [0, 0, 1]], atol=1e-14)


@STATES
def test_tangent_with_coupling_is_the_derivative_of_the_forces(slipped):
    assert_tangent_with_coupling_is_the_derivative_of_the_forces(patch(slipped))


@STATES
def test_frozen_potential_has_the_true_forces(slipped):
    assert_frozen_potential_has_the_true_forces(patch(slipped))


@STATES
def test_pull_of_anchors_and_coefficients_is_the_derivative_of_the_forces(slipped):
    assert_pull_of_anchors_and_coefficients_is_the_derivative_of_the_forces(patch(slipped))


@pytest.mark.lasting
def test_force_grows_with_friction_from_sliding_towards_sticking():
    runs = [model(c, travel=(0.2,))(RATIOS) for c in ("slide", 0.1, 0.4, "stick")]
    assert all(r.status is Status.CONVERGED for r in runs)
    assert np.all(np.diff([r.force for r in runs], axis=0) > 0.0)


@pytest.mark.lasting
def test_the_work_of_the_pin_is_stored_or_rubbed_away():
    m = model(0.3, travel=tuple(np.linspace(0.02, 0.4, 20)))
    states, _, _ = m.solve(RATIOS)
    force = np.array([0.0, *(s.pin_force for s in states)])
    work = np.trapezoid(force, np.array([0.0, *m.travel]))
    last = states[-1]
    assert last.friction_work > 0.01 * work
    assert work == pytest.approx(last.energy + last.friction_work, rel=5e-3)


def test_x_and_z_are_alike():
    m = model(0.3)
    u = m.solve(RATIOS)[0][-1].u
    at = m.discretise().elements.positions
    order = np.lexsort(np.round(at, 9).T)
    swapped = np.lexsort(np.round(at[:, [2, 1, 0]], 9).T)
    np.testing.assert_allclose(u[swapped][:, [2, 1, 0]], u[order], atol=1e-7)


@pytest.mark.lasting
def test_sensitivities_match_central_differences():
    """Along one direction in r and s."""
    m, h, along = model(0.3), 1e-4, np.array([0.8, -0.6])
    plus, minus = m(RATIOS + h * along), m(RATIOS - h * along)
    force = (plus.force - minus.force) / (2 * h)
    np.testing.assert_allclose(m(RATIOS).force_gradient @ along, force, rtol=1e-4)
