"""Integrated autocorrelation time of an ensemble's walkers."""

from __future__ import annotations

import numpy as np

from fe.response import Array

WINDOW = 5.0  # Sokal's window: the sum stops at the first lag beyond 5 times its own value


def integrated_time(values: Array) -> float:
    """Autocorrelation time, in draws, of a scalar followed by walkers (n_draw, n_walker).

    tau = 1 + 2 sum rho(t), Sokal's automatic window (A. Sokal, Monte Carlo methods in
    statistical mechanics, 1989, section 3). Autocovariances are taken about the mean of the whole
    ensemble and averaged over walkers before they are normalised: a walker that stays in its own
    place then shows as memory, and one without any variation divides by nothing. At least 1;
    infinite for a scalar that does not vary or fewer than 8 draws.
    """
    n_draw = len(values)
    off = values - values.mean()
    variance = np.mean(off**2)
    if n_draw < 8 or not variance > 0:
        return float("inf")
    spectrum = np.fft.rfft(off, n=2 * n_draw, axis=0)
    covariance = np.fft.irfft(np.abs(spectrum) ** 2, axis=0)[:n_draw].mean(axis=1) / n_draw
    times = 2.0 * np.cumsum(covariance / variance) - 1.0
    beyond = np.arange(n_draw) >= WINDOW * times
    window = int(np.argmax(beyond)) if beyond.any() else n_draw - 1
    return max(1.0, float(times[window]))
