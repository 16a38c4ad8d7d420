"""Whether truths lie in their posteriors as often as these say: simulation-based calibration.

A truth drawn from the prior, seen through data drawn from the model, has a posterior probability
below it that is uniform on (0, 1), in every coordinate (Talts et al., arXiv:1804.06788; with the
probability computed by weighted draws instead of a rank among few).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.stats import chi2, kstwo

from fe.response import Array

LEVELS = (0.5, 0.8, 0.95)
"""of the central intervals whose coverage is told"""


@dataclass(frozen=True)
class Uniformity:
    """How far n probabilities are from uniform."""

    n: int
    chi_square_p: float
    """p-value of equal counts in `n_bin` bins; chi-square with n_bin - 1 degrees of freedom"""
    n_bin: int
    ecdf_distance: float
    """largest distance of their distribution function from that of the uniform"""
    ecdf_band: float
    """distance that n uniform numbers exceed with the probability `false_alarm`"""
    ecdf_p: float
    """p-value of the distance (Kolmogorov)"""
    false_alarm: float

    @property
    def inside_band(self) -> bool:
        """Whether the distribution function stays in its band."""
        return self.ecdf_distance <= self.ecdf_band


def uniformity(below: Array, *, n_bin: int = 20, false_alarm: float = 0.01) -> Uniformity:
    """Tests of n probabilities (n,), independent of each other, against the uniform distribution.

    Raises ValueError for probabilities outside [0, 1], or fewer than 5 expected in a bin, where the
    distribution of the chi-square would not be known.
    """
    n = len(below)
    if not (np.all(below >= 0) and np.all(below <= 1)):
        raise ValueError(f"below: expected in [0, 1], got {below.min()} to {below.max()}")
    if n < 5 * n_bin:
        raise ValueError(f"n_bin: expected at most {n // 5} for {n} probabilities, got {n_bin}")
    count = np.histogram(below, np.linspace(0.0, 1.0, n_bin + 1))[0]
    statistic = float(np.sum((count - n / n_bin) ** 2) / (n / n_bin))
    ordered, step = np.sort(below), np.arange(n) / n
    distance = float(max(np.max(ordered - step), np.max(step + 1.0 / n - ordered)))
    return Uniformity(
        n=n,
        chi_square_p=float(chi2.sf(statistic, n_bin - 1)),
        n_bin=n_bin,
        ecdf_distance=distance,
        ecdf_band=_band(false_alarm, n),
        ecdf_p=float(kstwo.sf(distance, n)),
        false_alarm=false_alarm,
    )


@cache
def _band(false_alarm: float, n: int) -> float:
    # Kept, since the inverse is searched for.
    return float(kstwo.isf(false_alarm, n))


def coverage(below: Array, levels: Sequence[float] = LEVELS) -> Array:
    """(n_level, ...) share of central intervals that hold their truth; `below` (n, ...)."""
    off = np.abs(below - 0.5)
    return np.array([np.mean(off <= 0.5 * level, axis=0) for level in levels])


def clustered_error(inside: Array, cluster: Array) -> float:
    """Standard error of the mean of `inside` (n,) whose members of a `cluster` (n,) go together.

    Of the sums of residuals by cluster (Liang & Zeger, Biometrika 73 (1986) 13).
    """
    off = inside - inside.mean()
    sums = np.array([off[cluster == label].sum() for label in np.unique(cluster)])
    m = len(sums)
    return float(np.sqrt(m / (m - 1) * np.sum(sums**2)) / len(inside))
