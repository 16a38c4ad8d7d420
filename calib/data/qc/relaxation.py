"""Relaxation of the force during a hold: variation, time to constant force, force at the end."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, lsq_linear

from fe.response import Array

CONSTANT_RATE = 0.001
"""N/s, below which a force counts as constant (thesis, section 3.5.2)"""
N_TIMES = 12
"""relaxation times of the fit, evenly spaced in their logarithm"""


class Relaxation(NamedTuple):
    """Force of one hold."""

    force: float
    """N, mean over the window at the end of the hold"""
    force_sd: float
    """N, SD of that mean by the noise of its readings; of a test also by that of the zero"""
    noise_sd: float
    """N, SD of one reading about the fitted relaxation"""
    variation_percent: float
    """100 (F_max - F_min) / F_ave of the fitted relaxation (thesis, Eq. 3.1)"""
    raw_variation_percent: float
    """the same of the readings themselves, noise included, as the thesis has it"""
    time_to_constant: float
    """s from the start of the hold to a rate below 0.001 N/s; NaN when it lasts longer"""
    final_rate: float
    """N/s at the end of the hold"""


class Prony(NamedTuple):
    """Force F(t) = settled + sum amplitude exp(-t / time)."""

    settled: float
    """N"""
    amplitude: Array
    """(n,) N, none negative"""
    times: Array
    """(n,) s"""

    def force(self, t: Array) -> Array:
        """(m,) force [N] at the times t (m,) s after the start of the hold."""
        decay: Array = np.exp(-np.asarray(t)[:, None] / self.times) @ self.amplitude
        return self.settled + decay

    def rate(self, t: float) -> float:
        """Rate of the force at t, N/s."""
        return float(-(self.amplitude / self.times * np.exp(-t / self.times)).sum())


def fit_prony(t: Array, force: Array) -> Prony:
    """Least squares with amplitudes that are not negative: the force only relaxes.

    t (n,) s from the start of the hold, force (n,) N.
    """
    span = float(t[-1] - t[0])
    shortest = max(float(np.median(np.diff(t))), span / 200)
    times = np.geomspace(shortest, 1.5 * span, N_TIMES)
    columns = np.column_stack([np.ones_like(t), np.exp(-t[:, None] / times)])
    low = np.zeros(1 + N_TIMES)
    low[0] = -np.inf  # the settled force is not bounded
    found: Array = lsq_linear(columns, force, bounds=(low, np.inf), method="bvls").x
    return Prony(float(found[0]), found[1:], times)


def relaxation(time: Array, force: Array, window: float) -> Relaxation:
    """Force of one hold from its readings: time (n,) s, force (n,) N.

    `window` is the share of the hold, at its end, over which the force is averaged.
    Raises ValueError with fewer than 5 readings.
    """
    if time.size < 5:
        raise ValueError(f"time: expected 5 or more readings of a hold, found {time.size}")
    t = time - time[0]
    prony = fit_prony(t, force)
    smooth = prony.force(t)
    residual = force - smooth
    noise = float(residual.std(ddof=min(4, time.size - 1)))
    late = t >= (1 - window) * t[-1]
    mean = float(force.mean())
    scale = 100 / mean if mean > 0 else np.nan
    return Relaxation(
        force=float(force[late].mean()),
        force_sd=float(noise * np.sqrt(inflation(residual) / np.count_nonzero(late))),
        noise_sd=noise,
        variation_percent=float(scale * (smooth.max() - smooth.min())),
        raw_variation_percent=float(scale * (force.max() - force.min())),
        time_to_constant=_time_to_constant(prony, float(t[-1])),
        final_rate=prony.rate(float(t[-1])),
    )


def inflation(residual: Array) -> float:
    """Factor by which correlated noise widens the variance of a mean: (1 + r) / (1 - r)."""
    power = float(residual @ residual)
    if power == 0:
        return 1.0
    r = float(np.clip((residual[1:] @ residual[:-1]) / power, 0.0, 0.95))
    return (1 + r) / (1 - r)


def _time_to_constant(prony: Prony, end: float) -> float:
    if prony.rate(0.0) > -CONSTANT_RATE:
        return 0.0
    if prony.rate(end) < -CONSTANT_RATE:
        return float("nan")
    return float(brentq(lambda t: prony.rate(t) + CONSTANT_RATE, 0.0, end))
