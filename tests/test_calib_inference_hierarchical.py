"""The hierarchical model against closed forms, dense matrices, and the model of the mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_models import TRAVEL, AnalyticBlock, AnalyticForward
from scipy.linalg import block_diag
from scipy.stats import halfnorm, multivariate_normal, t, truncnorm

from benchmarks.linear_population import (
    Exact,
    condensed,
    dataset,
    exact,
    forces,
    population,
)
from calib.data import Dataset, FieldData
from calib.data.dataset import SampleData
from calib.data.qc.placing_errors import field_slopes
from calib.inference import condensed_field
from calib.inference.condensed import CondensedSamples, condense
from calib.inference.coordinates import theta_of
from calib.inference.field_floor import FieldFloor
from calib.inference.field_noise import field_covariance
from calib.inference.hierarchical import HierarchicalPosterior, Pooled
from calib.inference.hierarchical_sampling import PopulationDraws, sample_population
from calib.inference.likelihood import build_likelihood
from calib.inference.noise import NoiseSettings, slope_matrix
from calib.inference.population import Population, ScatterPrior
from calib.inference.population_moves import Moves
from calib.inference.posterior import Posterior
from calib.inference.prior import Marginal, Prior
from calib.inference.sample_errors import SampleErrors, own_field_patterns
from calib.inference.sampling import SamplerSettings
from fe.response import Array

N = 6
POINTS = np.random.default_rng(5).random((10, 2)) * [5.0, 2.5]
BLOCK = AnalyticBlock(points=POINTS)
X = np.array([np.log(0.012), 0.4, 0.1])
NOISE = NoiseSettings(load_cell_sd=0.01, travel_zero_sd=0.01, gain_sd=0.02, field_scale_sd=0.01)
OWN = SampleErrors(travel_zero_sd=0.008)
PATTERNS = 0.01 * np.random.default_rng(6).standard_normal((2, 5, 10, 3))
FLOOR = FieldFloor(np.full((5, 3), 0.004), np.linspace(0.3, 2.0, len(POINTS)))
ERRORS = {"force_discretisation": 0.03, "field_floor": FLOOR, "field_patterns": PATTERNS}
PRIOR = Prior(
    Marginal("log_uniform", 0.001, 0.1), Marginal("uniform", 0.0, 1.0), Marginal("uniform", 0, 0.5)
)


def samples_of(n: int, rng: np.random.Generator, lost: int = 0, *, by_all: bool = False) -> Dataset:
    """N samples with field; the last lacks `lost` points, or each as many by chance."""
    like = AnalyticForward(BLOCK, field=True)
    x = X + rng.standard_normal((n, 3)) * [0.1, 0.0, 0.0]
    found = like.predict(theta_of(x))
    assert like.field_basis is not None and found.weights is not None
    field = like.field_basis.fields(found.weights)
    field = field + 0.01 * rng.standard_normal(field.shape)
    if lost:
        field[-1, :, :lost] = np.nan
    for sample in field[:-1] if by_all else ():
        sample[:, rng.choice(len(POINTS), lost, replace=False)] = np.nan
    force = found.force + 0.01 * rng.standard_normal(found.force.shape)
    mean = np.nanmean(field, axis=0)
    noise_std = np.array([0.01, 0.01, 0.012]) / np.sqrt(n)
    return Dataset(
        name="analytic",
        synthetic=True,
        travel=TRAVEL,
        force_mean=force.mean(axis=0),
        force_sd=np.maximum(force.std(axis=0, ddof=1), 0.011),
        n_samples=n,
        field=FieldData(POINTS, mean, noise_std, 0.5, 0.3, nugget=0.05),
        samples=SampleData(tuple(f"S{i}" for i in range(n)), force, field),
    )


def estimator(covariance: Array, directions: Array, seen: Array) -> Array:
    """(k, size) generalised least squares of directions (k, size), of the numbers that are seen."""
    weighed = np.linalg.solve(covariance[np.ix_(seen, seen)], directions[:, seen].T)
    found = np.zeros(directions.shape)
    found[:, seen] = np.linalg.solve(directions[:, seen] @ weighed, weighed.T)
    return found


def common_columns(force: Array, field: Array, slope: Array, model_field: Array) -> Array:
    """(5 + size, 5 + size + 3) factor of the errors that all samples share, of one of them."""
    e, size = np.sqrt(0.5) * 0.03 * force, field.size
    columns = np.zeros((5 + size, 5 + size + 3))
    columns[:5, :5] = np.linalg.cholesky(np.outer(e, e) + np.diag(e**2))
    columns[5:, 5:-3] = np.linalg.cholesky(model_field)
    moved = np.concatenate([slope @ force, np.tensordot(slope, field, 1).ravel()])
    columns[:, -3] = NOISE.travel_zero_sd * moved
    columns[:5, -2], columns[5:, -1] = NOISE.gain_sd * force, NOISE.field_scale_sd * field.ravel()
    return columns


def dense_log_prob(data: Dataset, theta: Array, forward: AnalyticForward) -> float:
    """Ln density of forces and of what least squares make of the fields, by dense matrices.

    Every term of the covariance of all samples' whole fields is written out and then condensed, at
    theta (n, 3).
    """
    assert data.field is not None and data.samples is not None
    n, found, basis = data.n_samples, forward.predict(theta), forward.basis
    assert basis is not None and basis.modes is not None and found.weights is not None
    fields, slope = basis.fields(found.weights), slope_matrix(TRAVEL)
    covariance = field_covariance(data.field, floor=FLOOR, patterns=PATTERNS)
    covariance = covariance.with_patterns(basis.truncation)
    own = own_field_patterns(data, data.field, data.samples, NOISE)
    variance = covariance.noise_variance * n
    noise = replace(covariance, noise_variance=variance, floor=0 * covariance.floor, patterns=own)
    model = replace(covariance, noise_variance=np.zeros(3))
    size = fields[0].size
    unit = np.eye(size).reshape(-1, *fields[0].shape)
    own_field, model_field, mean_field = (
        given.applied(unit).reshape(size, size)
        for given in (noise, model, covariance.with_patterns(own / np.sqrt(n)))
    )
    modes = basis.modes.reshape(len(basis.modes), -1)
    off = (data.field.displacement - basis.offset).ravel()
    middle = np.linalg.lstsq(modes.T, off, rcond=None)[0] @ modes
    middle = middle.reshape(fields[0].shape) + basis.offset
    # without an offset a change of scale is a change of weights
    directions = np.vstack([modes, np.tensordot(slope, middle, 1).ravel()])
    k = len(directions)
    residual, blocks, root, condensing = [], [], [], []
    for i in range(n):
        h = estimator(mean_field, directions, np.isfinite(data.samples.displacement[i]).ravel())
        force, field = found.force[i], fields[i].ravel()
        measured = np.nan_to_num(data.samples.displacement[i]).ravel()
        fitted = ((h @ measured)[: len(modes)] @ modes).reshape(fields[0].shape)
        smooth = data.force_mean * data.samples.force[i].sum() / data.force_mean.sum()
        condense_one = np.zeros((5 + k, 5 + size))
        condense_one[:5, :5], condense_one[5:, 5:] = np.eye(5), h
        condensing.append(condense_one)
        both = np.zeros((5 + size, 5 + size))
        both[:5, :5], both[5:, 5:] = NOISE.load_cell_sd**2 * np.eye(5), own_field
        zero = np.concatenate([slope @ smooth, np.tensordot(slope, fitted, 1).ravel()])
        blocks.append(both + OWN.travel_zero_sd**2 * np.outer(zero, zero))
        residual.append(np.concatenate([data.samples.force[i] - force, measured - field]))
        root.append(common_columns(force, fields[i], slope, model_field))
    common = np.concatenate(root)
    matrix = block_diag(*condensing)
    total = matrix @ (block_diag(*blocks) + common @ common.T) @ matrix.T
    off = matrix @ np.concatenate(residual)
    value: float = multivariate_normal(np.zeros(len(off)), total).logpdf(off)
    return value


@pytest.mark.parametrize(
    ("n", "lost", "by_all", "error"),
    [(2, 0, False, 1e-5), (2, 2, False, 1e-3), (6, 1, True, 1e-3), (6, 3, True, 3e-3)],
)
def test_density_is_that_of_dense_matrices(n: int, lost: int, by_all: bool, error: float) -> None:
    """To rounding; where samples lack points, to what is left of common errors."""
    data = samples_of(n, np.random.default_rng(8), lost, by_all=by_all)
    forward = AnalyticForward(BLOCK, field=True)
    samples = condense(data, forward, NOISE, OWN, **ERRORS)
    at = theta_of(X + np.random.default_rng(9).standard_normal((4, n, 3)) * [0.02, 0.02, 0.01])
    posterior = HierarchicalPosterior(Population(PRIOR, {"kappa": ScatterPrior(0.3)}), samples)
    found = posterior.common_errors(samples.white(at)).log_prob
    dense = np.array([dense_log_prob(data, theta, forward) for theta in at])
    assert np.ptp(dense) > 5.0
    assert found == pytest.approx(dense, abs=error * np.ptp(dense))


@pytest.mark.parametrize("counts", [1e-9, condensed_field.COUNTS, 1e9])
def test_common_and_own_errors_of_a_sample_are_those_of_its_estimate(
    counts: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever counts as common: together they are H (own + common) H^T of the points it has."""
    monkeypatch.setattr(condensed_field, "COUNTS", counts)
    data = samples_of(6, np.random.default_rng(8), 2, by_all=True)
    forward = AnalyticForward(BLOCK, field=True)
    samples = condense(data, forward, NOISE, OWN, **ERRORS)
    assert data.field is not None and data.samples is not None and forward.basis is not None
    covariance = field_covariance(data.field, floor=FLOOR, patterns=PATTERNS)
    covariance = covariance.with_patterns(forward.basis.truncation)
    own = own_field_patterns(data, data.field, data.samples, NOISE)
    noise = replace(covariance, noise_variance=covariance.noise_variance * 6, patterns=own)
    noise = replace(noise, floor=0 * covariance.floor)
    model = replace(covariance, noise_variance=np.zeros(3))
    size = data.samples.displacement[0].size
    unit = np.eye(size).reshape(-1, *data.samples.displacement[0].shape)
    both, mean = (
        given.applied(unit).reshape(size, size)
        for given in (model, covariance.with_patterns(own / np.sqrt(6)))
    )
    both = both + noise.applied(unit).reshape(size, size)
    modes = forward.basis.modes.reshape(len(forward.basis.modes), -1)
    k = len(samples.field[0].weights)
    assert samples.field[0].common.shape[1] <= (1 + condensed_field.MOST) * k
    off = (data.field.displacement - forward.basis.offset).ravel()
    middle = np.linalg.lstsq(modes.T, off, rcond=None)[0] @ modes
    middle = middle.reshape(unit.shape[1:]) + forward.basis.offset
    directions = np.vstack([modes, np.tensordot(slope_matrix(TRAVEL), middle, 1).ravel()])
    for part, displacement in zip(samples.field, data.samples.displacement, strict=True):
        h = estimator(mean, directions, np.isfinite(displacement).ravel())
        found = part.own + part.common @ part.common.T
        np.testing.assert_allclose(found, h @ both @ h.T, rtol=1e-6, atol=1e-9 * found.max())


