"""Profiles where the support is no box: priors of the constants end elsewhere for every ratio."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
import pytest
from scipy.stats import chi2, norm

from calib.inference import Marginal, Posterior, Prior
from calib.inference.likelihood import Likelihood
from calib.inference.minimise import gradient
from calib.inference.prior import hull_of
from calib.inference.profile import Profile, profile_likelihood
from fe.response import Array

EACH = Marginal("uniform", 0.002, 0.02)
BOX = hull_of((EACH, EACH))
PRIOR = Prior(BOX[0], BOX[1], law="mooney-rivlin-2", of=(EACH, EACH))
SHARE = 0.05
LIMIT = 0.5 * chi2.ppf(0.95, 1)


@dataclass(frozen=True)
class Stiffness:
    """Data that know kappa (1 + r / 2) to a share of it."""

    known: float

    def log_prob(self, theta: Array) -> Array:
        """(m,) at theta (m, 2)"""
        off = theta[:, 0] * (1.0 + 0.5 * theta[:, 1]) / self.known - 1.0
        value: Array = -0.5 * (off / SHARE) ** 2
        return value


def exact(known: float) -> tuple[float, float]:
    """Interval of r: for each the kappa that is best where both constants are possible."""
    r = np.linspace(*PRIOR.bounds[1], 100_001)
    low = np.maximum(EACH.low / (1.0 - r), EACH.low / r)
    high = np.minimum(EACH.high / (1.0 - r), EACH.high / r)
    kappa = np.clip(known / (1.0 + 0.5 * r), low, high)
    height = Stiffness(known).log_prob(np.column_stack([kappa, r]))
    height[low > high] = -np.inf
    kept = r[height >= height.max() - LIMIT]
    return float(kept[0]), float(kept[-1])


def profile(known: float, best: Array) -> Profile:
    posterior = Posterior(PRIOR, cast("Likelihood", Stiffness(known)))
    return profile_likelihood(posterior, 1, best, np.array([0.06, 0.1]))


@pytest.mark.parametrize("known", [0.036, 0.046])
def test_the_interval_of_a_ratio_under_priors_of_the_constants_is_the_exact_one(
    known: float,
) -> None:
    found = profile(known, np.array([np.log(known / 1.26), 0.52]))
    assert found.interval == pytest.approx(exact(known), abs=0.005)
    assert found.open_ends == (False, False)


def test_an_interval_that_ends_with_the_support_is_open_and_reaches_there() -> None:
    # Every value of r has a kappa that fits: at the ends of r one point is left.
    known = 0.022 * 1.25
    found = profile(known, np.array([np.log(0.022), 0.5]))
    ends = exact(known)
    assert found.interval == pytest.approx(ends, abs=0.005)
    wide = Profile(found.values, np.where(np.isfinite(found.log_likelihood), 0.0, -np.inf))
    assert wide.open_ends == (True, True)
    assert wide.interval == pytest.approx(tuple(PRIOR.bounds[1]), abs=0.005)


def test_slopes_next_to_a_wall_are_those_of_the_side_that_is_possible() -> None:
    def density(x: Array) -> Array:
        value = np.sin(x[:, 0]) + x[:, 1] ** 2
        return np.where(x[:, 0] <= 1.0, value, -np.inf)

    wide = np.array([[-9.0, 9.0], [-9.0, 9.0]])
    at = np.array([1.0 - 1e-4, 0.5])
    slope = gradient(density, at, wide, np.ones(2))
    assert slope == pytest.approx([np.cos(at[0]), 1.0], abs=1e-4)


@dataclass(frozen=True)
class TwoModes:
    """Equally good at two places of (r, s)."""

    modes: tuple[tuple[float, float], ...] = ((0.4, 0.1), (0.5, 0.4))
    sd: float = 0.03

    def log_prob(self, theta: Array) -> Array:
        """(m,) at theta (m, 3)"""
        each = [-0.5 * np.sum(((theta[:, 1:] - m) / self.sd) ** 2, axis=1) for m in self.modes]
        return np.logaddexp(*each) - 0.5 * (np.log(theta[:, 0] / 0.02) / 0.05) ** 2


THREE = Prior(
    Marginal("log_uniform", 0.002, 0.2),
    Marginal("uniform", 0.0, 1.0),
    Marginal("uniform", 0.0, 0.5),
)


def test_a_profile_has_the_second_mode_too() -> None:
    posterior = Posterior(THREE, cast("Likelihood", TwoModes()))
    best, sd = np.array([np.log(0.02), 0.4, 0.1]), np.array([0.05, 0.03, 0.03])
    low, high = profile_likelihood(posterior, 1, best, sd).interval
    reach = 0.03 * np.sqrt(2.0 * LIMIT)
    # The far end is between values 0.05 apart, on a straight line.
    assert (low, high) == pytest.approx((0.4 - reach, 0.5 + reach), abs=5e-3)


def test_a_profile_has_narrow_modes_where_the_posterior_is_told_to_be() -> None:
    """Between the values of the even grid, and far from the mean."""
    modes = TwoModes(((0.123, 0.1), (0.871, 0.4)), 0.004)
    posterior = Posterior(THREE, cast("Likelihood", modes))
    best, sd = np.array([np.log(0.02), 0.497, 0.25]), np.array([0.05, 0.374, 0.15])
    away = 0.004 * norm.ppf([0.02, 0.1, 0.32, 0.6, 0.98])
    likely = np.concatenate([0.123 + away, 0.871 + away])
    found = profile_likelihood(posterior, 1, best, sd, likely=likely)
    reach = 0.004 * np.sqrt(2.0 * LIMIT)
    ends = [0.123 - reach, 0.123 + reach, 0.871 - reach, 0.871 + reach]
    assert len(found.intervals) == 2
    assert np.ravel(found.intervals) == pytest.approx(ends, abs=0.002)
