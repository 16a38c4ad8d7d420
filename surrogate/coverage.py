"""How often stated intervals hold the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import norm

Array = npt.NDArray[np.float64]

LEVELS = (0.5, 0.8, 0.95)
LEAST_SHARE = 1e-12
"""variance of a direction over the largest, at and below which it is rounding"""


@dataclass(frozen=True)
class Coverage:
    """Share of values within their central intervals of 50, 80 and 95 %."""

    overall: tuple[float, ...]
    """(n_level,) of all values together"""
    by_step: tuple[tuple[float, ...], ...]
    """(n_step, n_level)"""
    joint: tuple[float, ...] | None
    """(n_level,) share of runs within the joint region of all steps (and points), their
    correlations included, as wide as runs left out ask for; None where it is not asked for"""
    joint_as_stated: tuple[float, ...] | None
    """the same with errors as stated"""


def coverage(z: Array, ranks: tuple[Array, Array] | None = None) -> Coverage:
    """Coverage of standardised residuals z (n, n_step, ...), in size or signed.

    With `ranks` (n,), levels of the joint regions that each run just lies in, widened and as
    stated, also jointly.
    """
    size = np.abs(z).reshape(len(z), z.shape[1], -1)
    inside = size[..., None] <= norm.ppf(0.5 + 0.5 * np.array(LEVELS))
    return Coverage(
        overall=tuple(inside.mean(axis=(0, 1, 2)).tolist()),
        by_step=tuple(tuple(row) for row in inside.mean(axis=(0, 2)).tolist()),
        joint=None if ranks is None else _shares(ranks[0]),
        joint_as_stated=None if ranks is None else _shares(ranks[1]),
    )


def _shares(rank: Array) -> tuple[float, ...]:
    return tuple(np.mean(rank[:, None] <= np.array(LEVELS), axis=0).tolist())


class Distance(NamedTuple):
    """Mahalanobis distances of n errors, and the number of directions that each is measured in."""

    size: Array
    """(n,)"""
    rank: npt.NDArray[np.int64]
    """(n,) of the covariance"""


def mahalanobis(error: Array, covariance: Array) -> Distance:
    """Distance of errors (n, n_step) in their covariances (n, n_step, n_step).

    Directions without any variance, but for rounding, count nothing: fewer runs than steps have
    such, and in a small box the weakest combination of steps may be known to rounding. Steps are
    measured by their own SDs, so that a weak one is not taken for one.
    """
    std = np.sqrt(np.einsum("nii->ni", covariance))
    scale = np.where(std > 0.0, std, 1.0)
    values, vectors = np.linalg.eigh(covariance / (scale[:, :, None] * scale[:, None, :]))
    kept = values > LEAST_SHARE * np.maximum(values[:, -1:], 0.0)
    along = np.einsum("nik,ni->nk", vectors, error / scale)
    squared = np.where(kept, along**2 / np.where(kept, values, 1.0), 0.0)
    return Distance(np.sqrt(squared.sum(axis=1)), np.count_nonzero(kept, axis=1))
