"""Moves of the walkers over a population and its samples, each exact for the joint density.

Proposals are differences between walkers of the other half of the same ensemble (differential
evolution, ter Braak, Stat. Comput. 16 (2006) 239), with lengths drawn anew each time.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2

from calib.inference.condensed import White
from calib.inference.hierarchical import Globals, HierarchicalPosterior, Pooled
from calib.inference.sampling import dispersed_starts
from fe.response import Array

Index = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]

LOCAL_MOVES = 2
CENTRED_MOVES = 3
LONG_JUMPS = 0.1
"""share of the proposals as long as the difference itself: from one mode to another"""
SHORTEST = 0.1
"""length of the shortest proposals, over the longest"""
JITTER = 1e-5
"""of proposals, so that walkers do not stay on the lattice of their differences"""
LOST = 1e-8
"""probability of a draw of the main mode as far below the best as a walker that counts as lost"""
WIDE = 1e3
"""SD between samples over the box at which a sample knows nothing of the others"""


@dataclass(frozen=True)
class Walkers:
    """Where the m walkers of all ensembles are."""

    y: Array
    """(m, d + c) population and common unknowns, see `Globals`"""
    v: Array
    """(m, n, c) samples"""
    z: Array
    """(m, q) common errors"""
    white: White
    """residuals there"""


class Place(NamedTuple):
    """The same as numbers of the model."""

    x: Array
    """(m, d) population's and common coordinates"""
    tau: Array
    """(m, c) SDs between samples"""
    own: Array
    """(m, n, c) coordinates of the samples that differ"""
    z: Array
    """(m, q) common errors, in their prior SDs"""
    p_value: Array
    """(m, n) of the chi-square of each sample's residuals"""


