"""Simulation-based calibration in small: 40 experiments of an analytic block, forces and field.

The false-alarm rates stated are those for seeds not chosen; seeds are fixed, so that a pass stays
one.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from analytic_models import AnalyticBlock, AnalyticForward

from benchmarks import direct_rule
from benchmarks.calibration_experiments import (
    Certain,
    Experiments,
    Placed,
    by_emulator,
    place,
    sbc_prior,
)
from benchmarks.calibration_misspecified import COARSE, SHARES, _worth
from benchmarks.direct_rule import Rule, box_about, log_likelihood, nodes_of, rough_error
from benchmarks.mesh_cases import MESH_CASES
from benchmarks.mesh_statement import fitted
from calib.data import FieldData, thesis_forces
from calib.inference import Likelihood, NoiseSettings, build_likelihood, theta_of
from calib.inference.rank_uniformity import coverage, uniformity
from calib.study.block_cells import refinement
from calib.study.mesh_error import MeshError, left_share
from fe.response import Array

N, MANY = 40, 1500
PRIOR = sbc_prior()
BLOCK_POINTS = [[0.5, 1.5, 2.5, 3.5], [0.4, 1.0, 1.6]]
POINTS = np.stack(np.meshgrid(*BLOCK_POINTS), axis=-1).reshape(-1, 2)
BLOCK = AnalyticBlock(points=POINTS)


def likelihood() -> Likelihood:
    """Whose emulator errs, and more than the noise."""
    return _likelihood(AnalyticForward(BLOCK, 0.02, field=True), 0.005, 1.0, 0.5, 0.9)


def noisy(*, independent: bool) -> Likelihood:
    """Whose emulator does not err: noise alone, correlated over most of the points."""
    assumed = (1e-3, 0.0, 0.0) if independent else (3.0, 0.9, 0.9)
    return _likelihood(AnalyticForward(BLOCK, field=True), 0.01, *assumed)


def _likelihood(
    forward: AnalyticForward, noise: float, length: float, share: float, rho: float
) -> Likelihood:
    shape = (5, len(POINTS), 3)
    field = FieldData(POINTS, np.zeros(shape), noise * np.array([1.0, 1.0, 2.0]), length, share)
    return build_likelihood(
        replace(thesis_forces(), field=field),
        forward,
        NoiseSettings(sample_correlation=rho),
        force_discretisation=0.02,
        field_floor=0.1 * noise,
    )


@cache
def experiments() -> Experiments:
    return by_emulator(likelihood(), PRIOR, N, 3)


@cache
def placed() -> Placed:
    return place(likelihood(), PRIOR, experiments(), 5)


def test_ranks_of_forty_experiments_are_uniform() -> None:
    """Three chi-squares of 8 bins and three ECDF bands, each at 1e-3: false alarm below 6e-3."""
    for column in placed().below.T:
        found = uniformity(column, n_bin=8, false_alarm=1e-3)
        assert found.chi_square_p > 1e-3
        assert found.inside_band


def test_intervals_of_forty_experiments_cover() -> None:
    """Nine proportions within 3.5 of their standard errors: false alarm below 5e-3."""
    for level, found in zip((0.5, 0.8, 0.95), coverage(placed().below), strict=True):
        error = np.sqrt(level * (1.0 - level) / N)
        assert np.all(np.abs(found - level) < 3.5 * error), (level, found)


@pytest.mark.slow  # 1,500 posteriors: a few minutes
def test_of_many_experiments_intervals_cover_within_three_points() -> None:
    """Nine proportions within 3 points, 2.3 standard errors at 50 %: false alarm 8 %."""
    found = place(likelihood(), PRIOR, by_emulator(likelihood(), PRIOR, MANY, 7), 8)
    for level, covered in zip((0.5, 0.8, 0.95), coverage(found.below), strict=True):
        assert np.all(np.abs(covered - level) < 0.03), (level, covered)
    for column in found.below.T:
        assert uniformity(column, false_alarm=1e-3).chi_square_p > 1e-3


def test_posteriors_have_enough_effective_draws() -> None:
    assert placed().ess.min() > 400


def test_noise_taken_as_independent_is_noticed() -> None:
    drawn = by_emulator(noisy(independent=False), PRIOR, N, 4)
    below = place(noisy(independent=True), PRIOR, drawn, 5).below
    assert least_p(below) < 1e-3


def test_emulator_error_left_out_is_noticed() -> None:
    """Of a tenth and more of the force, so that 40 experiments tell whatever their errors are."""
    stated = _likelihood(AnalyticForward(BLOCK, 0.1, field=True), 0.005, 1.0, 0.5, 0.9)
    drawn = by_emulator(stated, PRIOR, N, 3)
    below = place(build_certain(stated), PRIOR, drawn, 5).below
    assert least_p(below) < 1e-3


def least_p(below: Array) -> float:
    return min(uniformity(column, n_bin=8).chi_square_p for column in below.T)


def build_certain(stated: Likelihood) -> Likelihood:
    forward = Certain(stated.forward)
    assert stated.field is not None
    return replace(stated, forward=forward, field=stated.field.with_basis(forward.field_basis))


def test_fields_projected_together_are_those_projected_one_by_one() -> None:
    own = likelihood()
    assert own.field is not None
    some = experiments().field[:3]
    together = own.field.of_fields(some)
    for field, found in zip(some, together, strict=True):
        alone = replace(own.field, observed=field).projected
        assert found.projected.best == pytest.approx(alone.best, rel=1e-8, abs=1e-10)
        assert found.projected.constant == pytest.approx(alone.constant, rel=1e-10)
        assert found.projected.shared_pull == pytest.approx(alone.shared_pull, rel=1e-8, abs=1e-8)


def test_the_density_along_kappa_is_that_of_the_likelihood() -> None:
    """The field is seen once for all kappa, the forces for each."""
    own = likelihood()
    assert own.field is not None
    some = experiments()
    one = replace(own, force=some.force[0], field=own.field.of_fields(some.field[:1])[0])
    x = np.repeat(some.x[:1], 5, axis=0)
    x[:, 0] += np.linspace(-0.05, 0.05, len(x))
    assert log_likelihood(one, x) == pytest.approx(one.log_prob(theta_of(x)), rel=1e-9)


def test_shares_that_count_are_looked_at_closely() -> None:
    """All between the neighbours of every coarse share that is good, and no others."""
    look = np.arange(len(SHARES))[::COARSE]
    value = np.where(look == 3 * COARSE, 0.0, -50.0)
    expected = np.arange(2 * COARSE + 1, 4 * COARSE)
    assert np.array_equal(_worth(value, look, len(SHARES)), expected)


def test_a_truth_off_along_a_constant_is_fitted_as_that_constant() -> None:
    own, ratios = likelihood(), np.array([0.4, 0.2])
    theta, basis = np.array([[1.0, *ratios]]), own.forward.field_basis
    stated, slope = own.forward.predict(theta), own.forward.jacobian(theta)
    assert basis is not None and stated.weights is not None and slope.weights is not None
    moved = np.array([0.02, 0.03, -0.01])
    field = basis.fields(stated.weights + slope.weights[0] @ moved)[0]
    found = fitted(own, ratios, stated.force[0] + slope.force[0] @ moved, field)
    # The prior holds the zero of the travel, so that nothing is left to it.
    assert found.off == pytest.approx([*moved, 0.0], rel=1e-8, abs=1e-10)
    assert np.all(found.sd > 0.0) and found.sd[3] < own.errors.travel_zero_sd


def test_the_part_that_finer_truths_show_is_stated_as_that_part_of_what_is_left() -> None:
    nothing = np.zeros((1, 5))
    error = MeshError(1.7, np.zeros((1, 2)), nothing, np.zeros((1, 5, 12, 3)))
    for case in MESH_CASES.values():
        h_check, h_truth = case.refinement, refinement(case.truth_cells, case.cells)
        order = 1.0 if case.hypothesis == "stuck" else 2.0
        # from the check mesh to the truth's over that to the block
        shown = [(h_check**-p - h_truth**-p) / h_check**-p for p in (2.0, order)]
        assert case.truth_share == pytest.approx(shown, rel=1e-12)
        left = replace(error, field_order=order, shown=case.truth_share).left
        whole = left_share(error.refinement), left_share(error.refinement, order)
        assert left == pytest.approx(np.multiply(shown, whole), rel=1e-12)


def test_the_error_of_a_rule_over_a_rough_density_is_that_of_repeats() -> None:
    unit, weight = np.polynomial.legendre.leggauss(9)
    place = np.stack(np.meshgrid(4.0 * unit, 4.0 * unit, indexing="ij"), axis=-1).reshape(-1, 2)
    smooth = -0.5 * np.sum(place**2, axis=1) + 0.03 * place[:, 0] ** 3
    rng, means, errors = np.random.default_rng(3), [], []
    for _ in range(400):
        value = smooth + 0.1 * rng.standard_normal(len(place))
        share = np.exp(value) * np.outer(weight, weight).ravel()
        share /= share.sum()
        means.append(share @ place)
        errors.append(rough_error(value, share, place - means[-1], place))
    np.testing.assert_allclose(
        np.sqrt(np.mean(np.square(errors), axis=0)), np.std(means, axis=0), rtol=0.15
    )


def test_a_rule_tells_its_error_where_the_prior_cuts_off_nodes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A normal density of r and s, cut off at r = 0.5, of which half of the nodes know nothing."""
    mean, sd = np.array([0.5, 0.25]), np.array([0.05, 0.02])

    def density(_: Likelihood, x: Array) -> Array:
        found: Array = -0.5 * np.sum(((x[:, 1:] - mean) / sd) ** 2, axis=1) - 0.5 * x[:, 0] ** 2
        return found

    def prior(x: Array) -> Array:
        return np.where(x[:, 1] < mean[0], 0.0, -np.inf)

    monkeypatch.setattr(direct_rule, "log_likelihood", density)
    nodes, weights = nodes_of(box_about(mean, sd, np.array([[0.0, 1.0], [0.0, 1.0]])), 20)
    unknown: Any = None
    posterior: Any = SimpleNamespace(prior=SimpleNamespace(log_prob=prior), likelihood=unknown)
    found = Rule(nodes, weights, np.linspace(-8.0, 8.0, 61), unknown).moments(posterior)
    # No node is at the cut, so the rule is worth a share of a node's weight there.
    assert found.mean[1] == pytest.approx(mean[0] - sd[0] * np.sqrt(2.0 / np.pi), abs=0.05 * sd[0])
    assert found.mean[2] == pytest.approx(mean[1], abs=1e-6)
    assert (found.error < 1e-6 * found.sd).all()
