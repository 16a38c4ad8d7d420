"""Weighted posterior draws by importance sampling that adapts from the prior: cheap and checked.

For many small posteriors, each of which a chain would serve at a hundred times the cost. Proposals
are t distributions fitted to prior x likelihood^power, the power rising to one as far as the draws
allow (adaptive tempering as in sequential Monte Carlo, Del Moral, Doucet & Jasra, J. R. Stat. Soc.
B 68 (2006) 411): r and s in the logit of the prior's box, then ln kappa about a parabola in (r, s),
since the force ties kappa to these along a curved ridge. The last draws are weighted by the
posterior itself, so that the proposals decide the variance of what they say and not its mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit, gammaln, log_expit, logit

from calib.inference.posterior import Posterior
from fe.response import Array

DEGREES = 5.0
"""of freedom of the proposals' t distribution: tails heavier than those of a posterior in a box"""
WIDER = 1.1
"""proposals' scale over that of what they are fitted to"""
FEWEST = 0.15
"""share of the draws of a round that must be effective for the power to rise so far"""
MAX_ROUNDS = 40
LEAST_POWER = 1e-9


@dataclass(frozen=True)
class WeightedDraws:
    """Draws of x = (ln kappa, r, s) that stand for the posterior by their weights."""

    x: Array
    """(n, 3)"""
    weights: Array
    """(n,) summing to 1"""
    log_evidence: float
    """ln of the integral of prior times likelihood"""

    @property
    def ess(self) -> float:
        """Effective number of draws, 1 / sum of squared weights."""
        return float(1.0 / np.sum(self.weights**2))

    @property
    def mean(self) -> Array:
        """(3,) posterior mean"""
        mean: Array = self.weights @ self.x
        return mean

    @property
    def sd(self) -> Array:
        """(3,) posterior SD"""
        sd: Array = np.sqrt(self.weights @ (self.x - self.mean) ** 2)
        return sd

    def below(self, value: Array) -> Array:
        """(3,) posterior probability that each coordinate is below that of `value` (3,)."""
        # Rounding may take a sum of weights above one.
        below: Array = np.minimum(self.weights @ (self.x < value), 1.0)
        return below


@dataclass(frozen=True)
class _Student:
    """Multivariate t distribution."""

    mean: Array
    factor: Array
    """(d, d) lower Cholesky factor of its scale"""

    def sample(self, rng: np.random.Generator, n: int) -> Array:
        """(n, d) draws."""
        radius = np.sqrt(DEGREES / rng.chisquare(DEGREES, n))
        white = rng.standard_normal((n, self.mean.size))
        drawn: Array = self.mean + radius[:, None] * (white @ self.factor.T)
        return drawn

    def log_density(self, y: Array) -> Array:
        """(n,) at y (n, d)."""
        d = self.mean.size
        white = np.linalg.solve(self.factor, (y - self.mean).T)
        norm = gammaln(0.5 * (DEGREES + d)) - gammaln(0.5 * DEGREES)
        norm -= 0.5 * d * np.log(DEGREES * np.pi) + np.log(np.diag(self.factor)).sum()
        density: Array = norm - 0.5 * (DEGREES + d) * np.log1p(np.sum(white**2, axis=0) / DEGREES)
        return density


@dataclass(frozen=True)
class _Proposal:
    """Of (r, s), then of ln kappa given these."""

    bounds: Array
    """(3, 2) the prior's box"""
    ratios: _Student
    """of the logit of (r, s)"""
    ridge: Array
    """(6,) coefficients of ln kappa over (r, s)"""
    across: _Student
    """of ln kappa minus the ridge"""

    def sample(self, rng: np.random.Generator, n: int) -> tuple[Array, Array]:
        """Draws of x (n, 3) and their log density."""
        low, high = self.bounds[1:].T
        y = self.ratios.sample(rng, n)
        ratios = low + (high - low) * expit(y)
        off = self.across.sample(rng, n)
        ln_kappa = _features(ratios) @ self.ridge + off[:, 0]
        # Where a draw is out of the box it weighs nothing; far out, exp(ln kappa) would overflow.
        ln_kappa = np.clip(ln_kappa, self.bounds[0, 0] - 1.0, self.bounds[0, 1] + 1.0)
        x = np.column_stack([ln_kappa, ratios])
        by_y = np.sum(np.log(high - low) + log_expit(y) + log_expit(-y), axis=1)
        return x, self.ratios.log_density(y) - by_y + self.across.log_density(off)