def test_what_the_data_state_of_the_zero_of_the_travel_is_common_to_all_samples() -> None:
    """It counts as a wider prior does (dense matrices hold that one), and not where it is less."""
    data, forward = samples_of(2, np.random.default_rng(8)), AnalyticForward(BLOCK, field=True)
    at = theta_of(X + np.zeros((1, 2, 3)))

    def density(stated: float, assumed: float) -> float:
        noise = replace(NOISE, travel_zero_sd=assumed)
        samples = condense(replace(data, travel_zero_sd=stated), forward, noise, OWN, **ERRORS)
        posterior = HierarchicalPosterior(Population(PRIOR, {"kappa": ScatterPrior(0.3)}), samples)
        return float(posterior.common_errors(samples.white(at)).log_prob[0])

    assert density(0.03, 0.01) == density(0.0, 0.03)
    assert density(0.005, 0.01) == density(0.0, 0.01)
    assert abs(density(0.03, 0.01) - density(0.0, 0.01)) > 0.1


def test_covariance_of_condensed_weights_is_that_of_drawn_fields() -> None:
    """Two hundred samples of one truth: variances of the weights within five standard errors."""
    rng = np.random.default_rng(10)
    forward, n = AnalyticForward(BLOCK, field=True), 200
    data = samples_of(n, rng, lost=3)
    assert data.field is not None and data.samples is not None
    noise = replace(
        field_covariance(data.field), noise_variance=data.field.noise_std**2 * n
    ).sample(rng, n)
    clean = BLOCK(X[1:]).displacement
    missing = np.isnan(data.samples.displacement)
    fields = np.where(missing, np.nan, clean + noise)
    data = replace(data, samples=replace(data.samples, displacement=fields))
    # The same all over the face: else a sample that lacks points may be weighed better for its own.
    even = ERRORS | {"field_floor": 0.004}
    samples = condense(data, forward, NOISE, SampleErrors(0.0), **even)
    weights = samples.data[:-1, 5:9] - np.array([1.0, X[1], X[1] ** 2, X[2]])
    own = samples.field[0].own[:4, :4]
    white = weights @ np.linalg.inv(np.linalg.cholesky(own)).T
    # placing errors, of which there are none here, are estimated from noise: a little too much
    assert np.all(white.var(axis=0) < 1 + 5 * np.sqrt(2 / n))
    assert np.all(white.var(axis=0) > 0.7 - 5 * np.sqrt(2 / n))
    assert np.abs(white.mean(axis=0)).max() < 5 / np.sqrt(n)
    fewer = samples.field[-1].own[:4, :4] - own
    assert np.linalg.eigvalsh(fewer).max() > 0  # the sample that lacks points knows less


