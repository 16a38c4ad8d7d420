"""Evidence and moments by adaptive importance sampling, for more unknowns than a grid can have.

Draws of the prior are weighed by the posterior; a mixture of t kernels is laid over the heaviest
ones and drawn from, until the weights are even (population Monte Carlo, Cappe et al., J. Comput.
Graph. Stat. 13 (2004) 907). Weights are tempered while few draws carry them. The answer comes from
last draws alone, which none of their own kernels was made of: their mean weight is an unbiased
evidence, and its scatter is the error. Where too few of them carry the weight, they make kernels
for others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.distance import cdist
from scipy.special import gammaln, logsumexp

from fe.response import Array

LogDensity = Callable[[Array], Array]

N_FIRST = 8192
"""draws of the prior"""
N_ROUND = 4096
N_LAST = 40_000
N_KERNELS = 256
USUAL_ROUNDS = 20
MAX_ROUNDS = 60
"""while weights are tempered"""
FREEDOM = 8.0
"""of the t kernels: heavier tails than the posterior's"""
EVEN = 0.15
"""effective share of a round's draws at which the kernels are good enough"""
FEWEST = 200.0
"""effective draws that a tempering must leave, and the last draws have"""
LAST_ROUNDS = 8
"""in which kernels are made anew of last draws that have not"""
WIDE = 0.15
"""share of the draws from one wide kernel, so that no weight is huge"""
CHUNK = 4096


class NotReached(ValueError):  # noqa: N818 - says what happened
    """Too few draws carry the weight for an answer."""


class Weighed(NamedTuple):
    """Draws y (n, d), ln weights (n,) that sum to the evidence, and the relative SD of that."""

    y: Array
    log_weights: Array
    error: float


@dataclass(frozen=True)
class _Kernels:
    """Mixture of equal t kernels about `centres` and one wide kernel about their mean."""

    centres: Array
    """(k, d)"""
    factor: Array
    """(d, d) lower Cholesky factor of the scale of a kernel"""
    mean: Array
    wide: Array
    """(d, d) factor of the wide kernel"""

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """(n, d) draws."""
        d = self.mean.size
        wide = rng.random(n) < WIDE
        chosen = self.centres[rng.integers(len(self.centres), size=n)]
        normal = rng.standard_normal((n, d))
        spread = np.sqrt(FREEDOM / rng.chisquare(FREEDOM, n))[:, None]
        near = chosen + spread * (normal @ self.factor.T)
        far = self.mean + spread * (normal @ self.wide.T)
        return np.where(wide[:, None], far, near)

    def log_density(self, y: Array) -> Array:
        """(n,) of the mixture at y (n, d)."""
        parts = [self._of(part) for part in np.array_split(y, max(1, len(y) // CHUNK))]
        return np.concatenate(parts)

    def _of(self, y: Array) -> Array:
        white = np.linalg.solve(self.factor, y.T).T
        centres = np.linalg.solve(self.factor, self.centres.T).T
        near = _log_t(cdist(white, centres, "sqeuclidean"), self.factor)
        off = np.linalg.solve(self.wide, (y - self.mean).T)
        far = _log_t(np.sum(off**2, axis=0), self.wide)
        mixed = logsumexp(near, axis=1) - np.log(len(self.centres))
        both: Array = np.logaddexp(np.log1p(-WIDE) + mixed, np.log(WIDE) + far)
        return both


def _log_t(squared: Array, factor: Array) -> Array:
    d = len(factor)
    constant = gammaln(0.5 * (FREEDOM + d)) - gammaln(0.5 * FREEDOM)
    constant -= 0.5 * d * np.log(FREEDOM * np.pi) + np.log(np.diag(factor)).sum()
    density: Array = constant - 0.5 * (FREEDOM + d) * np.log1p(squared / FREEDOM)
    return density


def importance_sample(
    log_density: LogDensity,
    first: Array,
    log_first: Array,
    rng: np.random.Generator,
    n: int = N_LAST,
) -> Weighed:
    """Weighed draws of a density in d unbounded coordinates, known up to its integral.

    `first` (k, d) are draws of a density that covers it and `log_first` (k,) that density at them;
    log_density takes (m, d) to (m,), -inf where it is zero.
    Raises ValueError when it is zero at all first draws, and NotReached when so few of the last
    ones carry the weight that the density was not reached.
    """
    y, value = first, log_density(first)
    if not np.isfinite(value).any():
        raise ValueError(
            f"posterior: zero at all of {len(first)} prior draws; check prior and forward model"
        )
    log_weights = np.where(np.isfinite(value), value - log_first, -np.inf)
    for done in range(1, MAX_ROUNDS + 1):
        weights, power = _tempered(log_weights)
        kernels = _kernels(y, weights, rng)
        y = kernels.draw(N_ROUND, rng)
        log_weights = _log_weights(log_density, kernels, y)
        even = _effective(log_weights) > EVEN * N_ROUND
        if power == 1.0 and (even or done >= USUAL_ROUNDS):
            break
    y = kernels.draw(n, rng)
    log_weights = _log_weights(log_density, kernels, y)
    for _ in range(LAST_ROUNDS):  # many draws find what few have missed, as a corner of a ridge
        if _effective(log_weights) >= FEWEST or not np.isfinite(log_weights).any():
            break
        kernels = _kernels(y, _tempered(log_weights)[0], rng)
        y = kernels.draw(n, rng)
        log_weights = _log_weights(log_density, kernels, y)
    if not _effective(log_weights) >= FEWEST:
        raise NotReached(
            f"posterior: not reached from the prior in {done} rounds of draws; expected priors "
            "that leave it more of their box"
        )
    relative = np.exp(log_weights - log_weights.max())
    error = float(relative.std() / relative.mean() / np.sqrt(n))
    return Weighed(y, log_weights - np.log(n), error)


def _log_weights(log_density: LogDensity, kernels: _Kernels, y: Array) -> Array:
    value = log_density(y)
    return np.where(np.isfinite(value), value - kernels.log_density(y), -np.inf)


def _effective(log_weights: Array) -> float:
    weights = np.exp(log_weights - log_weights.max())
    return float(weights.sum() ** 2 / np.sum(weights**2))


def _tempered(log_weights: Array) -> tuple[Array, float]:
    """Weights to the largest power up to 1 that leaves enough effective draws, normalised."""
    low, high = 0.0, 1.0
    if _effective(log_weights) < FEWEST:
        for _ in range(40):
            middle = 0.5 * (low + high)
            scaled = np.where(np.isfinite(log_weights), middle * log_weights, -np.inf)
            low, high = (middle, high) if _effective(scaled) >= FEWEST else (low, middle)
        high = low
    finite = np.isfinite(log_weights)
    powered = np.full(log_weights.shape, -np.inf)
    powered[finite] = high * (log_weights[finite] - log_weights[finite].max())
    weights = np.exp(powered)
    return weights / weights.sum(), high


def _kernels(y: Array, weights: Array, rng: np.random.Generator) -> _Kernels:
    """Kernels about draws chosen by weight, as wide as Silverman's rule has it."""
    d = y.shape[1]
    mean = weights @ y
    off = y - mean
    covariance = (weights[:, None] * off).T @ off
    covariance += 1e-10 * np.trace(covariance) / d * np.eye(d) + 1e-12 * np.eye(d)
    factor: Array = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    width = (4.0 / (N_KERNELS * (d + 2.0))) ** (1.0 / (d + 4.0))
    centres = y[rng.choice(len(y), N_KERNELS, p=weights)]
    return _Kernels(centres, width * factor, mean, 1.5 * factor)
