"""Runs that ended before the last step teach an emulator up to where they are good."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.stats import chi2

from surrogate.gp import GaussianProcesses
from surrogate.modal import ModalEmulator

Array = npt.NDArray[np.float64]

EXACT = 1e-10
"""least variance of what modes leave out of a value, as a share of what is not known of it"""
LEAST_NEW = 1e-6
"""information of a run on a direction, over what is known of it, that tells anything"""
AGREES = 0.99
"""share of the runs that an honest emulator expects; one beyond it counts as less exact"""


@dataclass(frozen=True)
class PartialRuns:
    """Runs that are good at their first steps only; NaN at the others.

    Raises ValueError for arrays of different lengths, runs that are good nowhere or everywhere and
    forces that are not positive.
    """

    ratios: Array
    """(q, d) design points"""
    force: Array
    """(q, n_step) force at kappa = 1 MPa, N"""
    displacement: Array | None
    """(q, n_step, n_point, 3) front-face displacement, mm; None without fields"""

    def __post_init__(self) -> None:
        for name in ("ratios", "force", "displacement"):
            if (given := getattr(self, name)) is not None:  # see `TrainingSet`
                object.__setattr__(self, name, np.ascontiguousarray(given, dtype=np.float64))
        good = np.isfinite(self.force)
        if len(self.ratios) != len(good) or not (good.any(axis=1) & ~good.all(axis=1)).all():
            raise ValueError("partial runs: expected forces at some steps of every run, not at all")
        if (self.force <= 0.0).any():
            raise ValueError("partial runs: expected positive forces, or NaN where not good")
        if self.displacement is not None:
            seen = np.isfinite(self.displacement).all(axis=(2, 3))
            if seen.shape != good.shape or (seen != good).any():
                raise ValueError("partial runs: expected displacements at the steps with a force")

    def subset(self, rows: npt.NDArray[np.bool_]) -> PartialRuns | None:
        """The runs of these rows (q,); None where there are none."""
        if not rows.any():
            return None
        field = None if self.displacement is None else self.displacement[rows]
        return PartialRuns(self.ratios[rows], self.force[rows], field)


def inside(x: Array, processes: GaussianProcesses) -> npt.NDArray[np.bool_]:
    """(q,) which points (q, d) lie in the box of the complete runs: beyond, nothing is known."""
    unit = (x - processes.low) / processes.span
    within: npt.NDArray[np.bool_] = np.all((unit >= 0.0) & (unit <= 1.0), axis=1)
    return within


def taught(modal: ModalEmulator, x: Array, y: Array) -> ModalEmulator:
    """The emulator with its mean conditioned on runs y (q, n_obs) at x (q, d), NaN where not good.

    The weights of all modes and runs are normal, given the complete runs; what is known of a run is
    a linear observation of its weights, with the truncation as noise. Late steps follow as far as
    modes tie them to early ones. A run that contradicts what the complete ones state (one on
    another branch does, however near to them it is) counts with so much more noise that it no
    longer does: the lengths and nuggets stay those of the complete runs, so that nothing else would
    keep it from bending the mean. The variance stays that of the complete runs: it is one of
    independent modes, and a run that is known in part leaves its modes dependent, so that a smaller
    variance of each would claim to know the steps that were not reached.
    """
    processes, pod = modal.processes.without_further, modal.pod
    kept = inside(x, processes)
    x, y = x[kept], y[kept]
    if not len(x):
        return modal
    k, q = len(processes.offset), len(x)
    noise = (processes.nugget * processes.variance_scale)[:, None, None] * np.eye(q)
    joint = processes.covariance(x, x) + noise  # (k, q, q)
    expected = processes.mean(x)
    information, pull = np.zeros((k, q, k, q)), np.empty((k, q))
    for run in range(q):
        good = np.isfinite(y[run])
        modes = pod.modes[good] / pod.scale[good, None]  # values that are known alike
        off = (y[run, good] - pod.offset[good]) / pod.scale[good] - modes @ expected[run]
        known = joint[:, run, run]
        floor = EXACT * float(np.mean(modes**2 @ known))
        factor = pod.truncation_factor[good] / pod.scale[good, None]
        weighed = _by_truncation(modes, factor, floor)
        told, pulled = weighed.T @ modes, weighed.T @ off
        noisier = _disagreement(told, pulled, known)
        information[:, run, :, run] = told / noisier
        pull[:, run] = pulled / noisier
    prior = np.zeros((k, q, k, q))
    prior[np.arange(k), :, np.arange(k), :] = joint
    size = k * q
    # With P the prior's and J the information's matrix the mean is P (1 + J P)^-1 of the pull.
    matrix = np.eye(size) + information.reshape(size, size) @ prior.reshape(size, size)
    own: Array = np.asarray(np.linalg.solve(matrix, pull.ravel()), dtype=np.float64)
    return replace(modal, processes=processes.with_further(x, own.reshape(k, q)))


def _by_truncation(modes: Array, factor: Array, floor: float) -> Array:
    """(n_obs, k) inverse covariance of what modes leave out, times modes (n_obs, k).

    The covariance is factor @ factor.T and its mean diagonal, or the floor, once more for each
    value by itself: that of a few runs has few directions, and errors in the others are not zero.
    """
    white = max(float(np.mean(np.sum(factor**2, axis=1))), floor)
    small = white * np.eye(factor.shape[1]) + factor.T @ factor
    found: Array = (modes - factor @ np.linalg.solve(small, factor.T @ modes)) / white
    return found


def _disagreement(told: Array, pulled: Array, known: Array) -> float:
    """Factor >= 1 by which a run's noise must grow for it to agree with what was known before.

    `told` (k, k) is the information of the run on its weights, `pulled` (k,) that times what they
    are off by, `known` (k,) the weights' variance before. Judged in the directions of which the run
    tells anything, by the chi-square of `AGREES`.
    """
    spread = np.sqrt(known)
    values, vectors = np.linalg.eigh(spread[:, None] * told * spread)
    new = values > LEAST_NEW
    if not new.any():
        return 1.0
    values = values[new]
    # of noise-free values it is the sum of their squares over the variance known before
    squared = (vectors[:, new].T @ (spread * pulled)) ** 2 / values
    most = float(chi2.ppf(AGREES, len(values)))

    def beyond(log_factor: float) -> float:
        return float(np.sum(squared / (np.exp(log_factor) + values))) - most

    if beyond(0.0) <= 0.0:
        return 1.0
    return float(np.exp(brentq(beyond, 0.0, np.log(squared.sum() / most))))
