"""The discrepancy is an error of stated relative size, smooth and apart from the parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_models import TRAVEL
from scipy.spatial.distance import cdist
from scipy.stats import halfcauchy, multivariate_normal
from test_benchmarks_calibration import POINTS, likelihood

from calib.inference import Likelihood
from calib.inference.discrepancy import (
    COMMON,
    KEPT,
    LENGTH,
    TYPICAL,
    factor_covariance,
    field_discrepancy,
    log_prior_of_share,
    with_discrepancy,
)
from calib.inference.noise import smooth_over

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


def test_patterns_make_the_squared_exponential() -> None:
    """But for the share of the variance that is left out on purpose."""
    size = 0.01 * np.arange(1.0, 16.0).reshape(5, 3)
    patterns = field_discrepancy(POINTS, TRAVEL, size).reshape(-1, 5, len(POINTS), 3)
    found = np.einsum("qipc,qjrd->ipcjrd", patterns, patterns)
    space = np.exp(-0.5 * (cdist(POINTS, POINTS) / LENGTH) ** 2)
    over = smooth_over(TRAVEL, 0.8)
    dense = np.einsum("ij,pr,ic,jd,cd->ipcjrd", over, space, size, size, np.eye(3))
    assert np.abs(found - dense).max() < 2 * (1.0 - KEPT) * dense.max() * len(POINTS)
    assert np.einsum("ipcipc->", found) == pytest.approx(np.einsum("ipcipc->", dense), rel=0.011)


def test_exact_forces_are_lognormal_about_what_is_predicted() -> None:
    """Held to the normal density of their logarithms, with the Jacobian of these."""
    share, force = 0.3, np.array([0.9, 1.3, 2.1, 2.6, 4.0])
    own = forces_alone(force)
    found = with_discrepancy(own, TRAVEL, POINTS, share).log_prob(THETA)
    spread = factor_covariance(TRAVEL, share)
    for value, predicted in zip(found, own.forward.predict(THETA).force, strict=True):
        known = multivariate_normal(np.log(predicted), spread).logpdf(np.log(force))
        assert value == pytest.approx(known - np.log(force).sum(), rel=1e-7)


def test_a_force_twice_as_large_is_as_likely_as_one_half_as_large() -> None:
    """In kappa the density is even about its peak on the scale of logarithms."""
    peak = forces_alone(np.ones(len(TRAVEL))).forward.predict(THETA[:1]).force[0]
    known = with_discrepancy(forces_alone(peak), TRAVEL, POINTS, 0.4)
    twice, half = THETA[:1].copy(), THETA[:1].copy()
    twice[:, 0] *= 2.0
    half[:, 0] /= 2.0
    assert known.log_prob(twice) == pytest.approx(known.log_prob(half), abs=1e-6)


def test_a_common_factor_is_the_stiffness_itself() -> None:
    """Ln kappa from forces alone, all else known: SD of the factor that all increments share."""
    share = 0.2
    force = forces_alone(np.ones(len(TRAVEL))).forward.predict(THETA[:1]).force[0]
    known = with_discrepancy(forces_alone(force), TRAVEL, POINTS, share)
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
    spread = {
        share: np.ptp(with_discrepancy(known, TRAVEL, POINTS, share).log_prob(near))
        for share in (1e-6, 0.3)
    }
    assert spread[1e-6] == pytest.approx(np.ptp(known.log_prob(near)), rel=0.01)
    assert spread[0.3] < 0.01 * spread[1e-6]


def test_a_field_that_errs_is_believed_less() -> None:
    own = likelihood()
    field = own.field
    assert field is not None
    basis = replace(field.basis, offset=field.basis.offset + 0.3)
    own = replace(own, field=replace(field, basis=basis))
    assert own.field is not None
    flat = {
        share: np.ptp(wide.field.along(wide.forward.predict(THETA)).value)
        for share in (1e-4, 0.3)
        if (wide := with_discrepancy(own, TRAVEL, POINTS, share)).field is not None
    }
    assert flat[0.3] < 0.1 * flat[1e-4]


def test_the_prior_of_the_share_is_half_cauchy() -> None:
    share = np.array([1e-3, 0.1, 2.0])
    expected = halfcauchy(scale=TYPICAL).logpdf(share) + np.log(share)
    assert log_prior_of_share(share) == pytest.approx(expected, rel=1e-12)


def test_forces_that_are_not_positive_are_refused() -> None:
    own = with_discrepancy(replace(likelihood(), force=-np.ones(5)), TRAVEL, POINTS, 0.1)
    with pytest.raises(ValueError, match="force: expected positive forces"):
        own.log_prob(THETA)


def test_a_share_that_is_not_positive_is_refused() -> None:
    with pytest.raises(ValueError, match="share: expected a positive"):
        with_discrepancy(likelihood(), TRAVEL, POINTS, 0.0)
