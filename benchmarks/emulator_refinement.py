"""Runs needed on narrow, curved posteriors: placed by `propose`, or by a fixed Sobol design.

Both are stopped by the same rule, which does not know the truth, and their errors then are told as
they are. Beside it, the fewest runs of each after which the truth is met, which nobody could know.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from calib.study.refinement import APART
from surrogate import Emulator, TrainingSet, predicted_shift, propose, sobol_design
from surrogate.gp import Array

BOX = np.array([[0.0, 1.0], [0.0, 1.0]])
TRAVEL = np.array([0.6, 1.0, 1.4])
NOISE = 0.01
"""SD of a force over the force"""
N_FIRST, N_ADDED, N_MOST = 8, 2, 96
TOLERANCE = 0.05
"""error of the posterior mean, in posterior SDs, to be reached"""
_GRID = 121
_TRUTH = np.array([[0.4, 0.35]])


@dataclass(frozen=True)
class Problem:
    """Forces of r and s with a ripple that no short polynomial follows."""

    waves: float
    """ripple's angle per unit of r + s^2"""
    height: float
    """of the ripple, in ln(force)"""

    def model(self, x: Array) -> tuple[Array, Array]:
        """Forces (n, 3) and derivatives (n, 3, 2) that see r + 3 (s - 0.5)^2 far better than s."""
        r, s = x[:, :1], x[:, 1:]
        angle = self.waves * (r + s**2) + TRAVEL
        curve = r + 3.0 * (s - 0.5) ** 2
        log = 0.8 * TRAVEL * curve + 0.1 * TRAVEL**2 * s + self.height * np.sin(angle)
        slope = self.height * self.waves * np.cos(angle)
        by_r = 0.8 * TRAVEL + slope
        by_s = 0.8 * TRAVEL * 6.0 * (s - 0.5) + 0.1 * TRAVEL**2 + slope * 2.0 * s
        force = 20.0 * np.exp(log)
        return force, force[:, :, None] * np.stack([by_r, by_s], axis=2)

    def log_likelihood(self, force: Array, _: Array | None = None) -> Array:
        """(n,) of forces (n, 3) for data without noise at r = 0.4, s = 0.35."""
        data = self.model(_TRUTH)[0]
        found: Array = -0.5 * np.sum(((force - data) / (NOISE * data)) ** 2, axis=1)
        return found

    def posterior(self, force: Array) -> Array:
        """(n,) shares of the posterior on a grid."""
        log = self.log_likelihood(force)
        weights = np.exp(log - log.max())
        normalised: Array = weights / weights.sum()
        return normalised


PROBLEMS = (Problem(12.0, 0.1), Problem(8.0, 0.1), Problem(5.0, 0.1))
"""the first is the hardest"""


class Needed(NamedTuple):
    """Runs of one way of placing them."""

    stopped: int
    """when the rule says that more would change nothing"""
    error: float
    """of the posterior then: largest of mean and SD, in true posterior SDs"""
    enough: int | None
    """fewest from which on, twice in a row, the error is below the tolerance"""


def refinement_figures() -> dict[str, Any]:
    """Runs with refinement over runs of a fixed design: of the first problem, and of each."""
    grid = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, _GRID)] * 2), axis=-1).reshape(-1, 2)
    each = []
    for problem in PROBLEMS:
        refined, fixed = (_needed(problem, grid, place) for place in (_proposed, _next_of_design))
        each.append(
            {
                **asdict(problem),
                "refinement_run_ratio": refined.stopped / fixed.stopped,
                "refined": refined._asdict(),
                "fixed": fixed._asdict(),
            }
        )
    return {"refinement_run_ratio": each[0]["refinement_run_ratio"], "refinement": each}


def _moments(grid: Array, weights: Array) -> tuple[Array, Array]:
    mean = weights @ grid
    return mean, np.sqrt(weights @ (grid - mean) ** 2)


def _error(problem: Problem, grid: Array, truth: Array, emulator: Emulator) -> float:
    """Largest error of posterior mean and SD, in true posterior SDs."""
    mean, deviation = _moments(grid, truth)
    found, spread = _moments(grid, problem.posterior(emulator.unit_force(grid)[0]))
    off = np.maximum(np.abs(found - mean), np.abs(spread - deviation)) / deviation
    return float(off.max())


def _fit(problem: Problem, x: Array) -> Emulator:
    force, gradient = problem.model(x)
    return Emulator.fit(TrainingSet(x, force, None, 0, gradient), 1, n_restarts=0)


Place = Callable[[Emulator, Array, Array, np.random.Generator], Array]
"""(N_ADDED or fewer, 2) next runs of an emulator, a posterior sample, runs so far, a generator"""


def _proposed(emulator: Emulator, sample: Array, _: Array, rng: np.random.Generator) -> Array:
    return propose(emulator, sample, N_ADDED, rng, force_noise=NOISE, apart=APART)


def _next_of_design(_: Emulator, __: Array, x: Array, ___: np.random.Generator) -> Array:
    return sobol_design(len(x) + N_ADDED, BOX, 1)[len(x) :]


def _needed(problem: Problem, grid: Array, place: Place) -> Needed:
    """Follow one way of placing runs until the rule stops it.

    The rule: the predicted shift is small twice in a row. Once is not enough, as an emulator may be
    sure of a part of the box where it has not been.
    """
    rng, truth = np.random.default_rng(0), problem.posterior(problem.model(grid)[0])
    x, small, good, enough = sobol_design(N_FIRST, BOX, 1), 0, 0, None
    while len(x) <= N_MOST:
        emulator = _fit(problem, x)
        error = _error(problem, grid, truth, emulator)
        good = good + 1 if error < TOLERANCE else 0
        if good == 2 and enough is None:
            enough = len(x) - N_ADDED
        weights = problem.posterior(emulator.unit_force(grid)[0])
        sample = grid[rng.choice(len(grid), 400, p=weights)]
        shift = predicted_shift(emulator, sample, problem.log_likelihood, 20, rng)
        small = small + 1 if shift.is_small else 0
        if small == 2:
            return Needed(len(x), error, enough)
        x = np.vstack([x, place(emulator, sample, x, rng)])
    raise RuntimeError(f"more than {N_MOST} runs are needed")
