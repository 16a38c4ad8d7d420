"""Checks of predictions are uniform for what was drawn alike, and see what was not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_models import AnalyticBlock, AnalyticForward

from calib.inference.likelihood import build_likelihood
from calib.inference.noise import NoiseSettings
from calib.inference.prediction import predictive_fields
from calib.inference.predictive_checks import (
    check_field,
    check_forces,
    correlation,
    determination,
    face_regions,
    misfit_p_value,
    rms_error,
    tail_probability,
    within,
)
from calib.virtual import VirtualNoise, virtual_experiment


def test_p_values_and_coverage_of_replicates_are_those_of_a_uniform() -> None:
    rng = np.random.default_rng(1)
    draws = rng.standard_normal((2000, 400))
    observed = rng.standard_normal(400)
    p = tail_probability(observed, draws)
    assert abs(p.mean() - 0.5) < 3 * np.sqrt(1 / 12 / 400)
    for probability in (0.5, 0.94):
        share = within(observed, draws, probability).mean()
        assert abs(share - probability) < 3 * np.sqrt(probability * (1 - probability) / 400)


def test_the_misfit_p_value_sees_errors_stated_too_small_and_too_large() -> None:
    rng = np.random.default_rng(2)
    model = np.zeros((500, 60))
    observed = rng.standard_normal(60)
    fair, small, large = (
        misfit_p_value(observed, sd * rng.standard_normal((500, 60)), model)
        for sd in (1.0, 0.7, 1.5)
    )
    assert 0.02 < fair < 0.98 and small < 0.02 and large > 0.98


def test_correlation_does_not_see_a_scale_and_determination_does() -> None:
    steps = np.linspace(0.6, 1.4, 5)[:, None] ** 2 * np.array([1.0, -2.0])
    assert correlation(steps, 0.25 * steps) == pytest.approx(np.ones(2))
    assert correlation(steps, -steps) == pytest.approx(-np.ones(2))
    assert np.isnan(correlation(steps, np.ones_like(steps))).all()
    assert determination(steps, steps) == 1.0
    assert determination(steps, 0.25 * steps) < 0.6
    assert rms_error(steps, steps + 0.1) == pytest.approx([0.1, 0.1])


def test_correlation_is_that_of_numpy() -> None:
    rng = np.random.default_rng(3)
    a, b = rng.standard_normal((2, 6, 9))
    expected = [np.corrcoef(a[:, i], b[:, i])[0, 1] for i in range(9)]
    assert correlation(a, b) == pytest.approx(expected)


def test_regions_are_below_the_pin_beside_it_and_at_the_edge() -> None:
    points = np.column_stack([[-1.9, 0.0, 2.1, 3.9, -4.1, 4.9], np.ones(6)])
    found = face_regions(points, 10.0, 4.0)
    assert [list(np.flatnonzero(found[name])) for name in ("near pin", "middle", "edge")] == [
        [0, 1],
        [2, 3],
        [4, 5],
    ]
    assert set(face_regions(points[:2], 10.0, 4.0)) == {"near pin"}
    # Of a pin 1 mm to the right: its own place is moved, the sample's edges are not.
    shifted = face_regions(points + np.array([1.0, 0.0]), 10.0, 4.0, pin_shift=1.0)
    assert list(np.flatnonzero(shifted["near pin"])) == [0, 1]
    sides = np.column_stack([[4.3, 4.4, -3.6, -3.7], np.ones(4)])
    assert list(np.flatnonzero(face_regions(sides, 10.0, 4.0, 1.0)["edge"])) == [1, 3]


def _case(seed: int):
    grid = np.meshgrid(np.linspace(0.3, 4.7, 6), np.linspace(0.2, 2.3, 4))
    points = np.stack([axis.ravel() for axis in grid], axis=1)
    block, truth = AnalyticBlock(points=points), np.array([0.012, 0.3, 0.2])
    noise = VirtualNoise(load_cell_sd=0.01, travel_zero_sd=0.01)
    rng = np.random.default_rng(seed)
    data = virtual_experiment(block, truth, noise, rng, points=points)
    settings = NoiseSettings(load_cell_sd=0.01, travel_zero_sd=0.01)
    forward = AnalyticForward(block, field=True)
    likelihood = build_likelihood(data, forward, settings)
    x = np.tile([np.log(0.012), 0.3, 0.2], (300, 1))
    return data, likelihood, predictive_fields(likelihood, x, rng), face_regions(points, 10.0, 4.0)


def test_field_replicates_of_the_truth_have_the_covariance_of_the_likelihood() -> None:
    data, likelihood, _, _ = _case(4)
    x = np.tile([np.log(0.012), 0.3, 0.2], (4000, 1))
    drawn = predictive_fields(likelihood, x, np.random.default_rng(5))
    spread = (drawn.replicate - drawn.model).std(axis=0)
    noise = data.field.noise_std
    zero = np.einsum("ij,jpc->ipc", likelihood.field.shifts[0], drawn.model[0])
    truncation = np.square(likelihood.forward.field_basis.truncation).sum(axis=0)
    assert spread == pytest.approx(np.sqrt(noise**2 + zero**2 + truncation), rel=0.06)


def test_a_right_model_passes_in_every_region_and_a_wrong_field_fails_where_it_is_wrong() -> None:
    data, _, fields, regions = _case(6)
    observed = data.field.displacement
    right = check_field(observed, fields.replicate, fields.model, regions)
    worst = min(c.p_value for steps in right.values() for step in steps for c in step)
    assert worst > 0.5 / (3 * 5 * 3 * 10)  # the smallest of 45 that are uniform or conservative
    moved = observed.copy()
    moved[2, regions["edge"], 1] += 0.05
    wrong = check_field(moved, fields.replicate, fields.model, regions)
    assert wrong["edge"][2][1].p_value < 0.01 and wrong["edge"][2][1].coverage[0.94] < 0.5
    assert wrong["middle"][2][1] == right["middle"][2][1]
    assert wrong["edge"][2][1].rmse > 0.04


def test_forces_are_checked_one_by_one() -> None:
    rng = np.random.default_rng(7)
    draws = np.array([1.0, 2.0]) + 0.1 * rng.standard_normal((4000, 2))
    good, bad = check_forces(np.array([1.02, 2.5]), draws)
    assert good.p_value > 0.5 and good.coverage[0.94] == 1.0
    assert (
        bad.p_value < 0.001
        and bad.coverage[0.94] == 0.0
        and bad.relative == pytest.approx(-0.2, abs=0.01)
    )


def test_fields_are_not_predicted_without_a_measured_one() -> None:
    _, likelihood, _, _ = _case(8)
    bare = replace(likelihood, field=None)
    with pytest.raises(ValueError, match="holds no field"):
        predictive_fields(bare, np.zeros((1, 3)), np.random.default_rng(0))


def test_a_factor_of_a_discrepancy_does_not_count_as_misfit() -> None:
    """Its mean is exp(SD^2 / 2), 25 % above the model that is exact here; 4000 draws, 4 SDs."""
    observed = np.array([0.1, 0.4, 1.2])
    factor = np.exp(0.67 * np.random.default_rng(5).standard_normal((4000, 3)))
    allowed = 4.0 * 0.67 * np.sqrt(0.5 * np.pi / 4000)
    checks = check_forces(observed, observed * factor)
    assert all(abs(found.relative) < allowed for found in checks)
