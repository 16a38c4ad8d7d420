"""Bias of the interpolation: a wave over the displacement's fraction of a pixel, from the images.

A spline through the pixels has the transfer phi(v) at the frequency v [1/px]. At a fraction t of a
pixel it adds to a signal the share (phi(v - 1) - phi(v + 1)) sin(2 pi t) of itself, a quarter of a
wave late, by the aliases next to it. The correlation takes that for a displacement: its error is
C sin(2 pi t), where C is the mean of that share, weighted by the power of the slopes, over
frequencies. Source: Y. Su, Q. Zhang, Z. Gao, X. Xu, X. Wu, "Fourier-based interpolation bias
prediction in digital image correlation", Opt. Express 23 (2015) 19242; here with the slopes of the
reference, whose noise then makes no bias, and for each subset by itself, as a sum over its pixels.
Content of the scene beyond half a wave a pixel, which the sensor folds back, is not in it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

import numpy as np

from calib.dic.interpolation import FAST, Array, Degree
from fe.compiled import kernel

REACH = 8
"""px to each side of the filter; with it the share is within 6e-4 below 0.3 waves a px, 0.004 at
0.4; near half a wave, where slopes are none, it is too small"""
FREQUENCIES = 256
ALIASES = 20
PATCH = 6.0
"""px, side of a patch whose speckle is its own: a little more than a usual speckle"""


def spline_transfer(degree: int, frequency: Array) -> Array:
    """Transfer of spline interpolation of a degree at frequencies (n,) in 1/px (Unser 1999)."""
    shifted = frequency[:, None] + np.arange(-ALIASES, ALIASES + 1)
    whole = np.sum(np.sinc(shifted) ** (degree + 1), axis=1)
    return np.asarray(np.sinc(frequency) ** (degree + 1) / whole)


@cache
def error_filter(degree: Degree) -> Array:
    """(REACH,) taps of the filter that makes the error of the interpolation a quarter px off."""
    return filter_of(partial(spline_transfer, degree))


def filter_of(transfer: Callable[[Array], Array]) -> Array:
    """(REACH,) taps for an interpolation with this transfer of frequencies (n,) in 1/px.

    Tap k weighs the difference of the pixels k + 1 to the right and to the left. Least squares over
    frequencies, weighted towards the lower ones, which speckle has most of.
    """
    v = (np.arange(FREQUENCIES) + 0.5) / (2 * FREQUENCIES)
    waves = 2 * np.sin(2 * np.pi * v[:, None] * np.arange(1, REACH + 1))
    weight = np.cos(np.pi * v) ** 3
    share = weight * (transfer(v - 1) - transfer(v + 1))
    return np.asarray(np.linalg.lstsq(waves * weight[:, None], share, rcond=None)[0])


@kernel(nogil=True, error_model="numpy", fastmath=FAST)
def differences(image, taps, out_x, out_y):  # type: ignore[no-untyped-def]
    """Sums of taps (n,) times differences of pixels to both sides, along rows and columns.

    image (h, w); borders mirrored. Into out_x and out_y (h, w).
    """
    h, w = image.shape
    n = taps.size
    # one row with its mirrored borders: slices of it let the loops be vectors
    line = np.empty(w + 2 * n)
    for j in range(h):
        line[n : n + w] = image[j]
        for k in range(1, n + 1):
            line[n - k] = image[j, min(k, w - 1)]
            line[n + w - 1 + k] = image[j, max(w - 1 - k, 0)]
        row, column = out_x[j], out_y[j]
        row[:] = 0.0
        column[:] = 0.0
        for k in range(1, n + 1):
            tap = taps[k - 1]
            ahead, behind = line[n + k : n + k + w], line[n - k : n - k + w]
            for i in range(w):
                row[i] += tap * (ahead[i] - behind[i])
            below, above = j + k, abs(j - k)
            if below > h - 1:
                below = max(2 * (h - 1) - below, 0)
            lower, upper = image[below], image[min(above, h - 1)]
            for i in range(w):
                column[i] += tap * (lower[i] - upper[i])


def error_images(image: Array, degree: Degree) -> tuple[Array, Array]:
    """What interpolation a quarter px off in x, and in y, adds to an image (h, w), grey levels."""
    along, down = np.empty_like(image), np.empty_like(image)
    differences(image, error_filter(degree), along, down)
    return along, down


@kernel(nogil=True, error_model="numpy")
def mean_wave(extent_x, extent_y):  # type: ignore[no-untyped-def]
    """Share of a wave's square that is left over a subset in which its phase grows by these waves.

    Of a field that stretches the subset across whole pixels nothing is left on average.
    """
    share = 1.0
    for extent in (extent_x, extent_y):
        if abs(extent) > 1e-6:
            share *= np.sin(np.pi * extent) / (np.pi * extent)
    return share * share


@kernel(nogil=True, error_model="numpy", fastmath=FAST)
def wave_size(  # type: ignore[no-untyped-def]
    sub, error_x, error_y, x, y, radius, p, variance, noise, diagonal, out
):
    """Size of the wave at the displacement found, u and v, px, into out (2,).

    Where the displacement varies over the subset, patches of different speckle add what they make
    differently, at random phases. sub: the subset as `load` leaves it; error_x, error_y (h, w):
    `error_images`; diagonal (2,) of the Hessian; variance of the noise, and a Noise of what it does
    to slopes and to their products with the errors.
    """
    h, w = error_x.shape
    sums = np.zeros(2)
    count = 0.0
    left = max(int(x) - radius, 0)
    right = min(int(x) + radius + 1, w)
    for j in range(2 * radius + 1):
        row = int(y) - radius + j
        if not 0 <= row < h:
            continue
        along, down = 0.0, 0.0
        for i in range(left, right):
            k = i - (int(x) - radius)
            along += sub[1, j, k] * error_x[row, i]
            down += sub[2, j, k] * error_y[row, i]
            count += sub[3, j, k]
        sums[0] += along
        sums[1] += down
    side = 2.0 * radius + 1.0
    patches = (side / PATCH) ** 2
    for k in range(2):
        top = sums[k] - count * variance * noise.error
        bottom = max(diagonal[k] - count * variance * noise.slope, 0.25 * diagonal[k])
        kept = mean_wave(p[2 + 2 * k] * side, p[3 + 2 * k] * side)
        square = kept * np.sin(2.0 * np.pi * p[k]) ** 2 + 0.5 * (1.0 - kept) / patches
        out[k] = abs(top / bottom) * np.sqrt(square)
