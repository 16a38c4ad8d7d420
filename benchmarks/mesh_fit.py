"""What errors of a mesh do to the constants: a truth without noise, fitted to first order.

By forces and field together, as in a likelihood, with the zero of the travel that both share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calib.inference.field_noise import FieldCovariance
from fe.response import Array

WITHIN = {"within_50": 0.674, "within_95": 1.96}


@dataclass(frozen=True)
class Fitted:
    """What one truth says of (ln kappa, r, s, zero of the travel)."""

    off: Array
    """(4,) distance from the truth; the last in mm"""
    sd: Array
    """(4,) as it is stated"""


@dataclass(frozen=True)
class Linear:
    """Forces and field of a model about a truth's constants."""

    force: Array
    """(n_step, 4) derivatives of the forces by ln kappa, r, s and the zero, N"""
    field: Array
    """(3, n_step, n_point, 3) derivatives of the field by r, s and the zero, mm"""
    zero_sd: Array | float
    """of the prior, mm"""

    def fit(
        self,
        force_off: Array,
        force_errors: Array,
        field_off: Array,
        field_errors: FieldCovariance,
    ) -> Fitted:
        """What the truth's forces and field less the model's are mistaken for.

        `force_errors` (n_step, n_step) N^2.
        """
        vectors = np.concatenate([self.field, field_off[None]])
        gram = field_errors.inner(vectors, vectors)
        weighed = np.linalg.solve(force_errors, self.force).T
        information, pull = weighed @ self.force, weighed @ force_off
        information[1:, 1:] += gram[:3, :3]
        pull[1:] += gram[:3, 3]
        information[3, 3] += float(self.zero_sd) ** -2
        covariance = np.linalg.inv(information)
        return Fitted(covariance @ pull, np.sqrt(np.diag(covariance)))


def told(found: Sequence[Fitted]) -> dict[str, Any]:
    """Errors in their SDs, over all truths, each by (ln kappa, r, s, zero of the travel)."""
    off, sd = np.array([one.off for one in found]), np.array([one.sd for one in found])
    return {
        **within(off / sd),
        "mean_off": off.mean(axis=0).tolist(),
        "median_sd": np.median(sd, axis=0).tolist(),
    }


def within(z: Array) -> dict[str, Any]:
    """Size of errors (n, k) in units of their SDs, and shares within two bounds."""
    return {
        "n": len(z),
        "z_rms": np.sqrt(np.mean(z**2, axis=0)).tolist(),
        **{name: np.mean(np.abs(z) < bound, axis=0).tolist() for name, bound in WITHIN.items()},
    }
