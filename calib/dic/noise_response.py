"""What splines make of white noise of the pixels, blurred before or not."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from calib.dic.blur import taps
from calib.dic.interpolation import AT_PIXEL, Array, Degree, weights3, weights5
from calib.dic.interpolation_bias import error_filter

TABLE = 64
FREQUENCIES = 256


class Noise(NamedTuple):
    """Variances for noise of variance 1 in the pixels (after the blur)."""

    slope: float
    """of the slope at a pixel, 1/px^2"""
    error: float
    """covariance of the slope and the interpolation's error a quarter px off, 1/px"""
    values: Array
    """(TABLE + 1,) of the value at the places 0 to 1 between two pixels of a line"""


@cache
def noise_of_spline(degree: Degree, blur: float = 0.0) -> Noise:
    """By the transfer of a spline at all frequencies of a line; blur: SD of a Gaussian, px."""
    v = (np.arange(FREQUENCIES) + 0.5) / (2 * FREQUENCIES)
    kernel, reach = taps(blur), degree // 2
    power = _transfer(kernel, -(kernel.size // 2), v).real ** 2
    power = power / power.mean()
    at_pixel, slope = AT_PIXEL[degree]
    coefficients = 1.0 / _transfer(at_pixel, -reach, v).real
    slopes = _transfer(slope, -reach, v).imag * coefficients
    tap = error_filter(degree)
    error = 2.0 * np.sin(2.0 * np.pi * v[:, None] * np.arange(1, tap.size + 1)) @ tap
    values = []
    for t in np.linspace(0, 1, TABLE + 1):
        weights = np.array(weights5(t) if degree == 5 else weights3(t))
        between = np.abs(_transfer(weights, -reach, v) * coefficients) ** 2
        values.append(float(np.mean(power * between)))
    return Noise(
        float(np.mean(power * slopes**2)), float(np.mean(power * slopes * error)), np.array(values)
    )


def _transfer(weights: Array, first: int, frequency: Array) -> Array:
    """(n,) complex: weights of the pixels first, first + 1 ... for waves at frequencies (n,)."""
    k = first + np.arange(weights.size)
    return np.asarray(np.exp(2j * np.pi * frequency[:, None] * k) @ weights)
