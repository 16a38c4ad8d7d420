"""Profile likelihoods: the best fit for every value of one coordinate, whatever the prior."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.stats import chi2

from calib.inference.data_parts import log_likelihood
from calib.inference.minimise import LogProb, minimise_in_box
from calib.inference.posterior import Posterior
from fe.response import Array

LEVEL = 0.95
CLEARLY = 0.5
"""ln likelihood below the limit at which values between two ranges are refused"""
N_DRAWN = 2048
"""draws of the prior among which a start is sought where the neighbour's end is none"""
NEAR = 4.0
"""SDs about the neighbour's end within which half of them are brought"""
N_HALVED = 6
"""times that the distance to the end of the support is halved"""
SLOPE = 1e-3
"""of ln likelihood per SD, at which a search ends: some 1e-6 of ln likelihood is left to gain"""
N_CLOUDS = 40
CLOUD = 64
"""points of a cloud that looks for what is higher along a wall"""


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
    def intervals(self) -> tuple[tuple[float, float], ...]:
        """Values that a likelihood-ratio test at 5 % does not refuse; ends between grid points.

        Two ranges where neighbouring points between are clearly refused: at a single one the search
        may have failed.
        """
        limit = 0.5 * chi2.ppf(LEVEL, 1)
        # Where the prior has nothing, nothing is refused.
        possible = np.flatnonzero(np.isfinite(self.drop))
        drop = self.drop[possible]
        kept = np.flatnonzero(drop <= limit)
        apart = [
            np.count_nonzero(drop[first:last] > limit + CLEARLY) > 1
            for first, last in pairwise(kept.tolist())
        ]
        runs = np.split(possible[kept], np.flatnonzero(apart) + 1)
        return tuple(
            (
                self._crossing(int(run[0]), int(run[0]) - 1, limit),
                self._crossing(int(run[-1]), int(run[-1]) + 1, limit),
            )
            for run in runs
        )

    @property
    def interval(self) -> tuple[float, float]:
        """The first to the last of them, what is refused between included."""
        found = self.intervals
        return found[0][0], found[-1][1]

    @property
    def open_ends(self) -> tuple[bool, bool]:
        """Whether the interval goes on to the lower and to the upper bound of the prior.

        The prior's is where its support ends, if that is no box.
        """
        limit = 0.5 * chi2.ppf(LEVEL, 1)
        possible = self.drop[np.isfinite(self.drop)]
        return bool(possible[0] <= limit), bool(possible[-1] <= limit)

    def _crossing(self, inside: int, outside: int, limit: float) -> float:
        if not 0 <= outside < self.values.size or not np.isfinite(self.drop[outside]):
            return float(self.values[inside])
        low, high = self.drop[inside], self.drop[outside]
        share = (limit - low) / (high - low)
        return float(self.values[inside] + share * (self.values[outside] - self.values[inside]))


def profile_likelihood(
    posterior: Posterior,
    index: int,
    best: Array,
    sd: Array,
    n: int = 21,
    likely: Array | None = None,
) -> Profile:
    """Profile of coordinate `index` on an even grid over the prior's box, and where it is `likely`.

    `best` (d,) is where the search starts (a maximum or mean), `sd` (d,) its scale. The grid is
    walked outwards from it in both directions, each value starting from its neighbour's end and
    from the best of some draws of the prior: there may be several modes.
    """
    bounds = posterior.prior.bounds
    values = np.linspace(bounds[index, 0], bounds[index, 1], n)
    # Finer where the posterior is, which may be narrow in its box.
    near = best[index] + sd[index] * np.linspace(-4.0, 4.0, 17)
    inside = (near > bounds[index, 0]) & (near < bounds[index, 1])
    values = np.unique(np.concatenate([values, near[inside], [] if likely is None else likely]))
    first = int(np.argmin(np.abs(values - best[index])))
    drawn = posterior.prior.sample(np.random.default_rng(0), N_DRAWN)
    found: dict[float, float] = {}
    for order in (values[first:], values[first::-1]):
        found |= _walked(posterior, index, order, best, sd, drawn)
    at = np.array(sorted(found))
    return Profile(at, np.array([found[value] for value in at]))


def _walked(
    posterior: Posterior, index: int, order: Array, best: Array, sd: Array, drawn: Array
) -> dict[float, float]:
    """Largest ln likelihood of each value in an order, and of some next to where its support ends.

    Between two values of which one is possible and the next is not the end is halved `N_HALVED`
    times: the interval may end there.
    """
    found: dict[float, float] = {}
    x = best

    def ask(value: float) -> bool:
        """Search at a value, also from where the last search ended; whether it is possible."""
        nonlocal x
        found[value] = -np.inf
        for start in _starts_at(posterior, index, value, x, sd, drawn):
            end, top = _best_at(posterior, index, start, sd)
            if top > found[value]:
                x, found[value] = end, top
        return bool(np.isfinite(found[value]))

    alive: float | None = None
    for value in map(float, order):
        if ask(value):
            alive = value
        elif alive is not None:
            dead = value
            for _ in range(N_HALVED):
                middle = 0.5 * (alive + dead)
                alive, dead = (middle, dead) if ask(middle) else (alive, middle)
            alive = None
    return found


def _starts_at(
    posterior: Posterior, index: int, value: float, neighbour: Array, sd: Array, drawn: Array
) -> list[Array]:
    """Where the neighbour ended, with the coordinate held, and the best of draws (m, d) so held.

    Only those where the density is not zero. The support need be no box: priors of the constants
    end elsewhere for every ratio. Where it is zero at the neighbour's end, half of the draws are
    brought close to that.
    """
    low, high = posterior.prior.bounds.T
    begun = np.clip(neighbour, low, high)
    begun[index] = value
    points, starts = drawn.copy(), []
    if np.isfinite(log_likelihood(posterior, begun[None])[0]):
        starts.append(begun)
    else:
        near = len(points) // 2
        # The places of draws in the box, as far from its middle as they are, in some SDs.
        points[:near] = begun + NEAR * sd * (2.0 * (points[:near] - low) / (high - low) - 1.0)
        points = np.clip(points, low, high)
    points[:, index] = value
    heights = log_likelihood(posterior, points)
    best = int(heights.argmax())
    if np.isfinite(heights[best]):
        starts.append(points[best])
    return starts


def _best_at(posterior: Posterior, index: int, start: Array, sd: Array) -> tuple[Array, float]:
    """Largest ln likelihood with one coordinate held at its value in `start` (d,)."""
    bounds = posterior.prior.bounds
    box = bounds.copy()
    box[index] = start[index]

    def height(x: Array) -> Array:
        return log_likelihood(posterior, x)

    if bounds.shape[0] == 1:
        return start, float(height(start[None])[0])
    found, value = minimise_in_box(height, start, box, sd, bounds, SLOPE)
    if posterior.prior.of:
        return _along_walls(height, found, box, sd)
    return found, value


def _along_walls(height: LogProb, start: Array, box: Array, sd: Array) -> tuple[Array, float]:
    """Highest point about a start by clouds of points that narrow, for a support that is no box.

    A search along slopes ends at the first wall; the maximum may lie further along it.
    """
    rng = np.random.default_rng(0)
    x, top, width = start, float(height(start[None])[0]), 1.0
    for _ in range(N_CLOUDS):
        cloud = x + width * sd * rng.standard_normal((CLOUD, x.size))
        cloud = np.clip(cloud, box[:, 0], box[:, 1])
        values = height(cloud)
        best = int(values.argmax())
        width *= 1.0 if values[best] > top else 0.5
        if values[best] > top:
            x, top = cloud[best], float(values[best])
    return x, top
