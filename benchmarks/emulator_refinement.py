"""Runs needed on a narrow, curved posterior: placed by `propose`, or by a fixed design."""

from __future__ import annotations

import numpy as np

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
_WAVES = 12.0


def refinement_run_ratio() -> dict[str, float]:
    """Runs with refinement over runs of a fixed design, and either number."""
    grid = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, _GRID)] * 2), axis=-1).reshape(-1, 2)
    truth = _posterior(_model(grid)[0])
    refined, fixed = _refined(grid, truth), _fixed(grid, truth)
    return {
        "refinement_run_ratio": refined / fixed,
        "refinement_runs": float(refined),
        "fixed_runs": float(fixed),
    }


def _model(x: Array) -> tuple[Array, Array]:
    """Forces (n, 3) and their derivatives (n, 3, 2) that see r + 3 (s - 0.5)^2 far better than s.

    A ripple of 10 % that no short polynomial follows makes the emulator work.
    """
    r, s = x[:, :1], x[:, 1:]
    curve = r + 3.0 * (s - 0.5) ** 2
    ripple = 0.1 * np.sin(_WAVES * (r + s**2) + TRAVEL)
    log = 0.8 * TRAVEL * curve + 0.1 * TRAVEL**2 * s + ripple
    slope = 0.1 * _WAVES * np.cos(_WAVES * (r + s**2) + TRAVEL)
    by_r = 0.8 * TRAVEL + slope
    by_s = 0.8 * TRAVEL * 6.0 * (s - 0.5) + 0.1 * TRAVEL**2 + slope * 2.0 * s
    force = 20.0 * np.exp(log)
    return force, force[:, :, None] * np.stack([by_r, by_s], axis=2)


_DATA = _model(np.array([[0.4, 0.35]]))[0]


def _log_likelihood(force: Array, _: Array | None = None) -> Array:
    found: Array = -0.5 * np.sum(((force - _DATA) / (NOISE * _DATA)) ** 2, axis=1)
    return found


def _posterior(force: Array) -> Array:
    log = _log_likelihood(force)
    weights = np.exp(log - log.max())
    normalised: Array = weights / weights.sum()
    return normalised


def _moments(grid: Array, weights: Array) -> tuple[Array, Array]:
    mean = weights @ grid
    return mean, np.sqrt(weights @ (grid - mean) ** 2)


def _error(grid: Array, truth: Array, emulator: Emulator) -> float:
    """Largest error of posterior mean and SD, in true posterior SDs."""
    mean, deviation = _moments(grid, truth)
    found, spread = _moments(grid, _posterior(emulator.unit_force(grid)[0]))
    off = np.maximum(np.abs(found - mean), np.abs(spread - deviation)) / deviation
    return float(off.max())


def _fit(x: Array) -> Emulator:
    force, gradient = _model(x)
    return Emulator.fit(TrainingSet(x, force, None, 0, gradient), 1, n_restarts=0)


def _fixed(grid: Array, truth: Array) -> int:
    """Fewest runs of the fixed design from which on the tolerance holds, twice in a row."""
    good = 0
    for n in range(N_FIRST, N_MOST + 1, N_ADDED):
        good = good + 1 if _error(grid, truth, _fit(sobol_design(n, BOX, 1))) < TOLERANCE else 0
        if good == 2:
            return n - N_ADDED
    raise RuntimeError(f"the fixed design needs more than {N_MOST} runs")


def _refined(grid: Array, truth: Array) -> int:
    """Runs after which the loop stops by its own rule; the tolerance must then hold."""
    rng = np.random.default_rng(0)
    x = sobol_design(N_FIRST, BOX, 1)
    while len(x) <= N_MOST:
        emulator = _fit(x)
        weights = _posterior(emulator.unit_force(grid)[0])
        sample = grid[rng.choice(len(grid), 400, p=weights)]
        shift = predicted_shift(emulator, sample, _log_likelihood, 20, rng)
        if shift.is_small:
            error = _error(grid, truth, emulator)
            print(f"  stopped after {len(x)} runs, off by {error:.3f} posterior SDs")
            if error < TOLERANCE:
                return len(x)
        x = np.vstack([x, propose(emulator, sample, N_ADDED, rng, force_noise=NOISE)])
    raise RuntimeError(f"refinement needs more than {N_MOST} runs")
