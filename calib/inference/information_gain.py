"""What an experiment that is not yet made would tell: its expected information gain, in nats.

The gain is the expected Kullback-Leibler divergence of the posterior after the experiment from the
knowledge before it (Lindley, Ann. Math. Stat. 27, 1956), which is the mutual information of
parameters and data. Pure NumPy; experiments are y = mean(x) + noise with a normal noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import logsumexp

from fe.response import Array


@dataclass(frozen=True)
class Gain:
    """An expected information gain with its Monte Carlo error."""

    mean: float
    """nats"""
    error: float
    """standard error of the mean, nats"""


@dataclass(frozen=True)
class NestedGain:
    """Nested Monte Carlo: the truth lies between the bounds, but for the standard error."""

    lower: Gain
    """with the drawn parameters among the inner ones: expected not above the truth"""
    upper: Gain
    """without them: expected not below it"""

    def agrees_with(self, gain: Gain, n_sd: float = 3.0) -> bool:
        """Whether a gain lies between the bounds, widened by so many standard errors."""
        low = self.lower.mean - n_sd * np.hypot(self.lower.error, gain.error)
        high = self.upper.mean + n_sd * np.hypot(self.upper.error, gain.error)
        return bool(low <= gain.mean <= high)


def laplace_gain(
    jacobian: Array,
    covariance: Array,
    prior_covariance: Array,
    n_draws: int | None = None,
    chain: float = np.inf,
) -> Gain:
    """Closed form of a linear experiment, averaged over draws of the parameters.

    0.5 ln |I + C J^T S^-1 J| with the parameters' covariance C (p, p), derivatives J (m, n, p) at m
    draws and the noise S (n, n). Exact when the mean is linear and the parameters are normal
    (Chaloner and Verdinelli, Stat. Sci. 10, 1995). Where C is that of `n_draws` independent draws,
    the error holds what this leaves open: the gain changes by 0.5 tr(A C^-1 dC) with A = K (I +
    K)^-1, K = C J^T S^-1 J, and dC is Wishart's, so that its variance is |A|^2 / (2 n_draws).
    Draws that are picked from a chain are no surer than all of it, which is worth `chain`
    independent ones.
    """
    root = np.linalg.cholesky(prior_covariance)
    white = solve_triangular(np.linalg.cholesky(covariance), _columns(jacobian @ root), lower=True)
    parts = white.reshape(len(covariance), len(jacobian), -1).transpose(1, 0, 2)
    information = np.einsum("mni,mnj->mij", parts, parts)
    whole = np.eye(len(root)) + information
    gain = _gain(0.5 * np.linalg.slogdet(whole)[1], chain)
    if n_draws is None:
        return gain
    told = np.linalg.solve(whole, information).mean(axis=0)
    open_sd = np.linalg.norm(told) * np.sqrt(0.5 / n_draws + 0.5 / chain)
    return replace(gain, error=float(np.hypot(gain.error, open_sd)))


def nested_gain(
    outer: Array,
    inner: Array,
    covariance: Array,
    rng: np.random.Generator,
    chain: float = np.inf,
) -> NestedGain:
    """Nested Monte Carlo, which needs neither linearity nor normal parameters.

    `outer` (N, n) and `inner` (M, n) are the means at draws of the parameters. Each outer one is
    measured once; its log density is held against the log of the average over the inner ones (Ryan,
    J. Comput. Graph. Stat. 12, 2003; bounds as in Foster et al. 2020). `chain` as in
    `laplace_gain`.
    """
    factor = np.linalg.cholesky(covariance)
    white = solve_triangular(factor, outer.T, lower=True).T
    others = solve_triangular(factor, inner.T, lower=True).T
    noise = rng.standard_normal(white.shape)
    measured = white + noise
    own = -0.5 * np.square(noise).sum(axis=1)
    squared = (
        np.square(measured).sum(axis=1)[:, None]
        - 2.0 * measured @ others.T
        + np.square(others).sum(axis=1)
    )
    density = -0.5 * squared
    without = logsumexp(density, axis=1) - np.log(len(inner))
    both = np.column_stack([density, own])
    including = logsumexp(both, axis=1) - np.log(len(inner) + 1)
    return NestedGain(lower=_gain(own - including, chain), upper=_gain(own - without, chain))


def _columns(parts: Array) -> Array:
    """(n, m p) of (m, n, p)."""
    return parts.transpose(1, 0, 2).reshape(parts.shape[1], -1)


def _gain(values: Array, chain: float) -> Gain:
    """Mean of values at draws from a chain that is worth so many independent ones."""
    error = values.std(ddof=1) * np.sqrt(1.0 / values.size + 1.0 / chain)
    return Gain(float(values.mean()), float(error))
