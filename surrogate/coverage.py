"""How often stated intervals hold the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import norm

Array = npt.NDArray[np.float64]

LEVELS = (0.5, 0.8, 0.95)


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


def mahalanobis(error: Array, covariance: Array) -> Array:
    """(n,) distance of errors (n, n_step) in their covariances (n, n_step, n_step).

    Directions without any variance count nothing.
    """
    try:
        solved = np.asarray(np.linalg.solve(covariance, error[:, :, None]), dtype=np.float64)
    except np.linalg.LinAlgError:
        # In a small box the weakest combination of steps may be known to rounding.
        inverse = np.linalg.pinv(covariance, hermitian=True)
        solved = np.asarray(inverse @ error[:, :, None], dtype=np.float64)
    squared = np.einsum("ni,ni->n", error, solved[:, :, 0])
    distance: Array = np.sqrt(np.maximum(squared, 0.0))
    return distance
