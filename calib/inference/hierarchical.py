"""Joint density of a population of samples: its constants, each sample's, and the common errors.

Given all constants the data are normal, so that the common errors z ~ N(0, I) (of mesh, emulator,
load cell; `calib.inference.condensed`) are integrated out where the population moves, and drawn
where single samples do: given population and z, samples are independent of each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import expit, log_expit, logit

from calib.inference.condensed import CondensedSamples, White
from calib.inference.coordinates import theta_of
from calib.inference.population import Population
from calib.inference.prior import Prior
from fe.response import Array


class CommonErrors(NamedTuple):
    """Normal posterior of the common errors given all constants, and the data's density."""

    log_prob: Array
    """(m,) ln density of the data, common errors integrated out; -inf where not finite"""
    mean: Array
    """(m, q)"""
    root: Array
    """(m, q, q) upper triangular R with R^T R the precision"""

    def draw(self, rng: np.random.Generator) -> Array:
        """(m, q) one draw of each."""
        white = rng.standard_normal(self.mean.shape)
        return self.mean + np.linalg.solve(self.root, white[..., None])[..., 0]


@dataclass(frozen=True)
class HierarchicalPosterior:
    """Prior of a population times the likelihood of its samples."""

    population: Population
    samples: CondensedSamples

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return len(self.samples.names)

    def white(self, x: Array, tau: Array, v: Array) -> White:
        """Residuals of the samples, with the population at x (m, d), tau (m, c), v (m, n, c)."""
        return self.samples.white(theta_of(self.population.samples(x, tau, v)))

    def common_errors(self, white: White) -> CommonErrors:
        """What residuals of all samples say of the errors that they share."""
        m, _, _, q = white.factor.shape
        factor = white.factor.reshape(m, -1, q)
        residual = white.residual.reshape(m, -1)
        good = np.asarray(np.isfinite(residual).all(axis=1))
        good = good & np.asarray(np.isfinite(factor).all(axis=(1, 2)))
        factor = np.where(good[:, None, None], factor, 0.0)
        residual = np.where(good[:, None], residual, 0.0)
        turned = factor.transpose(0, 2, 1)
        precision = np.eye(q) + turned @ factor
        lower = np.asarray(np.linalg.cholesky(precision), dtype=np.float64)
        pull = np.linalg.solve(lower, turned @ residual[:, :, None])
        root = lower.transpose(0, 2, 1)
        mean = np.asarray(np.linalg.solve(root, pull)[..., 0], dtype=np.float64)
        logdet = 2.0 * np.log(np.diagonal(lower, axis1=1, axis2=2)).sum(axis=1)
        misfit = (residual**2).sum(axis=1) - (pull[..., 0] ** 2).sum(axis=1) + logdet
        value = np.where(good, self.samples.log_norm - 0.5 * misfit, -np.inf)
        return CommonErrors(value, mean, root)

    def sample_log_prob(self, white: White, z: Array) -> Array:
        """(m, n) ln density of each sample given common errors z (m, q), up to constants."""
        left = white.residual - np.einsum("mnpq,mq->mnp", white.factor, z)
        value = -0.5 * (left**2).sum(axis=2)
        found: Array = np.where(np.isfinite(value), value, -np.inf)
        return found


@dataclass(frozen=True)
class Pooled:
    """The same without any scatter between samples, for starts: a density of x alone."""

    posterior: HierarchicalPosterior

    @property
    def prior(self) -> Prior:
        """Of x."""
        return self.posterior.population.prior

    def log_prob(self, x: Array) -> Array:
        """(m,) unnormalised log density at x (m, d); -inf outside the prior's box."""
        value = self.prior.log_prob(x)
        inside = np.flatnonzero(value > -np.inf)
        n = self.posterior.n_samples
        for rows in np.array_split(inside, max(1, inside.size * n // 4096)):
            every = np.repeat(x[rows, None], n, axis=1)
            white = self.posterior.samples.white(theta_of(every))
            value[rows] += self.posterior.common_errors(white).log_prob
        return value


@dataclass(frozen=True)
class Globals:
    """Coordinates in which walkers move: logit of x's place in the prior's box, and ln tau."""

    population: Population

    @cached_property
    def _box(self) -> tuple[Array, Array]:
        low, high = self.population.prior.bounds.T
        return low, high

    def of(self, x: Array, tau: Array) -> Array:
        """(m, d + c) y; x on a bound is moved inside by 1e-9 of the box."""
        low, high = self._box
        place = np.clip((x - low) / (high - low), 1e-9, 1.0 - 1e-9)
        return np.concatenate([logit(place), np.log(tau)], axis=1)

    def split(self, y: Array) -> tuple[Array, Array]:
        """X (m, d) and tau (m, c) of y (m, d + c)."""
        low, high = self._box
        d = len(low)
        return low + (high - low) * expit(y[:, :d]), np.exp(y[:, d:])

    def log_prior(self, y: Array) -> Array:
        """(m,) log density of the priors with respect to y."""
        x, tau = self.split(y)
        place = y[:, : x.shape[1]]
        jacobian = (log_expit(place) + log_expit(-place)).sum(axis=1)
        value: Array = self.population.log_prior(x, tau) + jacobian
        return value
