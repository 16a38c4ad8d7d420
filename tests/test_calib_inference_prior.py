"""The prior is a normalised density in (ln kappa, r, s)."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest, norm, truncnorm

from calib.inference import Marginal, Prior

MARGINALS = {
    "uniform": Marginal("uniform", 0.01, 0.2),
    "log_uniform": Marginal("log_uniform", 0.01, 0.2),
    "normal": Marginal("normal", 0.01, 0.2, 0.05, 0.03),
    "lognormal": Marginal("lognormal", 0.01, 0.2, 0.05, 0.03),
}


@pytest.mark.parametrize("kappa", MARGINALS)
@pytest.mark.parametrize("r", MARGINALS)
def test_density_with_respect_to_ln_kappa_integrates_to_one(kappa: str, r: str) -> None:
    prior = Prior(MARGINALS[kappa], MARGINALS[r], Marginal("uniform", 0.0, 0.5))
    unit, weight = np.polynomial.legendre.leggauss(60)
    low, high = prior.bounds[:2].T
    nodes = [low[i] + (high[i] - low[i]) * 0.5 * (unit + 1) for i in range(2)]
    grid = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1).reshape(-1, 2)
    x = np.column_stack([grid, np.full(len(grid), 0.2)])
    weights = np.outer(weight, weight).ravel() * 0.25 * np.prod(high - low)
    # s is uniform of width 0.5, so that its own integral is 0.5 times the value.
    assert weights @ np.exp(prior.log_prob(x)) * 0.5 == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("r", [(0.0, 1.0), (0.2, 0.5)])
def test_density_of_priors_of_constants_integrates_to_one_in_the_box(
    r: tuple[float, float],
) -> None:
    """To what 2^16 points of a Sobol sequence know of the share in the box."""
    each = Marginal("lognormal", 0.002, 0.05, 0.01, 0.004)
    kappa = Marginal("log_uniform", 0.005, 0.09)
    prior = Prior(kappa, Marginal("uniform", *r), law="mooney-rivlin-2", of=(each, each))
    low, high = prior.bounds.T
    sides = [np.linspace(low[i], high[i], 1501) for i in range(2)]
    middle = [0.5 * (side[1:] + side[:-1]) for side in sides]
    x = np.stack(np.meshgrid(*middle, indexing="ij"), axis=-1).reshape(-1, 2)
    mass = np.mean(np.exp(prior.log_prob(x))) * np.prod(high - low)
    assert mass == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("name", MARGINALS)
def test_density_is_the_derivative_of_the_inverse_quantile(name: str) -> None:
    marginal = MARGINALS[name]
    p = np.linspace(0.05, 0.95, 7)
    step = 1e-6
    slope = (marginal.quantile(p + step) - marginal.quantile(p - step)) / (2 * step)
    density = np.exp(marginal.log_density(marginal.quantile(p)))
    assert density * slope == pytest.approx(np.ones(7), rel=1e-6)


@pytest.mark.parametrize("name", ["normal", "lognormal"])
def test_mean_and_sd_are_those_of_the_variable_before_truncation(name: str) -> None:
    wide = Marginal(name, 1e-6, 10.0, 2.0, 0.25)
    value = np.linspace(1e-3, 10.0, 200_001)
    density = np.exp(wide.log_density(value)) * (value[1] - value[0])
    mean = value @ density
    assert mean == pytest.approx(2.0, rel=1e-6)
    assert np.sqrt((value - mean) ** 2 @ density) == pytest.approx(0.25, rel=1e-5)


@pytest.mark.parametrize("ends", [(7.0, 8.0), (-8.0, -7.0), (12.0, 20.0), (-1.0, 8.0)])
def test_a_box_far_from_a_normal_mean_holds_what_is_there_of_it(ends: tuple[float, float]) -> None:
    """A posterior that the data pull there is cut so; scipy's truncated normal does the same."""
    whole = Marginal("normal", -30.0, 30.0, 0.0, 1.0)
    cut, log_share = whole.cut(*ends)
    low, high = ends if ends[1] > 0.0 else (-ends[1], -ends[0])
    assert log_share == pytest.approx(np.log(norm.sf(low) - norm.sf(high)), abs=1e-9)
    p = np.linspace(0.01, 0.99, 9)
    there = truncnorm(*ends)
    np.testing.assert_allclose(cut.quantile(p), there.ppf(p), rtol=1e-9)
    value = cut.quantile(p)
    np.testing.assert_allclose(cut.log_density(value), there.logpdf(value), rtol=1e-9)


def test_samples_follow_the_quantiles() -> None:
    """Kolmogorov-Smirnov at 1e-4 on three coordinates: false alarm 3e-4 (fixed seed)."""
    prior = Prior(MARGINALS["log_uniform"], MARGINALS["normal"], MARGINALS["lognormal"])
    x = prior.sample(np.random.default_rng(7), 4000)
    p = np.linspace(0, 1, 2001)
    table = prior.quantile(np.column_stack([p, p, p]))
    for i in range(3):
        assert kstest(np.interp(x[:, i], table[:, i], p), "uniform").pvalue > 1e-4


def test_bounds_themselves_are_inside_and_beyond_them_the_density_is_zero() -> None:
    prior = Prior(MARGINALS["log_uniform"], MARGINALS["normal"], MARGINALS["uniform"])
    low, high = prior.bounds.T
    assert np.all(np.isfinite(prior.log_prob(np.array([low, high]))))
    beyond = np.array([np.where(np.arange(3) == i, high + 1e-9, low) for i in range(3)])
    assert np.all(prior.log_prob(beyond) == -np.inf)


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("gamma", 0.1, 1.0), "distribution"),
        (("uniform", 1.0, 0.1), "low < high"),
        (("log_uniform", 0.0, 1.0), "positive"),
        (("normal", 0.0, 1.0), "needs both"),
        (("uniform", 0.0, 1.0, 0.5, 0.1), "takes neither"),
        (("normal", 0.0, 1.0, 50.0, 0.1), "almost no probability"),
        (("half_cauchy", 0.0, 1.0, None, None, np.inf), "expected a positive median"),
        (("half_cauchy", 1e6, 2e6, None, None, 1e-12), "almost no probability of half_cauchy"),
    ],
)
def test_impossible_marginals_are_refused(arguments: tuple[float, ...], part: str) -> None:
    with pytest.raises(ValueError, match=part):
        Marginal(*arguments)  # type: ignore[arg-type]


def test_kappa_must_be_positive() -> None:
    uniform = Marginal("uniform", 0.0, 1.0)
    with pytest.raises(ValueError, match=r"kappa\.low"):
        Prior(uniform, uniform, uniform)
