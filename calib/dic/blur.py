"""A Gaussian blur of both images before they are correlated, and what it makes of their noise.

It takes off the highest frequencies, where interpolation errs (H. W. Schreier, J. R. Braasch,
M. A. Sutton, Opt. Eng. 39 (2000) 2915), and some of the speckle's slopes with them: less bias, more
random error.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy import ndimage

from calib.dic.interpolation import Array

REACH = 4.0
"""SDs to each side"""


def taps(blur: float) -> Array:
    """(2 k + 1,) weights of a Gaussian of SD `blur` px, of sum 1; one for none."""
    if blur == 0.0:
        return np.ones(1)
    k = np.arange(-np.ceil(REACH * blur), np.ceil(REACH * blur) + 1)
    weights = np.exp(-0.5 * (k / blur) ** 2)
    return np.asarray(weights / weights.sum())


def blurred(image: Array, blur: float) -> Array:
    """An image (h, w) blurred along both axes, mirrored at its border; itself for none."""
    if blur == 0.0:
        return image
    return _along_both(image, taps(blur), "mirror")


def growth(slope_x: Array, slope_y: Array, blur: float) -> Array:
    """(3,) by how much blurred white noise weighs more than white noise of the same variance.

    On sums with the slopes (h, w) in x and in y, and on sums over pixels: f' R f / f' f, where R is
    the noise's correlation between pixels. Ones without a blur.
    """
    if blur == 0.0:
        return np.ones(3)
    weights = taps(blur)
    correlation = np.convolve(weights, weights)
    correlation /= correlation.max()
    slopes = [
        np.sum(slope * _along_both(slope, correlation, "constant")) / max(np.sum(slope**2), 1e-300)
        for slope in (slope_x, slope_y)
    ]
    return np.array([*slopes, correlation.sum() ** 2])


def _along_both(image: Array, weights: Array, mode: Literal["mirror", "constant"]) -> Array:
    rows = ndimage.correlate1d(image, weights, axis=0, mode=mode)
    return np.asarray(ndimage.correlate1d(rows, weights, axis=1, mode=mode))