def draw_weighted(
    posterior: Posterior, rng: np.random.Generator, n: int = 4096, *, n_round: int = 1024
) -> WeightedDraws:
    """`n` weighted draws of the posterior; read `ess` before use.

    Raises ValueError when no prior draw has a finite posterior or the power does not reach one in
    40 rounds, as with modes far apart.
    """
    x = posterior.prior.sample(rng, 2 * n_round)
    log_density = posterior.prior.log_prob(x) - posterior.prior.log_share
    power = LEAST_POWER
    for _ in range(MAX_ROUNDS):
        log_prior = posterior.prior.log_prob(x)
        inside = np.flatnonzero(log_prior > -np.inf)
        x, log_prior, log_density = x[inside], log_prior[inside], log_density[inside]
        log_likelihood = posterior.log_prob(x) - log_prior
        log_weight = log_prior - log_density
        power = _power(log_weight, log_likelihood, FEWEST * n_round, power)
        weights = _normalised(log_weight + power * log_likelihood)[0]
        proposal = _fit(posterior.prior.bounds, x, weights)
        if power == 1.0:
            break
        x, log_density = proposal.sample(rng, n_round)
    else:
        raise ValueError(f"posterior: not reached from the prior in {MAX_ROUNDS} rounds")
    x, log_density = proposal.sample(rng, n)
    weights, total = _normalised(posterior.log_prob(x) - log_density)
    return WeightedDraws(x, weights, total - float(np.log(n)))


def _normalised(log_weight: Array) -> tuple[Array, float]:
    """Weights that sum to one and the logarithm of their sum before; -inf and NaN weigh nothing.

    Raises ValueError when nothing weighs anything.
    """
    safe = np.where(np.isfinite(log_weight), log_weight, -np.inf)
    peak = safe.max()
    if not np.isfinite(peak):
        raise ValueError("posterior: zero at all draws; check prior and forward model")
    weights = np.exp(safe - peak)
    total = weights.sum()
    return weights / total, float(peak + np.log(total))


def _power(log_weight: Array, log_likelihood: Array, fewest: float, least: float) -> float:
    """Largest power of the likelihood in [`least`, 1] that leaves `fewest` effective draws.

    `least`, of the round before, where there is none: the proposals are then fitted to it again.
    """
    finite = np.where(np.isfinite(log_likelihood), log_likelihood, -np.inf)

    def enough(power: float) -> bool:
        weights = _normalised(log_weight + power * finite)[0]
        return bool(1.0 / np.sum(weights**2) >= fewest)

    if enough(1.0):
        return 1.0
    low, high = np.log(least), 0.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if enough(np.exp(middle)) else (low, middle)
    return float(np.exp(low))


def _features(ratios: Array) -> Array:
    """(n, 6) terms of a parabola in (r, s)."""
    r, s = ratios.T
    return np.column_stack([np.ones_like(r), r, s, r * r, r * s, s * s])


def _fit(bounds: Array, x: Array, weights: Array) -> _Proposal:
    low, high = bounds[1:].T
    # A draw on a bound, as of a prior with an atom there in floating point, has no logit.
    y = logit(np.clip((x[:, 1:] - low) / (high - low), 1e-9, 1.0 - 1e-9))
    features, root = _features(x[:, 1:]), np.sqrt(weights)
    solved = np.linalg.lstsq(root[:, None] * features, root * x[:, 0], rcond=1e-10)[0]
    ridge = np.asarray(solved, dtype=np.float64)
    off = x[:, :1] - (features @ ridge)[:, None]
    return _Proposal(bounds, _fitted(y, weights), ridge, _fitted(off, weights))


def _fitted(y: Array, weights: Array) -> _Student:
    mean: Array = weights @ y
    off = y - mean
    covariance = np.einsum("n,ni,nj->ij", weights, off, off)
    covariance += 1e-12 * np.trace(covariance) * np.eye(len(mean))
    # A t distribution has degrees / (degrees - 2) times its scale as covariance.
    scale = WIDER**2 * (DEGREES - 2.0) / DEGREES * covariance
    return _Student(mean, np.linalg.cholesky(scale))