@dataclass(frozen=True)
class Moves:
    """Moves walkers of independent ensembles together."""

    posterior: HierarchicalPosterior
    n_ensembles: int
    n_walkers: int
    rng: np.random.Generator
    accepted: Array = field(default_factory=lambda: np.zeros((4, 2)))
    """(4, 2) accepted and proposed, by kind of move in the order of a round"""

    @property
    def globals(self) -> Globals:
        """Coordinates of population and common unknowns."""
        return Globals(self.posterior.population)

    def start(self) -> Walkers:
        """Walkers far apart: of the density without scatter, tempered, with scatter of any size."""
        population, n = self.posterior.population, self.posterior.n_samples
        pooled = Pooled(self.posterior)
        x = [dispersed_starts(pooled, self.n_walkers, self.rng) for _ in range(self.n_ensembles)]
        m = self.n_ensembles * self.n_walkers
        share = self.rng.uniform(0.2, 0.8, (m, len(population.columns)))
        tau = np.stack(
            [population.scatter[name].quantile(share[:, i])
             for i, name in enumerate(population.varying)], axis=1,
        )  # fmt: skip
        y = self.globals.of(np.concatenate(x), tau)
        v = 0.3 * self.rng.standard_normal((m, n, tau.shape[1]))
        white = self.posterior.white(*self.globals.split(y), v)
        z = self.posterior.common_errors(white).draw(self.rng)
        return Walkers(y, v, z, white)

    def round(self, walkers: Walkers) -> Walkers:
        """All moves once; see `calib.inference.hierarchical_sampling`."""
        walkers = self.move_along(self.move_all(walkers))
        for _ in range(LOCAL_MOVES):
            walkers = self.move_each(walkers)
        return self.move_population(walkers)

    def move_all(self, walkers: Walkers) -> Walkers:
        """Move what is common and let all samples go along; then draw the common errors anew."""
        y, white = walkers.y.copy(), _copy(walkers.white)
        for rows, first, second in self._halves():
            length = self._lengths(len(rows), 1, y.shape[1])
            new = y[rows] + length * (y[first] - y[second])
            new += JITTER * self.rng.standard_normal(new.shape)
            found = self.posterior.white(*self.globals.split(new), walkers.v[rows])
            after = self.posterior.common_errors(found).log_prob + self.globals.log_prior(new)
            here = White(white.residual[rows], white.factor[rows])
            before = self.posterior.common_errors(here).log_prob
            good = self._accept(after - before - self.globals.log_prior(y[rows]), 0)
            y[rows[good]] = new[good]
            white.residual[rows[good]] = found.residual[good]
            white.factor[rows[good]] = found.factor[good]
        z = self.posterior.common_errors(white).draw(self.rng)
        return replace(walkers, y=y, z=z, white=white)

    def move_along(self, walkers: Walkers) -> Walkers:
        """Move common unknowns, and population and all samples by one and the same distance.

        Along the mean of the samples, which the data of all know well where that of a population
        is uncertain. The common errors are drawn anew.
        """
        population = self.posterior.population
        (x, tau), own = self.globals.split(walkers.y), self._own(walkers)
        y, v, white = walkers.y.copy(), walkers.v.copy(), _copy(walkers.white)
        columns, (low, high) = population.columns, population.prior.bounds.T
        centre = x.copy()
        centre[:, columns] = own.mean(axis=1)
        for rows, first, second in self._halves():
            shift = self._lengths(len(rows), 1, x.shape[1]) * (centre[first] - centre[second])
            new, moved = x[rows] + shift, own[rows] + shift[:, None, columns]
            inside = ((new > low) & (new < high)).all(axis=1)
            inside &= ((moved >= low[columns]) & (moved <= high[columns])).all(axis=(1, 2))
            new = np.where(inside[:, None], new, x[rows])
            moved = np.where(inside[:, None, None], moved, own[rows])
            place = population.standard(new, tau[rows], moved)
            inside &= np.isfinite(place).all(axis=(1, 2))
            place = np.where(inside[:, None, None], place, v[rows])
            found = self.posterior.white(new, tau[rows], place)
            here = White(white.residual[rows], white.factor[rows])
            gain = self._of_place(new, tau[rows], moved, found)
            gain -= self._of_place(x[rows], tau[rows], own[rows], here)
            good = self._accept(np.where(inside, gain, -np.inf), 1)
            chosen = rows[good]
            y[chosen] = self.globals.of(new[good], tau[chosen])
            v[chosen], centre[chosen] = place[good], centre[chosen] + shift[good]
            white.residual[chosen], white.factor[chosen] = found.residual[good], found.factor[good]
        z = self.posterior.common_errors(white).draw(self.rng)
        return Walkers(y, v, z, white)

    def _of_place(self, x: Array, tau: Array, own: Array, white: White) -> Array:
        """(m,) ln density with respect to x and own, common errors integrated out."""
        population = self.posterior.population
        density = population.log_density(x, tau, own).sum(axis=1)
        density += population.log_prior(x, tau)
        total: Array = density + self.posterior.common_errors(white).log_prob
        return total

    def move_each(self, walkers: Walkers, split: tuple[Array, Array] | None = None) -> Walkers:
        """Move every sample by itself, given all that is common.

        `split` (x, tau) stands in for that of the walkers' y.
        """
        v, white = walkers.v.copy(), _copy(walkers.white)
        x, tau = self.globals.split(walkers.y) if split is None else split
        for rows, first, second in self._halves():
            length = self._lengths(len(rows), v.shape[1], v.shape[2])
            new = v[rows] + length[:, :, None] * (v[first] - v[second])
            new += JITTER * self.rng.standard_normal(new.shape)
            found = self.posterior.white(x[rows], tau[rows], new)
            here = White(white.residual[rows], white.factor[rows])
            gain = self.posterior.sample_log_prob(found, walkers.z[rows])
            gain -= self.posterior.sample_log_prob(here, walkers.z[rows])
            gain -= 0.5 * ((new**2).sum(axis=2) - (v[rows] ** 2).sum(axis=2))
            good = self._accept(gain, 2)
            row, sample = np.nonzero(good)
            v[rows[row], sample] = new[good]
            white.residual[rows[row], sample] = found.residual[good]
            white.factor[rows[row], sample] = found.factor[good]
        return replace(walkers, v=v, white=white)

    def move_population(self, walkers: Walkers) -> Walkers:
        """Move population and SDs at fixed constants of the samples."""
        population, y = self.posterior.population, walkers.y.copy()
        own, d = self._own(walkers), population.prior.space.size
        density = self._of_population(y, own)
        for _ in range(CENTRED_MOVES):
            for place, column in enumerate(population.columns):
                both = [column, d + place]
                for rows, first, second in self._halves():
                    length = self._lengths(len(rows), 1, 2)
                    new = y[rows]
                    new[:, both] += length * (y[first] - y[second])[:, both]
                    new[:, both] += JITTER * self.rng.standard_normal((len(rows), 2))
                    after = self._of_population(new, own[rows])
                    good = self._accept(after - density[rows], 3)
                    y[rows[good]], density[rows[good]] = new[good], after[good]
        v = population.standard(*self.globals.split(y), own)
        moved = (y != walkers.y).any(axis=1) & np.isfinite(v).all(axis=(1, 2))
        return replace(
            walkers,
            y=np.where(moved[:, None], y, walkers.y),
            v=np.where(moved[:, None, None], v, walkers.v),
        )

    def _of_population(self, y: Array, own: Array) -> Array:
        """(m,) ln density of population and samples with respect to y and own, without data."""
        density = self.posterior.population.log_density(*self.globals.split(y), own).sum(axis=1)
        total: Array = density + self.globals.log_prior(y)
        return total

    def brought_back(self, walkers: Walkers) -> Walkers:
        """Walkers that are lost in a secondary mode, put to where others of their ensemble are.

        Lost are those whose density lies below the best by more than a normal of as many
        coordinates does with a probability of `LOST`; all of an ensemble stay, as its R-hat tells.
        """
        density = self.posterior.common_errors(walkers.white).log_prob
        density = density + self.globals.log_prior(walkers.y)
        density -= 0.5 * (walkers.v**2).sum(axis=(1, 2))
        n_coordinates = walkers.y.shape[1] + walkers.v[0].size
        lost = density < density.max() - 0.5 * chi2.isf(LOST, n_coordinates)
        rows = np.arange(len(lost))
        for first in range(0, len(lost), self.n_walkers):
            own = rows[first : first + self.n_walkers]
            good = own[~lost[own]]
            if good.size and lost[own].any():
                rows[own[lost[own]]] = self.rng.choice(good, int(lost[own].sum()))
        white = White(walkers.white.residual[rows], walkers.white.factor[rows])
        return Walkers(walkers.y[rows], walkers.v[rows], walkers.z[rows], white)

    def place(self, walkers: Walkers) -> Place:
        """Where walkers are, as numbers of the model."""
        x, tau = self.globals.split(walkers.y)
        log_prob = self.posterior.sample_log_prob(walkers.white, walkers.z)
        p = np.asarray(chi2.sf(-2.0 * log_prob, self.posterior.samples.n_data))
        return Place(x, tau, self._own(walkers), walkers.z, p)

    def alone(self, walkers: Walkers, n_settle: int, n_draw: int) -> Array:
        """(m', n, d) draws of every sample from its own data, as if it knew of no population.

        Common unknowns and errors stay those of the walkers, which are among the coordinates; any
        place in the box is as probable.
        """
        population = self.posterior.population
        low, high = population.prior.bounds[population.columns].T
        x, _ = self.globals.split(walkers.y)
        wide = (x, np.broadcast_to(WIDE * (high - low), (len(x), len(low))))
        now = replace(walkers, v=population.standard(*wide, self._own(walkers)))
        found = []
        for step in range(n_settle + n_draw):
            now = self.move_each(now, wide)
            if step >= n_settle:
                found.append(population.samples(*wide, now.v))
        return np.concatenate(found)

    def _own(self, walkers: Walkers) -> Array:
        x, tau = self.globals.split(walkers.y)
        population = self.posterior.population
        return population.samples(x, tau, walkers.v)[:, :, population.columns]

    def _halves(self) -> list[tuple[Index, Index, Index]]:
        """Rows of either half, and for each two different walkers of the other half."""
        half = self.n_walkers // 2
        base = self.n_walkers * np.arange(self.n_ensembles)[:, None]
        found = []
        for mine, others in ((0, half), (half, 0)):
            first = self.rng.integers(half, size=(self.n_ensembles, half))
            second = (first + 1 + self.rng.integers(half - 1, size=first.shape)) % half
            rows = (base + mine + np.arange(half), base + others + first, base + others + second)
            found.append((rows[0].ravel(), rows[1].ravel(), rows[2].ravel()))
        return found

    def _lengths(self, m: int, n: int, dimension: int) -> Array:
        """(m, n) lengths of proposals in a space of a dimension."""
        length: Array = 2.38 / np.sqrt(2.0 * dimension) * SHORTEST ** self.rng.random((m, n))
        length[self.rng.random((m, n)) < LONG_JUMPS] = 1.0
        return length

    def _accept(self, gain: Array, kind: int) -> BoolArray:
        good: BoolArray = np.log(self.rng.random(gain.shape)) < np.where(
            np.isnan(gain), -np.inf, gain
        )
        self.accepted[kind] += np.count_nonzero(good), good.size
        return good


def _copy(white: White) -> White:
    return White(white.residual.copy(), white.factor.copy())
