"""Profile likelihoods: the best fit for every value of one coordinate, whatever the prior."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from calib.inference.data_parts import log_likelihood
from calib.inference.minimise import minimise_in_box
from calib.inference.posterior import Posterior
from fe.response import Array

LEVEL = 0.95


@dataclass(frozen=True)
class Profile:
    """ln likelihood maximised over the other coordinates, and the interval it leaves."""

    values: Array
    """(n,) of the coordinate, over the prior's box"""
    log_likelihood: Array
    """(n,) largest at each value"""

    @property
    def drop(self) -> Array:
        """(n,) how far below the largest of all"""
        fall: Array = self.log_likelihood.max() - self.log_likelihood
        return fall

    @property
    def interval(self) -> tuple[float, float]:
        """Values that a likelihood-ratio test at 5 % does not refuse; ends between grid points."""
        limit = 0.5 * chi2.ppf(LEVEL, 1)
        kept = np.flatnonzero(self.drop <= limit)
        low, high = int(kept[0]), int(kept[-1])
        return self._crossing(low, low - 1, limit), self._crossing(high, high + 1, limit)

    @property
    def open_ends(self) -> tuple[bool, bool]:
        """Whether the interval goes on to the lower and to the upper bound of the prior."""
        limit = 0.5 * chi2.ppf(LEVEL, 1)
        return bool(self.drop[0] <= limit), bool(self.drop[-1] <= limit)

    def _crossing(self, inside: int, outside: int, limit: float) -> float:
        if not 0 <= outside < self.values.size or not np.isfinite(self.drop[outside]):
            return float(self.values[inside])
        low, high = self.drop[inside], self.drop[outside]
        share = (limit - low) / (high - low)
        return float(self.values[inside] + share * (self.values[outside] - self.values[inside]))


def profile_likelihood(
    posterior: Posterior, index: int, best: Array, sd: Array, n: int = 21
) -> Profile:
    """Profile of coordinate `index` on an even grid over the prior's box.

    `best` (d,) is where the search starts (a maximum or mean), `sd` (d,) its scale. The grid is
    walked outwards from it in both directions, each value starting from its neighbour's end.
    """
    bounds = posterior.prior.bounds
    values = np.linspace(bounds[index, 0], bounds[index, 1], n)
    # Finer where the posterior is, which may be narrow in its box.
    near = best[index] + sd[index] * np.linspace(-4.0, 4.0, 17)
    inside = (near > bounds[index, 0]) & (near < bounds[index, 1])
    values = np.unique(np.concatenate([values, near[inside]]))
    heights = np.full(values.size, -np.inf)
    first = int(np.argmin(np.abs(values - best[index])))
    for order in (range(first, values.size), range(first, -1, -1)):
        x = best.copy()
        for position in order:
            x, heights[position] = _best_at(posterior, index, values[position], x, sd)
    return Profile(values, heights)


def _best_at(
    posterior: Posterior, index: int, value: float, start: Array, sd: Array
) -> tuple[Array, float]:
    """Largest ln likelihood with one coordinate held, from where its neighbour ended."""
    bounds = posterior.prior.bounds
    box = bounds.copy()
    box[index] = value
    begun = np.clip(start, box[:, 0], box[:, 1])
    if bounds.shape[0] == 1:
        return begun, float(log_likelihood(posterior, begun[None])[0])

    def height(x: Array) -> Array:
        return log_likelihood(posterior, x)

    found, _ = minimise_in_box(height, begun, box, sd, bounds)
    return found, float(height(found[None])[0])
