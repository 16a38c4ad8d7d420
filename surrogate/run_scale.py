"""By what factor the errors of a whole run exceed what is stated of them.

Stated errors are right in the mean over runs. Where a block snaps all errors of a run are larger:
error = s times a normal one, with ln s normal. Its mean and SD are learnt from runs left out in
turn. They only widen the region that holds a whole run, since runs left out by an emulator whose
lengths and modes they helped to choose look better than unseen ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.special import ndtr
from scipy.stats import chi

Array = npt.NDArray[np.float64]

N_QUANTILES = 400
FEWEST = 16
"""runs left out that tell the scale of others (its SD to 18 %); fewer leave errors as stated"""


@dataclass(frozen=True)
class RunScale:
    """Distribution of s, the factor that all errors of a run share; by default they are normal."""

    log_mean: float = 0.0
    log_std: float = 0.0

    def rank(self, size: Array, normal: Array) -> Array:
        """(n,) level of the joint region that a run with errors of `size` (n,) just lies in.

        `normal` (n or 1, n_draw) are equally probable sizes of normal errors as stated. The region
        of a level is the larger of that of normal errors and that of scaled ones.
        Raises ValueError for sizes that are not finite.
        """
        if not np.isfinite(size).all():
            raise ValueError(f"size: expected finite numbers, found {size[~np.isfinite(size)][0]}")
        as_stated: Array = np.mean(normal <= size[:, None], axis=1)
        return np.minimum(as_stated, self._share_below(size[:, None], normal))

    def level(self, normal: Array, level: float) -> float:
        """Size that the errors of a run do not exceed with the probability `level`.

        `normal` (n_draw,) as in `rank`.
        """
        as_stated = float(np.quantile(normal, level))
        if self.log_std == 0.0:
            return as_stated * max(1.0, float(np.exp(self.log_mean)))
        low, high = (np.log(pick(normal)) + self.log_mean for pick in (np.min, np.max))

        def beyond(log_size: float) -> float:
            return float(self._share_below(np.exp(log_size), normal[None])[0]) - level

        far = 12.0 * self.log_std
        return max(as_stated, float(np.exp(brentq(beyond, low - far, high + far))))

    def _share_below(self, size: Array | float, normal: Array) -> Array:
        """(n,) probability that scaled errors are at most of these sizes (n, 1)."""
        with np.errstate(divide="ignore"):
            off = np.log(size) - np.log(normal) - self.log_mean
        if self.log_std == 0.0:
            return np.asarray(np.mean(off >= 0.0, axis=1), dtype=np.float64)
        share: Array = ndtr(off / self.log_std).mean(axis=1)
        return share


@dataclass(frozen=True)
class RunScales:
    """Of all forces of a run, and of its whole field."""

    force: RunScale = RunScale()
    field: RunScale = RunScale()


def fit_run_scale(size: Array, normal: Array) -> RunScale:
    """Scale of runs left out: their sizes (n,), and those of normal errors (n or 1, n_draw).

    By the moments of the logarithm, of which those of normal errors are taken. Errors as stated
    for fewer than `FEWEST` runs whose errors are not zero.
    """
    normal = np.broadcast_to(normal, (len(size), normal.shape[1]))
    kept = (size > 0.0) & (normal > 0.0).all(axis=1)
    if np.count_nonzero(kept) < FEWEST:
        return RunScale()
    own, of_normal = np.log(size[kept]), np.log(normal[kept])
    off = own - of_normal.mean(axis=1)
    variance = float(np.var(off, ddof=1) - np.mean(np.var(of_normal, axis=1)))
    return RunScale(float(off.mean()), float(np.sqrt(max(variance, 0.0))))


def mahalanobis_sizes(n_dim: int | npt.NDArray[np.int64]) -> Array:
    """(1 or n, n_draw) equally probable Mahalanobis distances of normal errors of n_dim values.

    n_dim is one for all runs or that of each (n,). An error measured in no direction has no size,
    and lies in any region: those of one value stand for its own.
    """
    places = (np.arange(N_QUANTILES) + 0.5) / N_QUANTILES
    each, of_run = np.unique(np.maximum(np.atleast_1d(n_dim), 1), return_inverse=True)
    sizes: Array = np.asarray(chi.ppf(places, each[:, None]))
    return sizes[of_run]
