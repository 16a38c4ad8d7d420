"""Where to run the model next: where it lowers the emulator's variance most over the posterior."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from surrogate.design import check_count
from surrogate.emulator import Emulator
from surrogate.expected_gain import Gain
from surrogate.gp import GaussianProcesses

Array = npt.NDArray[np.float64]

MAX_ROWS = 450
"""values and derivatives of the draws among which runs are chosen"""
MAX_PLACES = 300
"""draws over which the variance is averaged"""
MOST_DISTINCT = 5000
"""draws that are looked at for whether there is a run"""
AT_A_RUN = 1e-9
"""distance in the unit box of the inputs up to which a draw is that of a run"""
MAX_JOINT = 1000
"""draws at which errors are drawn jointly: room grows with their square, time with their cube"""
STOP_BELOW = 0.05
"""predicted change of the posterior mean, in posterior SDs, below which more runs change nothing"""

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
    apart: float = 0.0,
) -> Array:
    """(n, d) points for new runs that lower the emulator's variance most where the posterior is.

    `posterior_sample` (m, d) are draws of the emulator's inputs. The variance is that of the force
    over (`force_noise` times the force) squared, summed over steps, plus that of the field's
    weights over `field_noise` [mm] squared: what matters against measurement noise. Of a few
    hundred draws each point is the one whose run, derivatives included, takes most of the mean
    variance over draws away. It is then counted as made, so a batch spreads by itself. Draws at
    which the emulator has a run already are none of them, and no two points lie within `apart` of
    each other, a share of the emulator's bounds in every input: there are fewer where draws do.
    Raises ValueError for a sample of another shape or with draws that are not finite, fewer
    distinct draws than points, n < 1, or a noise that is not above 0.
    """
    if not 0.0 <= apart < np.inf:
        raise ValueError(f"apart: expected a finite share of at least 0, found {apart}")
    for name, noise in (("force_noise", force_noise), ("field_noise", field_noise)):
        if not 0.0 < noise < np.inf:
            raise ValueError(f"{name}: expected a finite number above 0, found {noise}")
    sample = _checked(emulator, posterior_sample)
    distinct = _some(np.unique(sample, axis=0), MOST_DISTINCT, rng)
    candidates = _new(emulator.force.processes, distinct)
    check_count(n)
    if n > len(candidates):
        raise ValueError(f"n: expected 1 to {len(candidates)} (distinct new draws), found {n}")
    n_kept = max(MAX_ROWS // (1 + sample.shape[1]), n)
    candidates = _some(candidates, n_kept, rng)
    places = _some(sample, MAX_PLACES, rng)
    weight = _force_weight(emulator, force_noise)
    gains = [Gain.of(emulator.force.processes, candidates, places, weight)]
    if emulator.field is not None:
        weight = _field_weight(emulator, field_noise)
        gains.append(Gain.of(emulator.field.processes, candidates, places, weight))
    chosen: list[int] = []
    free = np.ones(len(candidates), dtype=bool)
    within = apart * np.ptp(emulator.bounds, axis=1)
    while len(chosen) < n and free.any():
        score = np.sum([gain.total for gain in gains], axis=0)
        chosen.append(int(np.argmax(np.where(free, score, -np.inf))))
        free &= (np.abs(candidates - candidates[chosen[-1]]) > within).any(axis=1)
        gains = [gain.given(chosen[-1]) for gain in gains]
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
    Raises ValueError for a sample of more than 1000 draws, numbers that are constant or not finite,
    and for less than one draw of the error.
    """
    sample = _checked(emulator, posterior_sample)
    if len(sample) > MAX_JOINT:
        raise ValueError(
            f"posterior_sample: expected at most {MAX_JOINT} draws, at all of which errors are "
            f"drawn together, found {len(sample)}: take some of them"
        )
    compared = sample if quantities is None else np.asarray(quantities, dtype=np.float64)
    if n_draws < 1:
        raise ValueError(f"n_draws: expected 1 or more, got {n_draws}")
    if compared.ndim != 2 or len(compared) != len(sample) or not np.isfinite(compared).all():
        raise ValueError(
            f"quantities: expected {len(sample)} finite rows, got shape {compared.shape}"
        )
    mean, deviation = compared.mean(axis=0), compared.std(axis=0)
    if not (np.ptp(compared, axis=0) > 0.0).all():
        raise ValueError("quantities: expected numbers that vary over the draws, found a constant")
    processes = emulator.force.processes
    y = processes.mean(sample)
    y_errors = _draws(processes, sample, n_draws, rng)
    weights, weight_errors = None, None
    if emulator.field is not None:
        weights = emulator.field.processes.mean(sample)
        weight_errors = _draws(emulator.field.processes, sample, n_draws, rng)
    base = log_likelihood(_unit_force(emulator, y), weights)
    if not np.isfinite(base).all():
        raise ValueError("log_likelihood: expected finite values at draws of the posterior")
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


def _force_weight(emulator: Emulator, noise: float) -> Array:
    """(k,) weight of each mode's variance: relative variance over that of the noise."""
    modes = emulator.force.pod.modes
    # On the logarithmic scale errors are relative as they are.
    mean = 1.0 if emulator.force_scale.log else emulator.force.pod.offset[:, None]
    relative = modes / mean
    weight: Array = np.sum(relative**2, axis=0) / noise**2
    return weight


def _field_weight(emulator: Emulator, noise: float) -> Array:
    """(k,) weight of each mode's variance: that of all displacements over that of the noise."""
    weight: Array = np.sum(emulator.field_modes**2, axis=0) / noise**2
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


def _new(processes: GaussianProcesses, points: Array) -> Array:
    """Those of points (m, d) at which there is no run yet."""
    off = np.abs(processes.scaled(points)[:, None] - processes.inputs).max(axis=2)
    new: Array = points[off.min(axis=1) > AT_A_RUN]
    return new


def _some(points: Array, n: int, rng: np.random.Generator) -> Array:
    """All points or n of them, in their order."""
    if len(points) <= n:
        return points
    return points[np.sort(rng.choice(len(points), n, replace=False))]


def _checked(emulator: Emulator, sample: Array) -> Array:
    sample = np.asarray(sample, dtype=np.float64)
    d = len(emulator.bounds)
    if sample.ndim != 2 or sample.shape[1] != d or len(sample) <= d:
        raise ValueError(
            f"posterior_sample: expected shape (m, {d}) with m above {d}, found {sample.shape}"
        )
    if not np.isfinite(sample).all():
        raise ValueError("posterior_sample: expected finite draws, found infinite ones or NaN")
    if not (np.ptp(sample, axis=0) > 0.0).all():
        raise ValueError("posterior_sample: must vary in every input")
    if not spans_inputs(sample):
        raise ValueError(
            f"posterior_sample: expected draws that span {d} inputs, found all on a line or plane"
        )
    return sample


def spans_inputs(sample: Array) -> bool:
    """Whether draws (m, d) vary in all directions, not only along a line or plane."""
    m, d = sample.shape
    if m <= d or not np.ptp(sample, axis=0).all():
        return False
    unit = (sample - sample.mean(axis=0)) / sample.std(axis=0)
    return bool(np.linalg.matrix_rank(unit) == d)
