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
    correlations included; None where it is not asked for"""


def coverage(z: Array, rank: Array | None = None) -> Coverage:
    """Coverage of standardised residuals z (n, n_step, ...), in size or signed.

    With `rank` (n,), the level of the joint region that each run just lies in, also jointly.
    """
    size = np.abs(z).reshape(len(z), z.shape[1], -1)
    inside = size[..., None] <= norm.ppf(0.5 + 0.5 * np.array(LEVELS))
    joint = None
    if rank is not None:
        joint = tuple(np.mean(rank[:, None] <= np.array(LEVELS), axis=0).tolist())
    return Coverage(
        overall=tuple(inside.mean(axis=(0, 1, 2)).tolist()),
        by_step=tuple(tuple(row) for row in inside.mean(axis=(0, 2)).tolist()),
        joint=joint,
    )


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
