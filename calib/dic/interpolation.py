"""Grey values between pixels: cubic and quintic B-splines (Unser 1999, IEEE Sig. Proc. Mag. 16).

Images are float64 arrays (rows, columns) in grey levels; x counts columns and y rows, px.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy import ndimage

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


@njit(cache=True, nogil=True, fastmath=FAST, inline="always")
def weights3(t):  # type: ignore[no-untyped-def]
    """Weights of the coefficients at -1, 0, 1, 2 for the place t in [0, 1)."""
    s = 1.0 - t
    a = s * s * s / 6.0
    d = t * t * t / 6.0
    b = 2.0 / 3.0 - t * t + 3.0 * d
    return a, b, 1.0 - a - b - d, d


@njit(cache=True, nogil=True, fastmath=FAST, inline="always")
def weights5(t):  # type: ignore[no-untyped-def]
    """Weights of the coefficients at -2 to 3 for the place t in [0, 1)."""
    s = 1.0 - t
    t2, s2 = t * t, s * s
    a = s2 * s2 * s / 120.0
    f = t2 * t2 * t / 120.0
    c = 0.55 - t2 * (0.5 - t2 * 0.25) - 10.0 * f
    d = 0.55 - s2 * (0.5 - s2 * 0.25) - 10.0 * a
    x = 1.0 + t
    b = 0.425 + x * (0.625 + x * (-1.75 + x * (1.25 + x * (-0.375 + x / 24.0))))
    return a, b, c, d, 1.0 - a - b - c - d - f, f


@njit(cache=True, nogil=True, fastmath=FAST)
def value3(coefficients, x, y):  # type: ignore[no-untyped-def]
    """Cubic spline at x, y inside the image."""
    ix, iy = int(x), int(y)
    a, b, c, d = weights3(x - ix)
    e, f, g, h = weights3(y - iy)
    ix += PAD - 1
    iy += PAD - 1
    r0, r1, r2, r3 = (
        coefficients[iy],
        coefficients[iy + 1],
        coefficients[iy + 2],
        coefficients[iy + 3],
    )
    return (
        a * (e * r0[ix] + f * r1[ix] + g * r2[ix] + h * r3[ix])
        + b * (e * r0[ix + 1] + f * r1[ix + 1] + g * r2[ix + 1] + h * r3[ix + 1])
        + c * (e * r0[ix + 2] + f * r1[ix + 2] + g * r2[ix + 2] + h * r3[ix + 2])
        + d * (e * r0[ix + 3] + f * r1[ix + 3] + g * r2[ix + 3] + h * r3[ix + 3])
    )


@njit(cache=True, nogil=True, fastmath=FAST)
def value5(coefficients, x, y):  # type: ignore[no-untyped-def]
    """Quintic spline at x, y inside the image."""
    ix, iy = int(x), int(y)
    a, b, c, d, e, f = weights5(x - ix)
    q = weights5(y - iy)
    ix += PAD - 2
    iy += PAD - 2
    total = 0.0
    for k in range(6):
        row = coefficients[iy + k]
        along = (
            a * row[ix]
            + b * row[ix + 1]
            + c * row[ix + 2]
            + d * row[ix + 3]
            + e * row[ix + 4]
            + f * row[ix + 5]
        )
        total += q[k] * along
    return total


@njit(cache=True, nogil=True, fastmath=FAST)
def values_at(coefficients, is_quintic, x, y):  # type: ignore[no-untyped-def]
    """(n,) values of a spline at x, y (n,), px; NaN outside the image."""
    out = np.empty(x.size)
    bottom, right = coefficients.shape[0] - 2 * PAD - 1, coefficients.shape[1] - 2 * PAD - 1
    for i in range(x.size):
        if not (0.0 <= x[i] <= right and 0.0 <= y[i] <= bottom):
            out[i] = np.nan
        elif is_quintic:
            out[i] = value5(coefficients, x[i], y[i])
        else:
            out[i] = value3(coefficients, x[i], y[i])
    return out


def grid_slopes(spline: Spline) -> tuple[Array, Array]:
    """Derivatives (h, w) of a spline by x and by y at the pixels, grey levels per px."""
    value, slope = AT_PIXEL[5 if spline.is_quintic else 3]
    inner = (slice(PAD, -PAD), slice(PAD, -PAD))
    out = []
    for across, along in ((value, slope), (slope, value)):
        rows = ndimage.correlate1d(spline.coefficients, across, axis=0)
        out.append(np.ascontiguousarray(ndimage.correlate1d(rows, along, axis=1)[inner]))
    return out[0], out[1]
