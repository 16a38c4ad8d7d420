"""Log posterior in x = (ln kappa, r, s, ...), vectorised, finite inside the prior's box."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from calib.inference.coordinates import theta_of
from calib.inference.forward import ForwardModel
from calib.inference.likelihood import Likelihood
from calib.inference.prior import Prior
from fe.response import Array

# Rows evaluated at once: the working arrays of this many stay in the processor's cache.
BATCH = 1024


class Density(Protocol):
    """A density of x with a prior to start from."""

    @property
    def prior(self) -> Prior:
        """Of x."""

    def log_prob(self, x: Array) -> Array:
        """(m,) unnormalised log density at x (m, n)."""


@dataclass(frozen=True)
class Posterior:
    """Prior times likelihood."""

    prior: Prior
    likelihood: Likelihood

    def log_prob(self, x: Array) -> Array:
        """(m,) unnormalised log density with respect to x (m, n); -inf outside the prior's box.

        The likelihood is not evaluated outside. Raises ValueError when x has another shape.
        """
        n = self.prior.space.size
        if x.ndim != 2 or x.shape[1] != n:
            raise ValueError(f"x: expected shape (m, {n}), found {x.shape}")
        value = self.prior.log_prob(x)
        inside = np.flatnonzero(value > -np.inf)
        for start in range(0, inside.size, BATCH):
            rows = inside[start : start + BATCH]
            value[rows] += self.likelihood.log_prob(theta_of(x[rows]))
        return value

    def with_forward(self, forward: ForwardModel) -> Posterior:
        """The same posterior with another forward model."""
        return replace(self, likelihood=self.likelihood.with_forward(forward))
