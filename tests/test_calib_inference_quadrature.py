"""Quadrature of normal posteriors of (r, s) whose integrals are known, on ridges and off them."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from calib.inference import Marginal, Posterior, Prior, Quadrature, integrate
from calib.inference.coordinates import x_of
from calib.inference.importance import NotReached
from calib.inference.likelihood import Likelihood
from calib.inference.quadrature import DRAWS, QUADRATURE, _by_draws
from fe.response import Array

PRIOR = Prior(
    Marginal("log_uniform", 0.003, 0.3), Marginal("uniform", 0, 1), Marginal("uniform", 0, 0.5)
)
LN_KAPPA_SD = 0.02


@dataclass(frozen=True)
class Normal:
    """Normal in (r, s), cut off at the prior's box, and in ln kappa about a line of (r, s)."""

    correlation: float
    sd: tuple[float, float]
    centre: tuple[float, float] = (0.43, 0.21)
    prior: Prior = PRIOR

    @property
    def covariance(self) -> Array:
        """(2, 2) before the prior cuts it off"""
        correlation: Array = np.array([[1.0, self.correlation], [self.correlation, 1.0]])
        return np.outer(self.sd, self.sd) * correlation

    @property
    def log_evidence(self) -> float:
        """Ln of the mass in the prior's box"""
        low, high = self.prior.bounds[1:].T
        mass = multivariate_normal.cdf(
            high, self.centre, self.covariance, lower_limit=low, abseps=1e-9, releps=1e-9
        )
        return float(np.log(mass))

    def log_prob(self, x: Array) -> Array:
        """(m,) at x (m, 3)"""
        scaled = (x[:, 0] + 3.6 - 0.5 * x[:, 1] + 0.8 * x[:, 2]) / LN_KAPPA_SD
        line = -0.5 * scaled**2 - 0.5 * np.log(2.0 * np.pi * LN_KAPPA_SD**2)
        value = line + multivariate_normal.logpdf(x[:, 1:], self.centre, self.covariance)
        return np.where(np.isfinite(self.prior.log_prob(x)), value, -np.inf)


def integrated(normal: Normal, n: int = 30) -> Quadrature:
    return integrate(cast("Posterior", normal), n)


def off_by(found: Quadrature, normal: Normal) -> float:
    return abs(found.log_evidence - normal.log_evidence)


RIDGES = [
    Normal(-0.97, (0.02, 0.02)),
    Normal(-0.99, (0.05, 0.03)),
    Normal(-0.99, (0.004, 0.004)),
    Normal(-0.99, (0.02, 0.02)),
    Normal(-0.999, (0.05, 0.05)),
    Normal(0.98, (0.03, 0.01)),
    # The scan of the box has no point on these: the box cuts them off.
    Normal(-0.995, (0.1, 0.004)),
    Normal(-0.9975, (0.0034, 0.0861), (0.4, 0.46)),
    Normal(0.9515, (0.0021, 0.152), (0.33, 0.22)),
    # Nor has the box these at all.
    Normal(0.9955, (0.0015, 0.0133), (0.24, 0.09)),
    Normal(-0.9995, (0.0015, 0.0014), (0.13, 0.4)),
]


def at_the_edge_of_r(r: float) -> tuple[Posterior, float]:
    """A normal in (ln kappa, r, s) about `r` beyond the prior's bound, and its ln evidence."""
    prior = Prior(
        Marginal("log_uniform", 0.001, 0.1), Marginal("uniform", 0, 1), Marginal("uniform", 0, 0.5)
    )
    centre, sd = np.array([-2.963891, r, 0.36727]), np.array([0.006983, 0.006331, 0.035555])
    correlation = np.array([[1.0, 0.8982, 0.7628], [0.8982, 1.0, 0.9129], [0.7628, 0.9129, 1.0]])
    normal = multivariate_normal(centre, correlation * np.outer(sd, sd))
    low, high = prior.bounds.T
    mass = normal.cdf(high, lower_limit=low)
    log_evidence = float(np.log(mass / np.prod(high - low)))
    likelihood = SimpleNamespace(log_prob=lambda theta: normal.logpdf(x_of(theta)), unknown=())
    return Posterior(prior, cast("Likelihood", likelihood)), log_evidence


@pytest.mark.parametrize("r", [-0.00358, -0.0034, -0.003])
def test_draws_of_a_ridge_that_a_bound_cuts_off_have_its_evidence(r: float) -> None:
    """One of 40,000 carried 9 % of the weight, and the posterior was called not reached."""
    posterior, log_evidence = at_the_edge_of_r(r)
    for found in (_by_draws(posterior), integrate(posterior)):
        within = max(4.0 * found.log_evidence_error, 1e-3)  # the closed form's own error
        assert found.log_evidence == pytest.approx(log_evidence, abs=within)


