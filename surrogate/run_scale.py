"""By what factor the errors of a whole run differ from what is stated of them.

Stated errors are right in the mean over runs. Those of one run are all larger than that, where a
block snaps, or all smaller: error = s times a normal one, with ln s normal. Its mean and SD are
learnt from runs left out in turn, and scale the region that holds a whole run.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import chi, norm

Array = npt.NDArray[np.float64]

N_QUANTILES = 200
FEWEST = 8
"""runs left out that tell the scale of others; fewer leave errors as stated"""


@dataclass(frozen=True)
class RunScale:
    """Distribution of s, the factor that all errors of a run share; by default they are normal."""

    log_mean: float = 0.0
    log_std: float = 0.0

    def share_below(self, limit: Array) -> Array:
        """Probability that s is at most the limits, of any shape."""
        with np.errstate(divide="ignore"):
            off = np.log(limit) - self.log_mean
        if self.log_std == 0.0:
            return np.asarray(off >= 0.0, dtype=np.float64)
        share: Array = norm.cdf(off / self.log_std)
        return share

    def rank(self, size: Array, normal: Array) -> Array:
        """(n,) probability that the errors of a run are smaller than `size` (n,).

        `normal` (n or 1, n_draw) are equally probable sizes of normal errors as stated.
        """
        rank: Array = self.share_below(size[:, None] / normal).mean(axis=1)
        return rank

    def level(self, normal: Array, level: float) -> float:
        """Size that the errors of a run do not exceed with the probability `level`."""
        places = (np.arange(N_QUANTILES) + 0.5) / N_QUANTILES
        factors = np.exp(self.log_mean + self.log_std * norm.ppf(places))
        return float(np.quantile(np.multiply.outer(normal, factors), level))


class RunScales(NamedTuple):
    """Of all forces of a run, and of its whole field."""

    force: RunScale = RunScale()
    field: RunScale = RunScale()


def fit_run_scale(size: Array, normal: Array) -> RunScale:
    """Scale of runs left out: their sizes (n,), and those of normal errors (n or 1, n_draw).

    By the moments of the logarithm, of which those of normal errors are taken.
    """
    normal = np.broadcast_to(normal, (len(size), normal.shape[1]))
    kept = (size > 0.0) & (normal > 0.0).all(axis=1)
    if np.count_nonzero(kept) < FEWEST:
        return RunScale()
    own, of_normal = np.log(size[kept]), np.log(normal[kept])
    off = own - of_normal.mean(axis=1)
    variance = float(np.var(off, ddof=1) - np.mean(np.var(of_normal, axis=1)))
    return RunScale(float(off.mean()), float(np.sqrt(max(variance, 0.0))))


def mahalanobis_sizes(n_dim: int) -> Array:
    """(1, n) equally probable Mahalanobis distances of normal errors of n_dim values."""
    places = (np.arange(N_QUANTILES) + 0.5) / N_QUANTILES
    sizes: Array = chi.ppf(places, n_dim)[None]
    return sizes
