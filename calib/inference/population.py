"""A population of samples: how the constants of single samples scatter about their population's.

Of the coordinates x = (ln kappa, r, s, ...) some differ from sample to sample, x_i ~ N(m, tau^2)
cut off at the prior's box and independent of each other; the others are common to all samples. m
and what is common have the study's prior, tau a half-normal or half-t one (Gelman, Bayesian Anal. 1
(2006) 515). A sample is written by v_i ~ N(0, 1), x_i being the normal's quantile at Phi(v_i): v_i
is a priori independent of m and tau, and x_i never leaves the box.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.special import gammaln, log_ndtr, ndtr, ndtri
from scipy.stats import t as student_t

from calib.inference.prior import Prior
from fe.response import Array

LEAST = 1e-9
"""SD between samples, over its prior's size, below which it is not looked for"""


@dataclass(frozen=True)
class ScatterPrior:
    """Prior of an SD between samples: half of a normal, or of a Student-t, about zero.

    Raises ValueError when a value is impossible.
    """

    size: float
    """scale of the distribution, in the unit of the coordinate"""
    freedom: float | None = None
    """degrees of freedom of the t; None is normal"""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.size) and self.size > 0):
            raise ValueError(f"size: expected a positive number, got {self.size}")
        if self.freedom is not None and not self.freedom > 0:
            raise ValueError(f"freedom: expected a positive number, got {self.freedom}")

    def log_density(self, tau: Array) -> Array:
        """Log density with respect to tau > 0."""
        z = tau / self.size
        if self.freedom is None:
            value: Array = 0.5 * np.log(2.0 / np.pi) - np.log(self.size) - 0.5 * z**2
            return value
        nu = self.freedom
        norm = gammaln(0.5 * (nu + 1)) - gammaln(0.5 * nu) - 0.5 * np.log(nu * np.pi)
        tail: Array = np.log(2.0 / self.size) + norm - 0.5 * (nu + 1) * np.log1p(z**2 / nu)
        return tail

    def quantile(self, probability: Array) -> Array:
        """Tau below which the given probability lies."""
        upper = 0.5 * (1.0 + np.asarray(probability))
        at = ndtri(upper) if self.freedom is None else student_t.ppf(upper, self.freedom)
        value: Array = self.size * at
        return value


@dataclass(frozen=True)
class Population:
    """What differs between samples, and the priors of all.

    Raises ValueError when nothing differs, or something that is no unknown of the forward model.
    """

    prior: Prior
    """of the population's constants and of what is common"""
    scatter: Mapping[str, ScatterPrior]
    """parameter -> prior of its SD between samples: of ln kappa (and of what x holds the logarithm
    of), else of the parameter itself"""

    def __post_init__(self) -> None:
        names = self.prior.space.names[: self.prior.space.n_forward]
        if not self.scatter or not set(self.scatter) <= set(names):
            found = ", ".join(self.scatter) or "nothing"
            raise ValueError(f"scatter: expected some of {', '.join(names)}, found {found}")
        if self.prior.errors:
            unknown = ", ".join(u.name for u, _ in self.prior.errors)
            raise ValueError(
                f"prior: sizes of the errors ({unknown}) are unknown, expected known ones where "
                "samples are taken one by one"
            )

    @cached_property
    def columns(self) -> npt.NDArray[np.intp]:
        """(c,) coordinates of x that differ between samples, in order."""
        names = self.prior.space.names
        return np.array([i for i, name in enumerate(names) if name in self.scatter], dtype=np.intp)

    @property
    def varying(self) -> tuple[str, ...]:
        """Names of the parameters that differ between samples."""
        return tuple(self.prior.space.names[i] for i in self.columns)

    @property
    def common(self) -> tuple[str, ...]:
        """Names of the parameters that all samples share."""
        return tuple(name for name in self.prior.space.names if name not in self.scatter)

    @cached_property
    def _box(self) -> tuple[Array, Array]:
        low, high = self.prior.bounds[self.columns].T
        return low, high

    def log_prior(self, x: Array, tau: Array) -> Array:
        """(m,) log density of population and common x (m, d), and of tau (m, c) by ln tau."""
        total = self.prior.log_prob(x)
        for column, name in enumerate(self.varying):
            at = tau[:, column]
            prior = self.scatter[name]
            density = prior.log_density(at) + np.log(at)
            # beyond, the density by ln tau is nothing and numbers lose their digits
            total = total + np.where(at > LEAST * prior.size, density, -np.inf)
        return total

    def samples(self, x: Array, tau: Array, v: Array) -> Array:
        """(m, n, d) coordinates of the samples, at x (m, d), tau (m, c) and v (m, n, c)."""
        low, high = self._box
        mean, scale = x[:, None, self.columns], tau[:, None]
        below, above = (low - mean) / scale, (high - mean) / scale
        # from the nearer end of the interval, so that tails keep their digits
        width = ndtr(above) - ndtr(below)
        left = ndtri(ndtr(below) + ndtr(v) * width)
        right = -ndtri(ndtr(-above) + ndtr(-v) * width)
        own = np.clip(mean + scale * np.where(v < 0, left, right), low, high)
        found = np.repeat(x[:, None], v.shape[1], axis=1)
        found[:, :, self.columns] = own
        return found

    def standard(self, x: Array, tau: Array, own: Array) -> Array:
        """(m, n, c) v of samples with the coordinates own (m, n, c); not finite where impossible.

        Inverse of `samples`.
        """
        low, high = self._box
        mean, scale = x[:, None, self.columns], tau[:, None]
        below, above, at = ((value - mean) / scale for value in (low, high, own))
        with np.errstate(divide="ignore", invalid="ignore"):
            width = ndtr(above) - ndtr(below)
            left = ndtri((ndtr(at) - ndtr(below)) / width)
            right = -ndtri((ndtr(-at) - ndtr(-above)) / width)
        v: Array = np.where(left < 0, left, right)
        return v

    def log_density(self, x: Array, tau: Array, own: Array) -> Array:
        """(m, c) sum over the samples of ln density of own (m, n, c), each coordinate by itself."""
        low, high = self._box
        mean, scale = x[:, None, self.columns], tau[:, None]
        below, above = (low - mean) / scale, (high - mean) / scale
        # of an interval far out in the upper tail the lower one keeps the digits
        flipped = below > 0
        first, last = np.where(flipped, -above, below), np.where(flipped, -below, above)
        log_last, log_first = log_ndtr(last), log_ndtr(first)
        mass = log_last + np.log1p(-np.exp(log_first - log_last))
        z = (own - mean) / scale
        each = -0.5 * z**2 - 0.5 * np.log(2.0 * np.pi) - np.log(scale) - mass
        total: Array = each.sum(axis=1)
        return total

    def draw_new(self, x: Array, tau: Array, rng: np.random.Generator) -> Array:
        """(m, d) coordinates of a new sample of the population for each draw."""
        v = rng.standard_normal((len(x), 1, len(self.columns)))
        return self.samples(x, tau, v)[:, 0]
