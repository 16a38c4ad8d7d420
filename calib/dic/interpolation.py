"""Grey values between pixels: cubic and quintic B-splines (Unser 1999, IEEE Sig. Proc. Mag. 16).

Images are float64 arrays (rows, columns) in grey levels; x counts columns and y rows, px.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from fe.compiled import kernel

Array = npt.NDArray[np.float64]
PAD = 3
"""px of mirrored spline coefficients around the image, the reach of a quintic spline"""
Degree = Literal[3, 5]
FAST = {"contract", "reassoc", "nsz"}
# weights of the coefficients around a pixel for the value there and for the slope
AT_PIXEL = {
    3: (np.array([1.0, 4.0, 1.0]) / 6.0, np.array([-1.0, 0.0, 1.0]) / 2.0),
    5: (
        np.array([1.0, 26.0, 66.0, 26.0, 1.0]) / 120.0,
        np.array([-1.0, -10.0, 0.0, 10.0, 1.0]) / 24.0,
    ),
}


class Spline(NamedTuple):
    """An image as a spline."""

    coefficients: Array
    """(h + 2 PAD, w + 2 PAD)"""
    is_quintic: bool


def spline_of(image: Array, degree: Degree) -> Spline:
    """The interpolating spline of degree 3 or 5 of an image (h, w), mirrored at its border.

    Raises ValueError for another degree.
    """
    if degree not in (3, 5):
        raise ValueError(f"degree: expected 3 or 5, found {degree}")
    filtered = ndimage.spline_filter(image, degree, output=np.float64, mode="mirror")
    return Spline(np.pad(filtered, PAD, mode="reflect"), degree == 5)


# an unsigned index spares the check for negative ones; sums with signed numbers would be floats
ONE, TWO, THREE, FOUR, FIVE = (np.uint64(k) for k in range(1, 6))
SIXTH, INVERSE_24, INVERSE_120 = 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0


@kernel(nogil=True, error_model="numpy", fastmath=FAST, inline="always")
def weights3(t):  # type: ignore[no-untyped-def]
    """Weights of the coefficients at -1, 0, 1, 2 for the place t in [0, 1)."""
    s = 1.0 - t
    a = s * s * s * SIXTH
    d = t * t * t * SIXTH
    b = 2.0 / 3.0 - t * t + 3.0 * d
    return a, b, 1.0 - a - b - d, d


@kernel(nogil=True, error_model="numpy", fastmath=FAST, inline="always")
def weights5(t):  # type: ignore[no-untyped-def]
    """Weights of the coefficients at -2 to 3 for the place t in [0, 1)."""
    s = 1.0 - t
    t2, s2 = t * t, s * s
    a = s2 * s2 * s * INVERSE_120
    f = t2 * t2 * t * INVERSE_120
    c = 0.55 - t2 * (0.5 - t2 * 0.25) - 10.0 * f
    d = 0.55 - s2 * (0.5 - s2 * 0.25) - 10.0 * a
    x = 1.0 + t
    b = 0.425 + x * (0.625 + x * (-1.75 + x * (1.25 + x * (-0.375 + x * INVERSE_24))))
    return a, b, c, d, 1.0 - a - b - c - d - f, f


@kernel(nogil=True, error_model="numpy", fastmath=FAST)
def cubic_values(flat, stride, x, y, n, first, weights, out):  # type: ignore[no-untyped-def]
    """out[:n]: cubic spline at x, y inside the image, from its coefficients row after row.

    first (n,) and weights (8, n) are room to work: weights are made for all places at once, and
    each sum of coefficients is one over neighbours in memory, as vector units want it.
    """
    for i in range(n):
        ix, iy = np.floor(x[i]), np.floor(y[i])
        first[i] = (np.int64(iy) + (PAD - 1)) * stride + np.int64(ix) + (PAD - 1)
        weights[0, i], weights[1, i], weights[2, i], weights[3, i] = weights3(x[i] - ix)
        weights[4, i], weights[5, i], weights[6, i], weights[7, i] = weights3(y[i] - iy)
    for i in range(n):
        k = np.uint64(first[i])
        c0, c1, c2, c3 = 0.0, 0.0, 0.0, 0.0
        for r in range(4):
            q = weights[4 + r, i]
            c0 += q * flat[k]
            c1 += q * flat[k + ONE]
            c2 += q * flat[k + TWO]
            c3 += q * flat[k + THREE]
            k += np.uint64(stride)
        out[i] = weights[0, i] * c0 + weights[1, i] * c1 + weights[2, i] * c2 + weights[3, i] * c3


@kernel(nogil=True, error_model="numpy", fastmath=FAST)
def quintic_values(flat, stride, x, y, n, first, weights, out):  # type: ignore[no-untyped-def]
    """The same with a quintic spline and weights (12, n)."""
    w = weights
    for i in range(n):
        ix, iy = np.floor(x[i]), np.floor(y[i])
        first[i] = (np.int64(iy) + (PAD - 2)) * stride + np.int64(ix) + (PAD - 2)
        w[0, i], w[1, i], w[2, i], w[3, i], w[4, i], w[5, i] = weights5(x[i] - ix)
        w[6, i], w[7, i], w[8, i], w[9, i], w[10, i], w[11, i] = weights5(y[i] - iy)
    for i in range(n):
        k = np.uint64(first[i])
        c0, c1, c2, c3, c4, c5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for r in range(6):
            q = w[6 + r, i]
            c0 += q * flat[k]
            c1 += q * flat[k + ONE]
            c2 += q * flat[k + TWO]
            c3 += q * flat[k + THREE]
            c4 += q * flat[k + FOUR]
            c5 += q * flat[k + FIVE]
            k += np.uint64(stride)
        low = w[0, i] * c0 + w[1, i] * c1 + w[2, i] * c2
        out[i] = low + w[3, i] * c3 + w[4, i] * c4 + w[5, i] * c5


def values_at(spline: Spline, x: Array, y: Array) -> Array:
    """(n,) grey values of a spline at x, y (n,), px; NaN outside the image."""
    h, w = (side - 2 * PAD for side in spline.coefficients.shape)
    inside = (x >= 0) & (x <= w - 1) & (y >= 0) & (y <= h - 1)
    n = x.size
    out = np.empty(n)
    args = (np.where(inside, x, 0.0), np.where(inside, y, 0.0), n, np.empty(n, np.int64))
    values = quintic_values if spline.is_quintic else cubic_values
    values(spline.coefficients.ravel(), w + 2 * PAD, *args, np.empty((12, n)), out)
    return np.where(inside, out, np.nan)


def grid_slopes(spline: Spline) -> tuple[Array, Array]:
    """Derivatives (h, w) of a spline by x and by y at the pixels, grey levels per px."""
    value, slope = AT_PIXEL[5 if spline.is_quintic else 3]
    inner = (slice(PAD, -PAD), slice(PAD, -PAD))
    out = []
    for across, along in ((value, slope), (slope, value)):
        rows = ndimage.correlate1d(spline.coefficients, across, axis=0)
        out.append(np.ascontiguousarray(ndimage.correlate1d(rows, along, axis=1)[inner]))
    return out[0], out[1]
