"""Gaussian noise on a regular grid of points, correlated over a length."""

from __future__ import annotations

import numpy as np
from scipy.fft import fft2, next_fast_len

from fe.response import Array

REACH = 8.0
"""correlation lengths that the torus goes beyond the grid: e^-8 is left of a correlation"""


def torus_amplitudes(grid: tuple[int, int], spacing: tuple[float, float], length: float) -> Array:
    """Square roots of the eigenvalues of the correlation exp(-d / length) on a torus.

    The torus holds the grid and its surroundings, so that no point sees another from both sides
    (circulant embedding: Dietrich and Newsam, SIAM J. Sci. Comput. 18, 1997). Eigenvalues below
    0, which long lengths leave, are taken as 0, and the others hold the variance of all.
    `spacing` and `length` in mm.
    """
    shape = [
        next_fast_len(n + int(np.ceil(min(REACH * length / step, n))))
        for n, step in zip(grid, spacing, strict=True)
    ]
    away = [
        np.minimum(np.arange(n), n - np.arange(n)) * step
        for n, step in zip(shape, spacing, strict=True)
    ]
    correlation = np.exp(-np.hypot(away[0][:, None], away[1][None, :]) / length)
    eigenvalues = fft2(correlation).real
    kept = np.maximum(eigenvalues, 0.0)
    amplitudes: Array = np.sqrt(kept / kept.sum())
    return amplitudes


def correlated_noise(
    amplitudes: Array, grid: tuple[int, int], count: int, rng: np.random.Generator
) -> Array:
    """(count, *grid) independent fields of unit variance, from `torus_amplitudes`."""
    pairs = -(-count // 2)
    white = rng.standard_normal((2, pairs, *amplitudes.shape))
    complex_fields = fft2(amplitudes * (white[0] + 1j * white[1]))[:, : grid[0], : grid[1]]
    fields: Array = np.concatenate([complex_fields.real, complex_fields.imag])[:count]
    return fields
