"""Benchmark of emulators: designs, models and the refinement problem are what they claim to be."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.emulator_peers import pca_gp
from benchmarks.emulator_refinement import PROBLEMS
from benchmarks.emulator_roughness import S, _left
from benchmarks.emulator_runs import DESIGNS, FACTORS, Design, family


@pytest.mark.parametrize("design", DESIGNS)
def test_held_out_points_are_inside_and_never_in_training(design: Design) -> None:
    training, held_out = design.training(), design.held_out(16)
    assert training.shape == (design.n_runs, len(design.names))
    inside = design.coordinates(held_out)
    assert ((inside > design.bounds[:, 0]) & (inside < design.bounds[:, 1])).all()
    assert not any((training == point).all(axis=1).any() for point in held_out)


def test_each_factor_reaches_the_model() -> None:
    model = family(tuple(FACTORS), "friction", (4, 2, 1)).model(
        np.array([0.3, 0.1, 150.0, 0.4, 2.6, 0.2])
    )
    assert model.bulk_ratio == 150.0 and model.contact.pin == 0.4 and model.contact.base == 0.4
    assert model.specimen.height == 2.6 and model.specimen.pin_fillet == 0.2


def test_derivatives_by_coordinates_are_limits_of_differences() -> None:
    """Of f = bulk r: by ln bulk it is bulk r."""
    design = DESIGNS[1]
    factors = np.array([[0.3, 0.1, 50.0], [0.7, 0.2, 400.0]])
    gradient = np.stack([factors[:, 2], np.zeros(2), factors[:, 0]], axis=1)[:, None]
    at = design.coordinates(factors)
    found = design.by_coordinates(gradient, factors)
    for axis, step in enumerate(1e-6 * np.eye(3)):
        high, low = design.factors(at + step), design.factors(at - step)
        difference = (high[:, 2] * high[:, 0] - low[:, 2] * low[:, 0]) / 2e-6
        np.testing.assert_allclose(found[:, 0, axis], difference, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("contact", ["stick", "slide"])
def test_without_friction_the_contact_is_the_one_asked_for(contact: str) -> None:
    model = family(("r", "s"), contact, (4, 2, 1)).model(np.array([0.3, 0.1]))
    assert model.contact.pin == model.contact.base == contact


def test_derivatives_of_the_refinement_problem_are_limits_of_differences() -> None:
    x, problem = np.random.default_rng(0).random((5, 2)), PROBLEMS[0]
    for axis, step in enumerate(1e-6 * np.eye(2)):
        difference = (problem.model(x + step)[0] - problem.model(x - step)[0]) / 2e-6
        found = problem.model(x)[1][:, :, axis]
        np.testing.assert_allclose(found, difference, rtol=1e-6, atol=1e-6)


def test_the_peer_of_scikit_learn_meets_a_smooth_function() -> None:
    rng = np.random.default_rng(0)
    x, new, place = rng.random((20, 2)), rng.random((10, 2)), np.linspace(0.0, 3.0, 30)

    def truth(points: np.ndarray) -> np.ndarray:
        found: np.ndarray = np.sin(place + points[:, :1] + 0.5 * points[:, 1:])
        return found

    assert np.abs(pca_gp(x, truth(x), new) - truth(new)).max() < 0.01


def test_roughness_is_what_a_parabola_leaves() -> None:
    """SD 0.01 of noise from 9 runs and 4000 values; its relative standard error is below 0.01."""
    curved = 1.0 + 3.0 * S[:, None, None] - 2.0 * S[:, None, None] ** 2 + np.zeros((9, 2, 4000))
    assert _left(curved).max() < 1e-12
    noisy = curved + 0.01 * np.random.default_rng(0).normal(size=curved.shape)
    np.testing.assert_allclose(_left(noisy), 0.01, rtol=0.04)
