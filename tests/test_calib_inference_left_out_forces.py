"""Each force held against what the others say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_models import AnalyticBlock, AnalyticForward
from scipy.stats import kstest, norm

from calib.data import thesis_forces
from calib.inference import Marginal, NoiseSettings, Posterior, Prior, build_likelihood
from calib.inference.left_out_forces import left_out_p_values
from calib.inference.quadrature import integrate

POINTS = np.zeros((1, 2))
TRAVEL = thesis_forces().travel
TRUTH = np.array([[0.01, 0.4, 0.1]])
PRIOR = Prior(
    Marginal("log_uniform", 0.003, 0.3), Marginal("uniform", 0, 1), Marginal("uniform", 0, 0.5)
)


def posterior(force: np.ndarray | None = None, noise: NoiseSettings | None = None) -> Posterior:
    forward = AnalyticForward(AnalyticBlock(points=POINTS), 0.01, False)
    data = thesis_forces()
    if force is not None:
        data = replace(data, force_mean=force)
    noise = noise or NoiseSettings()
    return Posterior(PRIOR, build_likelihood(data, forward, noise, force_discretisation=0.02))


def truth_and_covariance() -> tuple[np.ndarray, np.ndarray]:
    likelihood = posterior().likelihood
    prediction = likelihood.predict(TRUTH)
    return prediction.force[0], likelihood.force_covariance(prediction, TRUTH)[0]


def test_the_probability_is_that_of_draws_of_the_force_given_the_others() -> None:
    """By draws of constants and force from the posterior without it: 4 SDs of 20,000 draws."""
    force, covariance = truth_and_covariance()
    rng = np.random.default_rng(2)
    found = posterior(force + np.linalg.cholesky(covariance) @ rng.standard_normal(force.size))
    p_values = left_out_p_values(found, TRAVEL)
    assert p_values is not None
    index, rest = 3, [0, 1, 2, 4]
    likelihood = found.likelihood
    draws = integrate(found, 24)
    theta = np.column_stack([np.exp(draws.x[:, 0]), draws.x[:, 1:]])
    prediction = likelihood.predict(theta)
    cov = likelihood.force_covariance(prediction, theta)
    residual = likelihood.force - prediction.force
    # weights of the posterior without the force: those with it over its density given the others
    inner = cov[:, rest][:, :, rest]
    gain = np.linalg.solve(inner, cov[:, rest, index][..., None])[..., 0]
    mean = prediction.force[:, index] + np.sum(gain * residual[:, rest], axis=1)
    sd = np.sqrt(cov[:, index, index] - np.sum(gain * cov[:, rest, index], axis=1))
    weights = draws.weights / norm.pdf(likelihood.force[index], mean, sd)
    weights /= weights.sum()
    chosen = rng.choice(len(weights), 20_000, p=weights)
    again = rng.normal(mean[chosen], sd[chosen])
    below = np.mean(again < likelihood.force[index])
    expected = 2.0 * min(below, 1.0 - below)
    assert p_values[index] == pytest.approx(expected, abs=8.0 * 0.5 / np.sqrt(20_000))


@pytest.mark.slow
def test_probabilities_of_a_right_model_are_uniform() -> None:
    """One force of each of 60 data sets of the prior: false alarm 1e-3 (fixed seed)."""
    rng = np.random.default_rng(4)
    found = []
    for _ in range(60):
        theta = np.array([[np.exp(rng.uniform(-5.2, -3.0)), rng.random(), 0.5 * rng.random()]])
        likelihood = posterior().likelihood
        prediction = likelihood.predict(theta)
        covariance = likelihood.force_covariance(prediction, theta)[0]
        noise = np.linalg.cholesky(covariance) @ rng.standard_normal(TRAVEL.size)
        p_values = left_out_p_values(posterior(prediction.force[0] + noise), TRAVEL)
        assert p_values is not None
        found.append(p_values[rng.integers(TRAVEL.size)])
    assert kstest(found, "uniform").pvalue > 1e-3


@pytest.mark.parametrize(("factor", "low", "high"), [(1.0, 0.2, 1.0), (1.3, 0.0, 0.01 / 5)])
def test_a_wrong_force_that_the_fit_follows_is_told(factor: float, low: float, high: float) -> None:
    force, _ = truth_and_covariance()
    force[-1] *= factor
    p_values = left_out_p_values(posterior(force), TRAVEL)
    assert p_values is not None and low <= p_values.min() <= high


def test_one_force_or_data_that_allow_for_outliers_are_not_asked() -> None:
    assert left_out_p_values(posterior(), TRAVEL[:1]) is None
    assert left_out_p_values(posterior(noise=NoiseSettings(force_freedom=5.0)), TRAVEL) is None
    assert left_out_p_values(posterior(noise=NoiseSettings(discrepancy=0.05)), TRAVEL) is None
