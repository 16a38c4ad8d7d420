"""Where to run the model next: emulator variance times posterior mass, and when to stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import gaussian_kde

from surrogate.emulator import Emulator
from surrogate.gp import GaussianProcesses

Array = npt.NDArray[np.float64]

MAX_CANDIDATES = 400
"""points of the posterior sample among which runs are chosen"""
STOP_BELOW = 0.05
"""predicted change of the posterior mean, in posterior SDs, below which more runs change nothing"""
_JITTER = 1e-8

LogLikelihood = Callable[[Array, Array | None], Array]
"""(m,) of unit forces (m, n_step) N and field weights (m, k) mm, if any, row by row"""


def propose(
    emulator: Emulator,
    posterior_sample: Array,
    n: int,
    rng: np.random.Generator,
    *,
    force_noise: float = 0.01,
    field_noise: float = 0.01,
) -> Array:
    """(n, d) points for new runs, each where emulator variance times posterior mass is largest.

    `posterior_sample` (m, d) are draws of the emulator's inputs. The variance is that of the force
    over (`force_noise` times the force) squared, summed over steps, plus that of the field's
    weights over `field_noise` [mm] squared: what matters against measurement noise. After each
    point it is updated for the run to come, which needs no values; so a batch spreads by itself.
    Raises ValueError for a sample of another shape, fewer distinct draws than points, or n < 1.
    """
    sample = _checked(emulator, posterior_sample)
    candidates = np.unique(sample, axis=0)
    if not 1 <= n <= len(candidates):
        raise ValueError(f"n: expected 1 to {len(candidates)} (distinct draws), found {n}")
    if len(candidates) > max(MAX_CANDIDATES, n):
        kept = rng.choice(len(candidates), max(MAX_CANDIDATES, n), replace=False)
        candidates = candidates[np.sort(kept)]
    mass = _mass(sample, candidates)
    parts = [
        _Uncertainty.of(emulator.force.processes, candidates, _force_weight(emulator, force_noise))
    ]
    if emulator.field is not None:
        weight = np.full(len(emulator.field.processes.offset), field_noise**-2)
        parts.append(_Uncertainty.of(emulator.field.processes, candidates, weight))
    chosen: list[int] = []
    for _ in range(n):
        score = mass * sum(part.total for part in parts)
        score[chosen] = -np.inf
        chosen.append(int(np.argmax(score)))
        parts = [part.given(chosen[-1]) for part in parts]
    points: Array = candidates[chosen]
    return points


@dataclass(frozen=True)
class PredictedShift:
    """How far the posterior mean may move once the emulator knows better."""

    shift: Array
    """(q,) root mean square over draws of the emulator's error, in posterior SDs"""

    @property
    def is_small(self) -> bool:
        """Whether more runs would not change the answer."""
        return bool((self.shift < STOP_BELOW).all())


def predicted_shift(
    emulator: Emulator,
    posterior_sample: Array,
    log_likelihood: LogLikelihood,
    n_draws: int,
    rng: np.random.Generator,
    quantities: Array | None = None,
) -> PredictedShift:
    """Change of the posterior mean to expect from an emulator without error.

    Draws the emulator's error at the sample (m, d) jointly from its processes, weighs the sample by
    the likelihood with that error over the one without, and compares the means. `log_likelihood`
    must hold the measurement's noise alone. Weights that few draws carry understate large shifts,
    which are then far from small anyway. `quantities` (m, q) are numbers of the same draws whose
    means are compared instead of the sample's, for parameters that the emulator does not have.
    """
    sample = _checked(emulator, posterior_sample)
    compared = sample if quantities is None else quantities
    mean, deviation = compared.mean(axis=0), compared.std(axis=0)
    processes = emulator.force.processes
    y = processes.mean(sample)
    y_errors = _draws(processes, sample, n_draws, rng)
    weights, weight_errors = None, None
    if emulator.field is not None:
        weights = emulator.field.processes.mean(sample)
        weight_errors = _draws(emulator.field.processes, sample, n_draws, rng)
    base = log_likelihood(_unit_force(emulator, y), weights)
    squared = np.zeros(compared.shape[1])
    for draw in range(n_draws):
        moved = None
        if weights is not None and weight_errors is not None:
            moved = weights + weight_errors[draw]
        change = log_likelihood(_unit_force(emulator, y + y_errors[draw]), moved) - base
        probability = np.exp(change - change.max())
        shifted = probability @ compared / probability.sum()
        squared += ((shifted - mean) / deviation) ** 2
    return PredictedShift(np.sqrt(squared / n_draws))


