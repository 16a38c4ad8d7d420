"""Whether chains of several ensembles are long enough, and agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.inference.autocorrelation import integrated_time
from calib.inference.r_hat import r_hat_of_ensembles
from fe.response import Array

BURN_SHARE = 4  # the first quarter of the chain is discarded
BURN_TIMES = 5  # and must be at least this many autocorrelation times


@dataclass(frozen=True)
class ChainVerdict:
    """What is known of the chains so far."""

    times: Array
    """(n_ensemble, n) autocorrelation times, steps; infinite while too short to tell"""
    r_hat: float
    """largest over the coordinates; infinite while the chains are too short for their memory"""
    converged: bool
    ended: bool
    """converged, or as long as they may be"""
    expected: int
    """steps that the run will probably take"""


def what_is_missing(verdict: ChainVerdict, n_autocorrelation: float, max_r_hat: float) -> str:
    """Why chains that were stopped at their longest are not enough, to follow their message."""
    if verdict.converged:
        return ""
    # The burn-in may ask for more of a chain than the draws that are kept.
    asked = max(n_autocorrelation, BURN_TIMES * (BURN_SHARE - 1))
    lacking = f"{asked:g} times were reached"
    if np.isfinite(verdict.r_hat):  # told once they are long enough
        lacking = f"their R-hat of {verdict.r_hat:.3g} fell to {max_r_hat:g}"
    return f"; stopped at max_steps before {lacking}"


def judge(
    chains: Array | None,
    *,
    n_autocorrelation: float,
    max_r_hat: float,
    max_steps: int,
    check_every: int,
) -> ChainVerdict:
    """Verdict on chains (n_ensemble, n_step, n_walker, n), burn-in included; None before any."""
    if chains is None:
        return ChainVerdict(np.array([[np.inf]]), np.inf, False, False, max_steps)
    done = chains.shape[1]
    kept = chains[:, done // BURN_SHARE :]
    times = np.array([[integrated_time(one[:, :, i]) for i in range(one.shape[2])] for one in kept])
    needed = _steps_needed(times, n_autocorrelation)
    worst = float(r_hat_of_ensembles(kept).max()) if done >= needed else float("inf")
    converged = worst <= max_r_hat
    expected = max_steps
    if np.isfinite(needed):
        expected = min(max(int(np.ceil(needed / check_every)) * check_every, done), max_steps)
    return ChainVerdict(times, worst, converged, converged or done >= max_steps, expected)


def _steps_needed(times: Array, n_autocorrelation: float) -> float:
    """Steps, burn-in included, at which the slowest coordinate of all ensembles is served."""
    kept = n_autocorrelation * BURN_SHARE / (BURN_SHARE - 1)
    return float(times.max() * max(kept, BURN_TIMES * BURN_SHARE))
