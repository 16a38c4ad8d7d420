"""emcee and quadrature are two independent ways to the same posterior, and they agree."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from analytic_models import AnalyticBlock, AnalyticForward

from calib.data import Dataset, thesis_forces
from calib.inference import (
    Marginal,
    NoiseSettings,
    Posterior,
    Prior,
    Quadrature,
    SamplerSettings,
    SamplingResult,
    SamplingStatus,
    build_likelihood,
    integrate,
    sample_posterior,
)
from calib.inference.sampling import dispersed_starts
from calib.virtual import VirtualNoise, virtual_experiment
from fe.response import Array

PRIOR = Prior(
    Marginal("log_uniform", 0.003, 0.3), Marginal("uniform", 0, 1), Marginal("uniform", 0, 0.5)
)
# A step of four times the walkers costs less than twice as much: many walkers, few steps. A third
# of the kept steps is thrown away before them, five times their memory when they are 15 times it.
SETTINGS = SamplerSettings(
    n_ensembles=4, n_walkers=128, n_autocorrelation=15, max_steps=6000, check_every=150
)


def posterior_of(dataset: Dataset) -> Posterior:
    forward = AnalyticForward(AnalyticBlock(), 0.005)
    return Posterior(
        PRIOR, build_likelihood(dataset, forward, NoiseSettings(), force_discretisation=0.02)
    )


POSTERIOR = posterior_of(thesis_forces())


@cache
def sampled() -> SamplingResult:
    return sample_posterior(POSTERIOR, SETTINGS, np.random.default_rng(4))


@cache
def integrated() -> Quadrature:
    return integrate(POSTERIOR)


def z_scores(values: Array, expected: Array, sd: Array, tau: Array) -> Array:
    """Deviation of chain means (n_ensemble, n_step, n_walker, d) in Monte-Carlo errors."""
    n = values[..., 0].size
    result: Array = (values.mean(axis=(0, 1, 2)) - expected) / (sd * np.sqrt(tau / n))
    return result


@pytest.mark.lasting
def test_means_of_the_chains_are_those_of_the_quadrature() -> None:
    """Three z scores below 4: false alarm below 2e-4 (fixed seed)."""
    found, exact = sampled(), integrated()
    assert found.status is SamplingStatus.CONVERGED
    tau = found.autocorrelation_time.max(axis=0)
    assert np.abs(z_scores(found.chains, exact.mean, exact.sd, tau)).max() < 4


@pytest.mark.lasting
def test_spreads_of_the_chains_are_those_of_the_quadrature() -> None:
    """Three z scores of the variances below 4: false alarm below 2e-4 (fixed seed).

    The squares' own SD comes from the quadrature; their memory is not longer than that of x.
    """
    found, exact = sampled(), integrated()
    square = (found.chains - exact.mean) ** 2
    spread = np.sqrt(exact.expect((exact.x - exact.mean) ** 4) - exact.sd**4)
    tau = found.autocorrelation_time.max(axis=0)
    assert np.abs(z_scores(square, exact.sd**2, spread, tau)).max() < 4


def test_same_seed_gives_the_same_bits_and_another_seed_does_not() -> None:
    short = replace(SETTINGS, n_walkers=32, max_steps=60, check_every=25)
    runs = [sample_posterior(POSTERIOR, short, np.random.default_rng(s)) for s in (1, 1, 2)]
    assert np.array_equal(runs[0].chains, runs[1].chains)
    assert not np.array_equal(runs[0].chains, runs[2].chains)


def test_ensembles_have_their_own_streams() -> None:
    short = replace(SETTINGS, n_walkers=32, max_steps=20, check_every=20)
    chains = sample_posterior(POSTERIOR, short, np.random.default_rng(1)).chains
    assert all(not np.array_equal(chains[0], other) for other in chains[1:])


def test_max_steps_is_a_status() -> None:
    progress: list[tuple[int, int]] = []
    result = sample_posterior(
        POSTERIOR,
        replace(SETTINGS, n_walkers=32, max_steps=40, check_every=20),
        np.random.default_rng(1),
        lambda done, total: progress.append((done, total)),
    )
    assert result.status is SamplingStatus.MAX_STEPS
    assert "max_steps" in result.message
    assert progress[-1][0] == 40
    assert all(done <= total for done, total in progress)


@pytest.mark.lasting
def test_chains_are_long_against_their_memory_when_converged() -> None:
    found = sampled()
    n_step = found.chains.shape[1]
    assert n_step >= SETTINGS.n_autocorrelation * found.autocorrelation_time.max()
    assert found.n_burn >= 5 * found.autocorrelation_time.max()


def test_starts_are_wider_than_the_posterior() -> None:
    starts = dispersed_starts(POSTERIOR, 200, np.random.default_rng(0))
    assert starts[:, 0].std() > 2 * integrated().sd[0]
    assert len(np.unique(starts, axis=0)) == 200
    assert np.all(np.isfinite(POSTERIOR.log_prob(starts)))


def test_quadrature_gives_the_evidence_of_a_known_integral() -> None:
    class Flat:
        """Normal in ln kappa and r, uniform in s: integral known in closed form."""

        prior = PRIOR
        centre, sd = np.array([-3.6, 0.5]), np.array([0.02, 0.05])

        def log_prob(self, x: Array) -> Array:
            shift = np.column_stack([x[:, 0] - 0.5 * x[:, 1], x[:, 1]])
            z = (shift - self.centre) / self.sd
            value: Array = -0.5 * np.sum(z**2, axis=1) - np.log(2 * np.pi * self.sd.prod())
            return value

    result = integrate(Flat())  # type: ignore[arg-type]
    assert result.log_evidence == pytest.approx(np.log(0.5), abs=1e-5)
    assert result.mean[0] == pytest.approx(-3.6 + 0.25, abs=1e-5)
    assert result.sd[1] == pytest.approx(0.05, rel=1e-4)


def test_quadrature_states_its_own_error() -> None:
    coarse, fine = integrate(POSTERIOR, 15), integrate(POSTERIOR, 48)
    assert abs(coarse.log_evidence - fine.log_evidence) < 10 * coarse.log_evidence_error + 1e-8
    assert integrated().log_evidence_error < 1e-3


def ranks(n: int, seed: int) -> Array:
    """(n, 3) posterior probability below the truth, truths drawn from the prior.

    The between-sample SD is known (not estimated), as the likelihood assumes.
    """
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(n):
        x = PRIOR.sample(rng, 1)
        template = POSTERIOR.likelihood
        truth = template.forward.predict(np.array([[np.exp(x[0, 0]), *x[0, 1:]]]))
        covariance = template.force_covariance(truth)[0]
        force = rng.multivariate_normal(truth.force[0], covariance)
        posterior = replace(POSTERIOR, likelihood=replace(template, force=force))
        result = integrate(posterior, 18)
        found.append([result.weights @ (result.x[:, i] < x[0, i]) for i in range(3)])
    return np.array(found)


def check_calibration(ranks: Array, limit: float) -> None:
    """Central intervals of 50 and 90 % hold the truth as often as they say."""
    for level in (0.5, 0.9):
        inside = np.mean(np.abs(ranks - 0.5) < level / 2, axis=0)
        error = np.sqrt(level * (1 - level) / len(ranks))
        assert np.all(np.abs(inside - level) < limit * error + 0.02), (level, inside)


@pytest.mark.lasting
def test_intervals_cover_the_truth_at_their_stated_rate() -> None:
    """60 prior draws; six proportions within 3.5 SD: false alarm below 3e-3 (fixed seed).

    0.02 allows for the nodes of the quadrature, which are coarse for single probabilities.
    """
    check_calibration(ranks(60, 11), 3.5)


@pytest.mark.slow
def test_intervals_cover_the_truth_over_many_draws() -> None:
    """600 prior draws; six proportions within 3.5 SD: false alarm below 3e-3 (fixed seed)."""
    check_calibration(ranks(600, 12), 3.5)


@pytest.mark.slow
def test_virtual_experiments_are_covered_by_their_posteriors() -> None:
    """100 experiments with estimated SDs; kappa inside 90 % in 80 to 98: false alarm 1e-2."""
    rng = np.random.default_rng(5)
    inside = 0
    for _ in range(100):
        x = PRIOR.sample(rng, 1)[0]
        theta = np.array([0.04 + 0.1 * rng.random(), x[1], x[2]])
        noise = VirtualNoise(travel_zero_sd=0.02)
        result = integrate(posterior_of(virtual_experiment(AnalyticBlock(), theta, noise, rng)), 18)
        below = result.weights @ (result.x[:, 0] < np.log(theta[0]))
        inside += abs(below - 0.5) < 0.45
    # Discretisation and emulator errors are allowed for but absent here: never too few.
    assert inside >= 80


class TwoModes:
    """A narrow main mode and a broad one with e^-60 of its height, apart from each other."""

    prior = PRIOR

    def log_prob(self, x: Array) -> Array:
        low, high = PRIOR.bounds.T
        unit = (x - low) / (high - low)
        main = -0.5 * np.sum(((unit - 0.2) / 0.02) ** 2, axis=1)
        other = -60.0 - 0.5 * np.sum(((unit - 0.8) / 0.05) ** 2, axis=1)
        value: Array = np.where(
            np.all((unit > 0) & (unit < 1), axis=1), np.logaddexp(main, other), -np.inf
        )
        return value


def test_no_walker_stays_in_a_mode_without_weight():
    settings = SamplerSettings(n_ensembles=2, n_walkers=16, n_autocorrelation=20, max_steps=2000)
    result = sample_posterior(TwoModes(), settings, np.random.default_rng(1))
    assert result.log_prob.min() > -40.0
    assert result.status is SamplingStatus.CONVERGED


def test_starts_of_as_many_walkers_as_a_study_allows_are_found() -> None:
    starts = dispersed_starts(POSTERIOR, 1024, np.random.default_rng(0))
    assert starts.shape == (1024, POSTERIOR.prior.bounds.shape[0])
    assert np.isfinite(POSTERIOR.log_prob(starts)).all()
