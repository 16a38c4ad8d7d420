"""Forces with Student-t errors: one unknown scale of all their own errors, integrated out.

With weights w ~ chi^2_nu / nu and residuals r ~ N(0, C / w) given w, r is multivariate t of nu
degrees with the scale matrix C (Kotz & Nadarajah, Multivariate t Distributions, 2004, 1.1). The
errors shared with a field stay normal, so w cannot be integrated in closed form; given w all is
the parabola of `calib.inference.shared_error` again. The integral over ln w is a trapezoidal sum,
which converges geometrically for such integrands: to 1e-9 with these nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import gammaln, logsumexp

from calib.inference.shared_error import AlongError, SharedPosterior, marginal, shared_posterior
from fe.response import Array

N_NODES = 96
LEFT_OUT = 36.0
"""what is left out at both ends of the nodes is exp(-36) of the highest integrand"""
LARGEST = 4.0
"""beyond the highest integrand, ln w: there exp(w) has ended all of it, whatever the freedom"""


class ForceDensity(NamedTuple):
    """Log normal density of n forces along the shared errors, and its misfit at none of them."""

    along: AlongError
    misfit: Array
    """(m,) r^T C^-1 r"""
    n: int

    def misfit_at(self, z: Array) -> Array:
        """(m,) misfit at shared errors z (m, q)."""
        along = self.along
        bent = np.einsum("mi,ijm,mj->m", z, along.curvature, z)
        at: Array = self.misfit - 2.0 * np.einsum("im,mi->m", along.slope, z) + bent
        return at

    def at(self, weight: Array) -> AlongError:
        """With the covariance C / weight, weights (m,)."""
        change = 0.5 * (self.n * np.log(weight) - (weight - 1.0) * self.misfit)
        return AlongError(
            self.along.value + change, weight * self.along.slope, weight * self.along.curvature
        )


def student_marginal(force: ForceDensity, others: Sequence[AlongError], freedom: float) -> Array:
    """(m,) ln density of the forces, Student-t of `freedom` degrees, and of the other parts."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        _, terms = _terms(force, others, freedom)
        total: Array = logsumexp(terms, axis=0)
    return np.where(np.isfinite(total), total, -np.inf)


def student_shared_posterior(
    force: ForceDensity, others: Sequence[AlongError], freedom: float
) -> SharedPosterior:
    """Mean and covariance of the shared errors given parameters: a mixture over the weights."""
    log_weights, terms = _terms(force, others, freedom)
    shares = np.exp(terms - logsumexp(terms, axis=0))
    given = [shared_posterior([force.at(np.exp(u)), *others]) for u in log_weights]
    mean = sum(p[:, None] * each.mean for p, each in zip(shares, given, strict=True))
    second = sum(
        p[:, None, None] * (each.covariance + each.mean[:, :, None] * each.mean[:, None, :])
        for p, each in zip(shares, given, strict=True)
    )
    return SharedPosterior(mean, second - mean[:, :, None] * mean[:, None, :])


def _terms(
    force: ForceDensity, others: Sequence[AlongError], freedom: float
) -> tuple[Array, Array]:
    """Nodes ln w (k, m), and the logarithms (k, m) of the sum's terms there."""
    # Given the shared errors the integrand is w^shape exp(-rate w), highest at shape / rate; what
    # the shared errors may take off the misfit is at most all of it. A small weight leaves them
    # where the other parts have them, and there the misfit may be larger than at none.
    shape = 0.5 * (freedom + force.n)
    wide = np.sqrt(2.0 * LEFT_OUT / shape)
    left = min(1.0 + LEFT_OUT / shape, wide * (1.0 + wide / 3.0))
    misfit = force.misfit
    if others:
        misfit = np.fmax(misfit, force.misfit_at(shared_posterior(others).mean))
    low = np.log(shape / (0.5 * (freedom + misfit))) - left
    high = np.full_like(low, np.log(shape / (0.5 * freedom)) + min(LARGEST, wide))
    nodes = np.linspace(low, high, N_NODES)
    step = (high - low) / (N_NODES - 1)
    half = 0.5 * freedom
    constant = half * np.log(half) - gammaln(half) + np.log(step)
    terms = [
        marginal([force.at(np.exp(u)), *others]) + half * (u - np.exp(u)) + constant for u in nodes
    ]
    return nodes, np.array(terms)


def student_weights(freedom: float | None, n: int, rng: np.random.Generator) -> Array:
    """(n,) draws of the weights w; ones for normal errors."""
    if freedom is None:
        return np.ones(n)
    drawn: Array = rng.chisquare(freedom, n) / freedom
    return drawn


def information_share(freedom: float | None, n: int) -> float:
    """Fisher information of the location of n Student-t forces over that of normal ones.

    (nu + n) / (nu + n + 2): Lange, Little & Taylor, J. Am. Stat. Assoc. 84 (1989) 881, appendix B.
    """
    return 1.0 if freedom is None else (freedom + n) / (freedom + n + 2.0)
