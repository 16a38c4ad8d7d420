"""How often stated intervals hold the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2, norm

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


def coverage(
    z: Array,
    error: Array | None = None,
    covariance: Array | None = None,
    rank: Array | None = None,
) -> Coverage:
    """Coverage of standardised residuals z (n, n_step, ...), in size or signed.

    With errors (n, n_step) and their covariances (n, n_step, n_step) also jointly over the steps,
    by the chi-square distribution of the Mahalanobis distance (Bastos & O'Hagan 2009,
    Technometrics 51, 425); with ranks (n,) of `surrogate.simultaneous_band` by the band that holds
    all values at once.
    """
    size = np.abs(z).reshape(len(z), z.shape[1], -1)
    inside = size[..., None] <= norm.ppf(0.5 + 0.5 * np.array(LEVELS))
    joint = None
    if error is not None and covariance is not None:
        solved = _solved(covariance, error)
        distance = np.einsum("ni,ni->n", error, solved)
        limits = chi2.ppf(LEVELS, error.shape[1])
        joint = tuple(np.mean(distance[:, None] <= limits, axis=0).tolist())
    elif rank is not None:
        joint = tuple(np.mean(rank[:, None] <= np.array(LEVELS), axis=0).tolist())
    return Coverage(
        overall=tuple(inside.mean(axis=(0, 1, 2)).tolist()),
        by_step=tuple(tuple(row) for row in inside.mean(axis=(0, 2)).tolist()),
        joint=joint,
    )


def _solved(covariance: Array, error: Array) -> Array:
    """(n, n_step) inverse covariance times error; directions without any variance count nothing."""
    try:
        solved = np.asarray(np.linalg.solve(covariance, error[:, :, None]), dtype=np.float64)
    except np.linalg.LinAlgError:
        # In a small box the weakest combination of steps may be known to rounding.
        inverse = np.linalg.pinv(covariance, hermitian=True)
        solved = np.asarray(inverse @ error[:, :, None], dtype=np.float64)
    column: Array = solved[:, :, 0]
    return column