def test_solve_and_applied_are_inverse_to_each_other() -> None:
    data = samples_of(3, np.random.default_rng(1)).field
    assert data is not None
    covariance = field_covariance(data, floor=0.003, patterns=PATTERNS)
    fields = np.random.default_rng(2).standard_normal((3, 5, 10, 3))
    assert covariance.applied(covariance.solve(fields)) == pytest.approx(fields, abs=1e-8)
    products = fields.reshape(3, -1) @ covariance.solve(fields).reshape(3, -1).T
    assert products == pytest.approx(covariance.inner(fields, fields), rel=1e-9)


def without_placing(data: Dataset, monkeypatch: pytest.MonkeyPatch) -> CondensedSamples:
    """Condensed with errors of placing of nothing, which the mean's likelihood has not either."""
    monkeypatch.setattr(
        "calib.inference.condensed_field.own_field_patterns",
        lambda *_: np.zeros((0, *data.field.displacement.shape)),
    )
    return condense(data, AnalyticForward(BLOCK, 0.02, True), NOISE, SampleErrors(0.0), **ERRORS)


@pytest.mark.parametrize("lost", [0, 2])
def test_without_scatter_the_model_is_that_of_the_mean(
    lost: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mean's force noise is that of one over n. Nuisances move the field by its predicted slope
    in one and, when it is condensed, by the mean's: to 2 parts in a thousand."""
    data = samples_of(5, np.random.default_rng(3), lost)
    noise = NOISE.load_cell_sd**2 * np.eye(5)
    monkeypatch.setattr("calib.inference.noise.mean_covariance", lambda *_: noise / 5)
    mean = Posterior(
        PRIOR, build_likelihood(data, AnalyticForward(BLOCK, 0.02, True), NOISE, **ERRORS)
    )
    samples = without_placing(data, monkeypatch)
    pooled = Pooled(HierarchicalPosterior(Population(PRIOR, {"kappa": ScatterPrior(1)}), samples))
    x = X + np.random.default_rng(4).standard_normal((8, 3)) * [0.05, 0.1, 0.05]
    by_mean, by_samples = mean.log_prob(x), pooled.log_prob(x)
    assert np.ptp(by_mean) > 5.0
    error = (0.002 if lost == 0 else 0.02) * np.ptp(by_mean)
    assert by_samples - by_samples[0] == pytest.approx(by_mean - by_mean[0], abs=error)


@pytest.mark.parametrize("lost", [9, 10], ids=["one point", "none"])
def test_a_sample_whose_points_tell_no_field_counts_by_its_force(lost: int) -> None:
    data = samples_of(4, np.random.default_rng(3), lost)
    samples = condense(data, AnalyticForward(BLOCK, 0.02, True), NOISE, OWN, **ERRORS)
    assert samples.n_data.tolist() == [10, 10, 10, 5]
    assert samples.without_field == samples.names[3:]
    x = np.repeat(X[None, None], 4, axis=1)
    white = samples.white(theta_of(x))
    assert np.all(white.residual[0, 3, 5:] == 0) and np.all(white.factor[0, 3, 5:] == 0)
    assert np.isfinite(white.factor).all()


def test_truncated_normal_population_is_scipys() -> None:
    family = Population(PRIOR, {"s": ScatterPrior(0.1), "kappa": ScatterPrior(0.3)})
    assert family.varying == ("kappa", "s") and family.common == ("r",)
    rng = np.random.default_rng(0)
    x, tau = np.array([[np.log(0.002), 0.3, 0.02]]), np.array([[0.5, 0.06]])
    v = rng.standard_normal((1, 7, 2))
    own = family.samples(x, tau, v)[:, :, [0, 2]]
    low, high = PRIOR.bounds[[0, 2]].T
    centre = x[0, [0, 2]]
    known = truncnorm((low - centre) / tau[0], (high - centre) / tau[0], centre, tau[0])
    assert own[0] == pytest.approx(known.ppf(0.5 * (1 + _erf(v[0]))), rel=1e-9)
    assert family.standard(x, tau, own) == pytest.approx(v, rel=1e-7)
    assert family.log_density(x, tau, own)[0] == pytest.approx(known.logpdf(own[0]).sum(axis=0))


def _erf(v: Array) -> Array:
    from scipy.special import erf

    value: Array = erf(v / np.sqrt(2))
    return value


def test_population_keeps_its_digits_far_outside_and_next_to_bounds() -> None:
    family = Population(PRIOR, {"s": ScatterPrior(0.1)})
    x, v = np.array([[np.log(0.01), 0.3, 0.0]]), np.array([[[-6.0], [-1.0], [0.0], [6.0]]])
    for size in (1e-8, 1e-3, 10.0):
        tau = np.array([[size]])
        own = family.samples(x, tau, v)
        assert np.all(np.diff(own[0, :, 2]) >= 0) and own[0, 0, 2] >= 0
        assert family.standard(x, tau, own[:, :, [2]]) == pytest.approx(v, rel=1e-5, abs=1e-5)
        assert np.isfinite(family.log_density(x, tau, own[:, :, [2]])).all()


def test_scatter_priors_are_halves_of_scipys() -> None:
    tau = np.array([0.01, 0.2, 3.0])
    normal, heavy = ScatterPrior(0.3), ScatterPrior(0.3, 4.0)
    assert normal.log_density(tau) == pytest.approx(halfnorm(scale=0.3).logpdf(tau))
    assert heavy.log_density(tau) == pytest.approx(np.log(2) + t(4, scale=0.3).logpdf(tau))
    for prior in (normal, heavy):
        assert prior.quantile(np.array([0.5])) > 0
    assert normal.quantile(np.array([0.7])) == pytest.approx(halfnorm(scale=0.3).ppf(0.7))


SETTINGS = SamplerSettings(
    n_ensembles=2, n_walkers=64, n_autocorrelation=20, max_steps=100, check_every=50
)


def drawn(force: Array, seed: int, common_sd: float, settings: SamplerSettings) -> PopulationDraws:
    posterior = HierarchicalPosterior(population(0.3), condensed(dataset(force), common_sd))
    return sample_population(posterior, settings, np.random.default_rng(seed))


def assert_agrees(found: Array, known: Exact, ess: float) -> None:
    """Five Monte-Carlo errors for means; SDs to five of theirs."""
    flat = found.reshape(-1, known.mean.size)
    assert np.abs((flat.mean(axis=0) - known.mean) / known.sd).max() < 5 / np.sqrt(ess)
    assert np.abs(flat.std(axis=0) / known.sd - 1).max() < 5 / np.sqrt(ess)


@pytest.mark.lasting
@pytest.mark.parametrize(
    ("tau", "common_sd"), [(0.2, 0.3), pytest.param(0.01, 0.0, marks=pytest.mark.slow)]
)
def test_draws_are_those_of_the_closed_form(tau: float, common_sd: float) -> None:
    rng = np.random.default_rng(3)
    x = np.column_stack([0.3 + tau * rng.standard_normal(N), np.full(N, 0.4)])
    force = forces(x, rng, common_sd)
    draws = drawn(force, 1, common_sd, SETTINGS)
    globals_, scatter, own = exact(force, 0.3, common_sd)
    x_known = globals_._replace(mean=globals_.mean + np.array([np.log(0.01), 0.0]))
    size = draws.x[..., 0].size
    ess = size / draws.autocorrelation_time.max()
    assert ess > 200
    assert_agrees(draws.x, x_known, ess)
    assert_agrees(draws.tau, scatter, ess)
    assert_agrees(draws.own, own._replace(mean=own.mean + np.log(0.01)), ess)
    # by itself no sample knows of the others, so that the population can only draw them together
    alone = draws.alone.mean(axis=0)[:, 0]
    assert np.ptp(draws.own.mean(axis=(0, 1, 2))[:, 0]) < np.ptp(alone)


def test_the_order_of_samples_and_of_workers_does_not_matter() -> None:
    """Another order gives the same density; the same seed the same bits."""
    rng = np.random.default_rng(11)
    x = np.column_stack([0.2 * rng.standard_normal(N), np.full(N, 0.4)])
    force = forces(x, rng)
    order = rng.permutation(N)
    values = []
    for index in (np.arange(N), order):
        posterior = HierarchicalPosterior(population(), condensed(dataset(force[index]), 0.2))
        v = np.random.default_rng(0).standard_normal((1, N, 1))[:, index]
        at = (np.array([[np.log(0.012), 0.4]]), np.array([[0.2]]), v)
        values.append(posterior.common_errors(posterior.white(*at)).log_prob[0])
    assert values[0] == pytest.approx(values[1], rel=1e-12)
    short = replace(SETTINGS, n_walkers=16, max_steps=6, check_every=6)
    first, again = (drawn(force, 5, 0.0, short) for _ in range(2))
    assert np.array_equal(first.own, again.own) and np.array_equal(first.alone, again.alone)


def test_samples_by_themselves_rest_on_several_common_errors_of_each_walker(monkeypatch) -> None:
    rng = np.random.default_rng(2)
    x = np.column_stack([0.2 * rng.standard_normal(N), np.full(N, 0.4)])
    seen = []
    kept = Moves.alone

    def noted(self, walkers, n_settle, n_draw):
        seen.append(walkers.z)
        return kept(self, walkers, n_settle, n_draw)

    monkeypatch.setattr(Moves, "alone", noted)
    short = replace(SETTINGS, n_walkers=16, max_steps=6, check_every=6)
    draws = drawn(forces(x, rng, 0.3), 5, 0.3, short)
    assert len(draws.alone) == 40 * len(seen[0])  # as many as of one place each
    assert len(np.unique(np.concatenate(seen), axis=0)) == 4 * len(seen[0])


def test_one_sample_and_missing_samples_are_refused() -> None:
    data = samples_of(2, np.random.default_rng(3))
    assert data.samples is not None
    forward = AnalyticForward(BLOCK, field=True)
    with pytest.raises(ValueError, match="samples: found none one by one"):
        condense(replace(data, samples=None), forward, NOISE, OWN)
    single = SampleData(("S1",), data.samples.force[:1], data.samples.displacement[:1])
    with pytest.raises(ValueError, match="samples: found one, expected two or more"):
        condense(replace(data, n_samples=1, samples=single), forward, NOISE, OWN)
    bad = replace(data.samples, force=data.samples.force * np.nan)
    with pytest.raises(ValueError, match="finite forces"):
        condense(replace(data, samples=bad), forward, NOISE, OWN)


def test_impossible_populations_are_refused_in_one_sentence() -> None:
    with pytest.raises(ValueError, match="scatter: expected some of kappa, r, s, found nothing"):
        Population(PRIOR, {})
    with pytest.raises(ValueError, match="found height"):
        Population(PRIOR, {"height": ScatterPrior(0.1)})
    with pytest.raises(ValueError, match="size: expected a positive number"):
        ScatterPrior(0.0)
    with pytest.raises(ValueError, match="freedom: expected a positive number"):
        ScatterPrior(1.0, -1.0)
    with pytest.raises(ValueError, match="travel_zero_sd"):
        SampleErrors(-0.1)


@pytest.mark.parametrize(("without", "left"), [(0, 0), (20, 0), (20, 1)])
def test_placing_errors_of_one_sample_have_the_size_that_samples_show(
    without: int, left: int
) -> None:
    """Fields moved by 0.05 mm (SD) along x on their lattice: the first pattern is that.

    Samples without a field do not show any, which is not that they have none; that of one point,
    far off, is its noise.
    """
    rng = np.random.default_rng(4)
    n, grid = 40 + without, np.stack(np.meshgrid(np.linspace(0, 5, 9), np.linspace(0, 2.4, 6)), -1)
    points = grid.reshape(-1, 2)
    clean = AnalyticBlock(points=points)(X[1:]).displacement
    by_x = field_slopes(clean, points, TRAVEL)[0]
    moved = 0.05 * rng.standard_normal((n, 1, 1, 1)) * by_x
    noise = 1e-3 * rng.standard_normal((n, *clean.shape))
    fields = clean + moved + noise
    fields[40:, :, left:] = np.nan
    fields[40:, :, :left] += 0.5 * rng.standard_normal((without, 1, left, 3))
    average = np.nanmean(fields[:40], axis=0)
    mean = FieldData(points, average, np.full(3, 1e-3 / np.sqrt(n)), 0.1, 0.0)
    force = np.tile(np.arange(1.0, 6.0), (n, 1))
    data = Dataset(
        "grid", True, TRAVEL, force[0], np.full(5, 0.1), n, mean,
        samples=SampleData(tuple(map(str, range(n))), force, fields),
    )  # fmt: skip
    assert data.samples is not None
    patterns = own_field_patterns(data, mean, data.samples, NoiseSettings())
    shown = np.sqrt(np.mean(patterns[0] ** 2) / np.mean(by_x**2))
    assert shown == pytest.approx(0.05, rel=5 / np.sqrt(2 * n) if not without else 0.15)
    assert np.mean(patterns[1] ** 2) < 1e-2 * np.mean(patterns[0] ** 2)


def test_samples_without_noise_of_the_load_cell_are_refused_by_name():
    data = samples_of(N, np.random.default_rng(3))
    quiet = replace(NOISE, load_cell_sd=0.0)
    with pytest.raises(ValueError, match="load_cell_sd: expected above 0 N where samples are told"):
        condense(data, AnalyticForward(BLOCK, 0.02, True), quiet, OWN, **ERRORS)
