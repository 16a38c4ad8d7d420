"""Choice of coordinates and covariance by leaving runs out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from surrogate.covariance import FAMILIES
from surrogate.evidence import Hyperparameters, maximise_evidence
from surrogate.gp import GaussianProcesses
from surrogate.gp_fit import conditioned, posterior, scale_runs
from surrogate.thinning import part_of_runs
from surrogate.warp import STRENGTHS

Array = npt.NDArray[np.float64]

_ROWS = 200
"""values and derivatives by which lengths are searched: runs are thinned to as many"""
_JUDGED_ROWS = 400
"""values and derivatives that are left out to judge what was found: of 28 runs with six derivatives
each a covariance can look best by chance"""
_ITERATIONS = 6
_MIN_GAIN = 2.0
"""gain of the score below which an input is left as it is"""


class Chosen(NamedTuple):
    """Coordinates and covariance in which runs left out are most probable."""

    strength: Array
    """(d,) see `surrogate.warp`"""
    family: str
    part: npt.NDArray[np.int64]
    """runs by which lengths were searched"""


class _Runs(NamedTuple):
    """Inputs (n, d), outputs (n, k) and, if any, derivatives (n, k, d)."""

    x: Array
    y: Array
    slopes: Array | None

    def at(self, part: npt.NDArray[np.int64]) -> _Runs:
        slopes = None if self.slopes is None else self.slopes[part]
        return _Runs(self.x[part], self.y[part], slopes)


class _Candidate(NamedTuple):
    strength: Array
    family: int
    parameters: Hyperparameters
    score: float


def choose_coordinates(x: Array, y: Array, slopes: Array | None = None) -> Chosen:
    """Coordinates and covariance in which runs left out of outputs y (n, k) are most probable.

    First the covariance, then one input after the other is stretched, then the covariance again.
    The outputs share their covariance. The score is the leave-one-out predictive probability
    (Rasmussen & Williams 2006, 5.4.2), which depends less on the model being true than the evidence
    does: that prefers rough covariances of huge length, which err several times more. Where there
    are many rows, lengths are searched on a part of the runs and judged on a larger one. `slopes`
    (n, k, d) as in `surrogate.gp_fit.fit_processes`; raises ValueError as that does.
    """
    part, judged = (thinned(x, slopes, rows) for rows in (_ROWS, _JUDGED_ROWS))
    every = _Runs(x, y, slopes)
    runs = every.at(part), every.at(judged)
    flat = np.zeros(x.shape[1])
    found = [_candidate(runs, flat, family, None) for family in range(len(FAMILIES))]
    best = max(found, key=lambda candidate: candidate.score)
    for axis in range(x.shape[1]):
        kept = best
        for value in STRENGTHS[1:]:
            strength = kept.strength.copy()
            strength[axis] = value
            other = _candidate(runs, strength, kept.family, kept.parameters)
            if other.score > max(best.score, kept.score + _MIN_GAIN):
                best = other
    if best.strength.any():
        others = set(range(len(FAMILIES))) - {best.family}
        found = [_candidate(runs, best.strength, family, None) for family in sorted(others)]
        best = max([best, *found], key=lambda candidate: candidate.score)
    return Chosen(best.strength, FAMILIES[best.family], part)


def left_out(
    x: Array, y: Array, slopes: Array | None, strength: Array, family: str
) -> tuple[Array, Array]:
    """Mean and variance (n, k) of outputs y (n, k) at each run given the others, see above.

    With coordinates and covariance as given, and few steps of the search for its lengths.
    """
    processes, _ = _fitted(_Runs(x, y, slopes), strength, FAMILIES.index(family), None)
    return processes.leave_one_out()


def log_density(error: Array, variance: Array) -> float:
    """Sum of the log densities of normal errors (n, k) of variance (n, k)."""
    return float(-0.5 * np.sum(np.log(2.0 * np.pi * variance) + error**2 / variance))


def thinned(x: Array, slopes: Array | None, most: int = _ROWS) -> npt.NDArray[np.int64]:
    """Runs of x (n, d) on which choices are made, so many that about `most` rows are left."""
    usable = 0 if slopes is None else np.count_nonzero(np.isfinite(slopes).all(axis=1))
    return part_of_runs(x, len(x) + int(usable), most)


def _candidate(
    runs: tuple[_Runs, _Runs],
    strength: Array,
    family: int,
    start: Hyperparameters | None,
) -> _Candidate:
    searched, judged = runs
    processes, parameters = _fitted(searched, strength, family, start)
    if len(judged.x) > len(searched.x):
        processes = conditioned(scale_runs(*judged, strength), family, parameters)
    mean, variance = processes.leave_one_out()
    score = log_density(judged.y - mean, variance)
    return _Candidate(strength, family, parameters, score)


def _fitted(
    runs: _Runs,
    strength: Array,
    family: int,
    start: Hyperparameters | None,
) -> tuple[GaussianProcesses, Hyperparameters]:
    """Processes of a shared covariance after a short search."""
    scaled = scale_runs(*runs, strength)
    fitted = maximise_evidence(
        (family,),
        scaled.inputs,
        scaled.usable,
        np.ascontiguousarray(scaled.targets.T),
        np.random.default_rng(0),  # not used without restarts
        0,
        start=start,
        max_iterations=_ITERATIONS,
    )
    processes = posterior(scaled, [np.arange(len(scaled.targets))], [fitted])
    return processes, fitted.hyperparameters