def test_nodes_that_agree_stand_where_draws_do_not_reach_the_posterior(monkeypatch) -> None:
    def unreached(posterior: Posterior) -> Quadrature:
        raise NotReached("posterior: not reached")

    monkeypatch.setattr("calib.inference.quadrature._by_draws", unreached)
    posterior, log_evidence = at_the_edge_of_r(-0.00358)
    found = integrate(posterior)
    assert found.method == QUADRATURE
    assert found.log_evidence == pytest.approx(log_evidence, abs=1e-3)
    with pytest.raises(ValueError, match="not reached"):
        integrated(RIDGES[2])  # which nodes miss


@pytest.mark.parametrize("normal", RIDGES)
def test_evidence_and_moments_of_a_narrow_ridge_are_right_within_what_is_stated(
    normal: Normal,
) -> None:
    found = integrated(normal)
    assert off_by(found, normal) < 3.0 * found.log_evidence_error + 0.01
    assert found.log_evidence_error < 0.02
    if normal.log_evidence > -1e-6:  # else the bounds of the prior change the moments
        sd = np.array(normal.sd)
        assert np.abs(found.mean[1:] - normal.centre).max() < 0.04 * sd.max()
        assert found.sd[1:] == pytest.approx(sd, rel=0.04)
        correlation = found.covariance[1, 2] / found.sd[1] / found.sd[2]
        assert correlation == pytest.approx(normal.correlation, abs=0.004)


@pytest.mark.parametrize("correlation", [-0.9, -0.5, 0.0, 0.8, 0.9])
@pytest.mark.parametrize("sd", [(0.02, 0.02), (0.05, 0.03), (0.2, 0.1)])
def test_correlations_that_the_nodes_resolve_are_left_to_the_nodes(
    correlation: float, sd: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(posterior: Posterior) -> Quadrature:
        raise AssertionError("draws were asked")

    monkeypatch.setattr("calib.inference.quadrature._by_draws", refuse)
    normal = Normal(correlation, sd)
    found = integrated(normal)
    assert found.method == QUADRATURE
    assert off_by(found, normal) < 0.003


def test_a_wide_ridge_keeps_its_nodes_and_one_that_they_miss_has_draws() -> None:
    wide = integrated(Normal(0.97, (0.3, 0.2)), 36)
    assert wide.method == QUADRATURE
    assert off_by(wide, Normal(0.97, (0.3, 0.2))) < 1e-3
    assert integrated(RIDGES[0]).method == DRAWS


@dataclass(frozen=True)
class HeavyTails:
    """A narrow peak of (ln kappa, r) with the tails of Student's t, over the whole prior."""

    sd: tuple[float, float] = (0.1, 0.003)
    freedom: float = 3.0

    def log_prob(self, theta: Array) -> Array:
        """(m,) at theta (m, 2)"""
        off = np.stack([np.log(theta[:, 0] / 0.03) + 0.5 * theta[:, 1], theta[:, 1] - 0.437], 1)
        value: Array = -(
            0.5 * (self.freedom + 5.0) * np.log1p(np.sum((off / self.sd) ** 2, 1) / self.freedom)
        )
        return value


WIDE = Marginal("log_uniform", 1e-4, 1.0)


@pytest.mark.parametrize(
    ("kappa", "own"),
    [(PRIOR.kappa, HeavyTails()), (WIDE, HeavyTails((0.03, 0.15), 4.0))],
    ids=["outer", "inner"],
)
def test_a_peak_between_the_nodes_whose_tails_reach_the_box_is_found(
    kappa: Marginal, own: HeavyTails
) -> None:
    """Of the second fewer nodes of ln kappa agreed by chance: 0.29 off, 0.06 stated."""
    prior = Prior(kappa, PRIOR.r, law="mooney-rivlin-2")
    posterior = Posterior(prior, cast("Likelihood", own))
    found = integrate(posterior)
    low, high = prior.bounds.T
    # The midpoint rule on squares of a tenth of the peak's width and less.
    sides = [np.linspace(a, b, n + 1) for a, b, n in zip(low, high, (4000, 4000), strict=True)]
    lines = [0.5 * (side[1:] + side[:-1]) for side in sides]
    mass, moment = 0.0, np.zeros(3)
    for value in lines[0]:
        theta = np.column_stack([np.full(4000, np.exp(value)), lines[1]])
        weights = np.exp(own.log_prob(theta))
        mass += weights.sum()
        moment += [weights.sum() * value, weights @ lines[1], weights @ lines[1] ** 2]
    mean, sd = moment[1] / mass, np.sqrt(moment[2] / mass - (moment[1] / mass) ** 2)
    assert abs(found.log_evidence - np.log(mass / 4000**2)) < 4.0 * found.log_evidence_error
    assert found.log_evidence_error < 0.01
    assert abs(found.mean[1] - mean) < 0.03 * sd
    assert found.sd[1] == pytest.approx(sd, rel=0.03)