@dataclass(frozen=True)
class _Uncertainty:
    """Covariance of processes among candidates, updated run by run."""

    covariance: Array
    """(k, m, m) in output units"""
    noise: Array
    """(k,) variance of a new run's noise"""
    weight: Array
    """(k,) or (k, m) weight of each process' variance"""

    @classmethod
    def of(cls, processes: GaussianProcesses, candidates: Array, weight: Array) -> _Uncertainty:
        noise = processes.variance_scale * np.maximum(processes.nugget, _JITTER)
        wide = weight if weight.ndim == 2 else weight[:, None]
        return cls(processes.covariance(candidates, candidates), noise, wide)

    @property
    def total(self) -> Array:
        """(m,) weighted variance, summed over processes."""
        variance = np.maximum(np.einsum("kmm->km", self.covariance), 0.0)
        total: Array = np.sum(self.weight * variance, axis=0)
        return total

    def given(self, index: int) -> _Uncertainty:
        """After a run at the candidate `index`."""
        column = self.covariance[:, :, index]
        total = np.maximum(column[:, index], 0.0) + self.noise
        gained = column[:, :, None] * column[:, None, :] / total[:, None, None]
        return _Uncertainty(self.covariance - gained, self.noise, self.weight)


def _force_weight(emulator: Emulator, noise: float) -> Array:
    """(k,) weight of each mode's variance: relative variance over that of the noise."""
    modes = emulator.force.pod.modes
    # On the logarithmic scale errors are relative as they are.
    mean = 1.0 if emulator.force_scale.log else emulator.force.pod.offset[:, None]
    relative = modes / mean
    weight: Array = np.sum(relative**2, axis=0) / noise**2
    return weight


def _unit_force(emulator: Emulator, y: Array) -> Array:
    step = np.zeros((1, emulator.n_step, emulator.n_step))
    return emulator.force_scale.force(emulator.force.pod.reconstruct(y), step)[0]


def _draws(processes: GaussianProcesses, x: Array, n_draws: int, rng: np.random.Generator) -> Array:
    """(n_draws, m, k) draws of the processes' errors at x (m, d), jointly over x."""
    joint = processes.covariance(x, x)
    draws = np.empty((n_draws, len(x), len(joint)))
    for k, matrix in enumerate(joint):
        values, vectors = np.linalg.eigh(matrix)  # semi-definite: near the runs nothing is unknown
        factor = vectors * np.sqrt(np.maximum(values, 0.0))
        draws[:, :, k] = rng.normal(size=(n_draws, len(x))) @ factor.T
    return draws


def _mass(sample: Array, candidates: Array) -> Array:
    """(m,) posterior density by a kernel estimate, up to a constant."""
    density: Array = gaussian_kde(sample.T)(candidates.T)
    return density


def _checked(emulator: Emulator, sample: Array) -> Array:
    sample = np.asarray(sample, dtype=np.float64)
    d = len(emulator.bounds)
    if sample.ndim != 2 or sample.shape[1] != d or len(sample) <= d:
        raise ValueError(
            f"posterior_sample: expected shape (m, {d}) with m above {d}, found {sample.shape}"
        )
    if not (np.ptp(sample, axis=0) > 0.0).all():
        raise ValueError("posterior_sample: must vary in every input")
    unit = (sample - sample.mean(axis=0)) / sample.std(axis=0)
    if np.linalg.matrix_rank(unit) < d:
        raise ValueError(
            f"posterior_sample: expected draws that span {d} inputs, found all on a line or plane"
        )
    return sample
