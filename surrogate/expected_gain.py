"""What a run to come would tell about the emulator where the posterior is, before it is made.

The covariance of a Gaussian process given a further run does not need the run's values. So the
variance that a run at a candidate takes away at places of interest is known beforehand (integrated
mean squared error: Sacks, Welch, Mitchell & Wynn 1989, Stat. Sci. 4, 409; here over the posterior),
with the run's derivatives counted where runs bring them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from surrogate.covariance import rows_of
from surrogate.gp import GaussianProcesses

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

_JITTER = 1e-8
"""least noise of a new run over the variance of its process"""


@dataclass(frozen=True)
class Gain:
    """Covariance of k processes between p places and the runs at m candidates, given what is known.

    A run is its value and `r - 1` derivatives, those that the training runs have.
    """

    places: Array
    """(k, p, m * r) covariance of values at the places and rows of the candidates, output units"""
    runs: Array
    """(k, m * r, m * r) among the rows of the candidates"""
    noise: Array
    """(k, m * r) variance of a new run's noise"""
    of_candidate: IntArray
    """(m, r) rows of each candidate"""
    weight: Array
    """(k,) what a variance of each process counts"""

    @classmethod
    def of(
        cls, processes: GaussianProcesses, candidates: Array, places: Array, weight: Array
    ) -> Gain:
        """Of processes at candidates (m, d) and places (p, d)."""
        has_slope = (processes.usable > 0.0).any(axis=0)
        rows = rows_of(np.tile(has_slope, (len(candidates), 1)))
        least = _JITTER * processes.variance_scale[:, None]
        return cls(
            places=processes.covariance(places, candidates, None, rows),
            runs=processes.covariance(candidates, candidates, rows, rows),
            noise=np.maximum(processes.noise_of_run(rows), least),
            of_candidate=rows.of_point[:, np.append(True, has_slope)],
            weight=weight,
        )

    @property
    def total(self) -> Array:
        """(m,) variance that a run at each candidate takes away, weighted, mean over the places."""
        gained = np.zeros(len(self.of_candidate))
        for k, weight in enumerate(self.weight):
            cross = self.places[k].T[self.of_candidate]
            told = np.linalg.solve(self._blocks(k, self.of_candidate), cross)
            gained += weight * np.mean(np.sum(told * cross, axis=1), axis=1)
        return gained

    def given(self, index: int) -> Gain:
        """After a run at the candidate `index`."""
        own = self.of_candidate[index]
        places, runs = np.empty_like(self.places), np.empty_like(self.runs)
        for k in range(len(self.weight)):
            told = np.linalg.solve(self._blocks(k, own[None])[0], self.runs[k][own])
            places[k] = self.places[k] - self.places[k][:, own] @ told
            runs[k] = self.runs[k] - self.runs[k][:, own] @ told
        return Gain(places, runs, self.noise, self.of_candidate, self.weight)

    def _blocks(self, k: int, rows: IntArray) -> Array:
        """(m, r, r) covariance of what runs with rows (m, r) would say, noise included."""
        blocks = self.runs[k][rows[:, :, None], rows[:, None, :]]
        diagonal = np.arange(rows.shape[1])
        blocks[:, diagonal, diagonal] += self.noise[k][rows]
        found: Array = blocks
        return found
