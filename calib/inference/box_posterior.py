"""A posterior over a box of any dimension: samples by emcee, evidence by importance sampling."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import emcee
import numpy as np
from scipy.special import expit, log_expit, logit, logsumexp
from scipy.stats import multivariate_t

from calib.inference.ensemble import ensemble_sampler
from fe.response import Array

TAIL = 5
"""degrees of freedom of the proposal: tails heavier than those of the target"""


class BoxSamples(NamedTuple):
    """Draws of one posterior with its evidence."""

    draws: Array
    """(n, d)"""
    log_evidence: float
    """ln of the integral of likelihood times prior"""
    log_evidence_sd: float
    """its Monte Carlo SD"""
    importance_ess: float
    """effective number of the importance draws behind it"""
    autocorrelation: float
    """longest integrated autocorrelation time of the chains, steps"""


def sample_box(
    log_likelihood: Callable[[Array], Array],
    bounds: Array,
    rng: np.random.Generator,
    *,
    n_walkers: int = 48,
    n_steps: int = 1500,
    n_importance: int = 8000,
) -> BoxSamples:
    """Posterior under a uniform prior on the box `bounds` (d, 2), by ln p(data | x) of x (m, d).

    Walkers move in the logit of the box, where there are no walls. The proposal of the evidence is
    a Student t around the draws there. Raises ValueError when no prior draw has a finite
    likelihood.
    """
    low, high = np.asarray(bounds, dtype=np.float64).T

    def target(y: Array) -> Array:
        value = log_likelihood(low + (high - low) * expit(y))
        value = value + (log_expit(y) + log_expit(-y)).sum(axis=1)
        return np.where(np.isfinite(value), value, -np.inf)

    prior = rng.uniform(low, high, (4000, low.size))
    start = target(logit((prior - low) / (high - low)))
    if not np.isfinite(start).any():
        raise ValueError("log_likelihood: finite at none of 4000 prior draws, expected some")
    best = np.argsort(-start, kind="stable")[:n_walkers]
    sampler = ensemble_sampler(n_walkers, low.size, target)
    legacy = np.random.RandomState(np.random.MT19937(rng.integers(2**63)))
    state = emcee.State(logit((prior[best] - low) / (high - low)), random_state=legacy.get_state())
    sampler.run_mcmc(state, n_steps, skip_initial_state_check=True)
    y = sampler.get_chain(discard=n_steps // 3, flat=True)
    memory = float(np.max(sampler.get_autocorr_time(discard=n_steps // 3, tol=0)))
    evidence = _evidence(target, y, rng, n_importance)
    return BoxSamples(low + (high - low) * expit(y), *evidence, memory)


def _evidence(
    target: Callable[[Array], Array], y: Array, rng: np.random.Generator, n: int
) -> tuple[float, float, float]:
    covariance = np.atleast_2d(np.cov(y, rowvar=False))
    proposal = multivariate_t(y.mean(axis=0), covariance, df=TAIL, seed=rng)
    drawn = np.reshape(proposal.rvs(n), (n, y.shape[1]))
    log_weight = target(drawn) - proposal.logpdf(drawn)
    total = float(logsumexp(log_weight))
    share = np.exp(log_weight - total)
    ess = float(1.0 / np.square(share).sum())
    relative = float(np.sqrt(max(1.0 / ess - 1.0 / n, 0.0)))
    return total - float(np.log(n)), relative, ess
