"""Errors that several kinds of data share, integrated out exactly.

The zero of the pin's travel moves the forces and the field together, and so does the compliance of
the machine. Taken as errors of each, the data would seem to know more of their difference than they
do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fe.response import Array


@dataclass(frozen=True)
class SharedError:
    """One nuisance that is linear in what the model predicts, with a normal prior about zero."""

    name: str
    unit: str
    sd: float
    """prior SD in the unit"""
    force: Array
    """(n_step, n_step) takes predicted forces to their change by one SD, N per N"""
    field: Array
    """(n_step, n_step) takes a predicted field to its change by one SD, over increments"""


@dataclass(frozen=True)
class AlongError:
    """Log density of some data along shared errors of z SDs.

    It is the parabola value + slope z - z curvature z / 2, since all is normal and the errors enter
    linearly.
    """

    value: Array
    """(m,)"""
    slope: Array
    """(q, m)"""
    curvature: Array
    """(q, q, m)"""


class SharedPosterior(NamedTuple):
    """What given parameters leave of the shared errors, in prior SDs."""

    mean: Array
    """(m, q)"""
    covariance: Array
    """(m, q, q)"""


def marginal(parts: Sequence[AlongError]) -> Array:
    """(m,) joint log density of all parts, z ~ N(0, I) integrated out; -inf if not finite."""
    value, slope, curvature = _sums(parts)
    total = value
    # One error after the other: of a single one the same operations as ever.
    with np.errstate(invalid="ignore", divide="ignore"):
        for j in range(len(slope)):
            pivot = curvature[j, j]
            total = total + 0.5 * (slope[j] ** 2 / pivot - np.log(pivot))
            if j + 1 < len(slope):
                ratio = curvature[j + 1 :, j] / pivot
                slope = np.concatenate([slope[: j + 1], slope[j + 1 :] - ratio * slope[j]])
                rest = curvature[j + 1 :, j + 1 :] - ratio[:, None] * curvature[j, j + 1 :]
                curvature = curvature.copy()
                curvature[j + 1 :, j + 1 :] = rest
    finite: Array = np.where(np.isfinite(total), total, -np.inf)
    return finite


def shared_posterior(parts: Sequence[AlongError]) -> SharedPosterior:
    """Normal posterior of the shared errors given parameters."""
    _, slope, curvature = _sums(parts)
    covariance: Array = np.asarray(np.linalg.inv(curvature.transpose(2, 0, 1)), dtype=np.float64)
    return SharedPosterior(np.einsum("mij,jm->mi", covariance, slope), covariance)


def _sums(parts: Sequence[AlongError]) -> tuple[Array, Array, Array]:
    """Sums of values, slopes and curvatures; the prior's identity in the last."""
    value = sum((part.value for part in parts[1:]), start=parts[0].value)
    slope = sum((part.slope for part in parts[1:]), start=parts[0].slope)
    curvature = sum((part.curvature for part in parts[1:]), start=parts[0].curvature)
    return value, slope, np.eye(len(slope))[:, :, None] + curvature
