"""The discrepancy is an error of stated relative size, smooth and apart from the parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_models import TRAVEL
from scipy.stats import halfcauchy, multivariate_normal
from test_benchmarks_calibration import likelihood

from calib.inference import Likelihood, Marginal
from calib.inference.discrepancy import COMMON, TYPICAL, ForceDiscrepancy, smooth_over

THETA = np.array([[0.02, 0.4, 0.2], [0.01, 0.1, 0.05]])


def forces_alone(force: np.ndarray) -> Likelihood:
    """Of forces that are measured without error, by an emulator without error."""
    own = replace(likelihood(), field=None, force=force)
    exact = replace(
        own.errors,
        mean=1e-14 * np.eye(len(TRAVEL)),
        discretisation=np.zeros(len(TRAVEL)),
        travel_zero_sd=0.0,
    )
    return replace(own, errors=exact, forward=_Certain(own))


class _Certain:
    """The means of a likelihood's forward model."""

    def __init__(self, own: Likelihood) -> None:
        self._forward = own.forward
        self.field_basis = None

    def predict(self, theta: np.ndarray):  # type: ignore[no-untyped-def]
        return replace(self._forward.predict(theta), force_covariance=None)


def wrong(own: Likelihood, share: float) -> Likelihood:
    """The forces of a model that errs by a share."""
    factor = ForceDiscrepancy(smooth_over(TRAVEL, 0.8), share)
    return replace(own, errors=replace(own.errors, discrepancy=factor))


def test_exact_forces_are_lognormal_about_what_is_predicted() -> None:
    """Held to the normal density of their logarithms, with the Jacobian of these."""
    share, force = 0.3, np.array([0.9, 1.3, 2.1, 2.6, 4.0])
    own = forces_alone(force)
    found = wrong(own, share).log_prob(THETA)
    spread = share**2 * (COMMON**2 + smooth_over(TRAVEL, 0.8))
    for value, predicted in zip(found, own.forward.predict(THETA).force, strict=True):
        known = multivariate_normal(np.log(predicted), spread).logpdf(np.log(force))
        assert value == pytest.approx(known - np.log(force).sum(), rel=1e-7)


def test_a_force_twice_as_large_is_as_likely_as_one_half_as_large() -> None:
    """In kappa the density is even about its peak on the scale of logarithms."""
    peak = forces_alone(np.ones(len(TRAVEL))).forward.predict(THETA[:1]).force[0]
    known = wrong(forces_alone(peak), 0.4)
    twice, half = THETA[:1].copy(), THETA[:1].copy()
    twice[:, 0] *= 2.0
    half[:, 0] /= 2.0
    assert known.log_prob(twice) == pytest.approx(known.log_prob(half), abs=1e-6)


def test_a_common_factor_is_the_stiffness_itself() -> None:
    """Ln kappa from forces alone, all else known: SD of the factor that all increments share."""
    share = 0.2
    force = forces_alone(np.ones(len(TRAVEL))).forward.predict(THETA[:1]).force[0]
    known = wrong(forces_alone(force), share)
    theta = np.repeat(THETA[:1], 4001, axis=0)
    off = np.linspace(-4.0, 4.0, len(theta))
    theta[:, 0] *= np.exp(off)
    density = np.exp(known.log_prob(theta) - known.log_prob(THETA[:1]))
    density /= density.sum()
    sd = np.sqrt(density @ off**2 - (density @ off) ** 2)
    one = np.ones(len(TRAVEL))
    by_shape = 1.0 / (one @ np.linalg.solve(smooth_over(TRAVEL, 0.8), one))
    assert sd == pytest.approx(share * np.sqrt(COMMON**2 + by_shape), rel=1e-3)


def test_a_small_share_changes_nothing_and_a_large_one_flattens() -> None:
    """Beside forces with errors of measurement alone: of relative errors the scale changes, too."""
    plain = forces_alone(np.ones(len(TRAVEL)))
    force = plain.forward.predict(THETA[:1]).force[0]
    errors = replace(plain.errors, mean=likelihood().errors.mean)
    known = replace(plain, force=force, errors=errors)
    near = THETA[:1] * np.array([[1.0], [1.005]])
    spread = {share: np.ptp(wrong(known, share).log_prob(near)) for share in (1e-6, 0.3)}
    assert spread[1e-6] == pytest.approx(np.ptp(known.log_prob(near)), rel=0.01)
    assert spread[0.3] < 0.01 * spread[1e-6]


def test_the_prior_of_the_share_is_half_cauchy_and_cut_off() -> None:
    found, known = Marginal("half_cauchy", 0.001, 2.0, median=TYPICAL), halfcauchy(scale=TYPICAL)
    share = np.array([0.001, 0.1, 2.0])
    mass = known.cdf(2.0) - known.cdf(0.001)
    assert found.log_density(share) == pytest.approx(known.logpdf(share) - np.log(mass), rel=1e-12)
    assert found.log_density(np.array([5e-4, 2.1])).tolist() == [-np.inf, -np.inf]
    below = np.array([0.1, 0.5, 0.9])
    reached = (known.cdf(found.quantile(below)) - known.cdf(0.001)) / mass
    assert reached == pytest.approx(below, rel=1e-12)
    for low, median in ((-0.1, 0.1), (0.0, None), (0.0, -1.0)):
        with pytest.raises(ValueError, match="median"):
            Marginal("half_cauchy", low, 2.0, median=median)


def test_forces_that_are_not_positive_are_refused() -> None:
    own = wrong(replace(likelihood(), force=-np.ones(5)), 0.1)
    with pytest.raises(ValueError, match="force: expected positive forces"):
        own.log_prob(THETA)
