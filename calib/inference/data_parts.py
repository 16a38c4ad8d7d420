"""A posterior given a part of the data only: forces, field, or both."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, cast

import numpy as np

from calib.inference.likelihood import Likelihood
from calib.inference.posterior import Posterior
from calib.inference.shared_error import marginal
from fe.response import Array

Part = Literal["force", "field", "both"]


@dataclass(frozen=True)
class FieldOnly:
    """Likelihood of the field alone, the errors it shares with the forces integrated out."""

    whole: Likelihood

    def log_prob(self, theta: Array) -> Array:
        """(m,) log-likelihood at theta (m, d); -inf where the forward model failed."""
        field = self.whole.field
        assert field is not None  # checked by `given`
        basis = self.whole.forward.field_basis
        if basis is not None and basis is not field.basis:
            field = field.with_basis(basis)
        sizes = self.whole.field_sizes(theta)
        return marginal([field.along(self.whole.predict(theta), None, sizes)])


def parts_of(posterior: Posterior) -> tuple[Part, ...]:
    """The parts that its data have."""
    return ("force",) if posterior.likelihood.field is None else ("force", "field", "both")


def given(posterior: Posterior, part: Part) -> Posterior:
    """The posterior given a part of its data.

    Raises ValueError for a field where there is none.
    """
    whole = posterior.likelihood
    if part == "both" or (part == "force" and whole.field is None):
        return posterior
    if part == "force":
        return replace(posterior, likelihood=replace(whole, field=None))
    if whole.field is None:
        raise ValueError("part: found 'field', expected 'force': the data hold no field")
    # A posterior asks its likelihood for `log_prob` alone when it is integrated or maximised.
    return replace(posterior, likelihood=cast("Likelihood", FieldOnly(whole)))


def log_likelihood(posterior: Posterior, x: Array) -> Array:
    """(m,) ln likelihood at x (m, d), -inf outside the prior's box."""
    prior = posterior.prior.log_prob(x)
    inside = np.isfinite(prior)
    value = np.full(len(x), -np.inf)
    if inside.any():
        value[inside] = posterior.log_prob(x[inside]) - prior[inside]
    return value
