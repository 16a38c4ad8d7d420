"""One subset: inverse compositional Gauss-Newton on the ZNSSD, compiled.

Shape functions of the offset (a, b) from the subset's centre, px, parameters p in this order:
u = p0 + p2 a + p3 b + p6 a²/2 + p7 a b + p8 b²/2,
v = p1 + p4 a + p5 b + p9 a²/2 + p10 a b + p11 b²/2.
Minimised is sum (f + df - (scale g + offset))² over p, scale and offset: scale and offset are
eliminated by projecting the Jacobian off the constants and off f, which is the Gauss-Newton step of
the ZNSSD (Pan, Li, Tong 2013, Exp. Mech. 53:1277) in its exact form. The Hessian belongs to the
reference and is made once.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from calib.dic.interpolation import FAST, PAD, shared_weights, value3, value5

N_PARAMETER = 12
# component (0: along x, 1: along y), powers of a and b, and factor of each parameter
COMPONENT = np.array([0, 1, 0, 0, 1, 1, 0, 0, 0, 1, 1, 1])
POWER_A = np.array([0, 0, 1, 0, 1, 0, 2, 1, 0, 2, 1, 0])
POWER_B = np.array([0, 0, 0, 1, 0, 1, 0, 1, 2, 0, 1, 2])
FACTOR = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5, 1.0, 0.5, 0.5, 1.0, 0.5])
# codes of Reason, which numba does not read
VALID, OUTSIDE_REGION, NO_SPECKLE, LEFT_IMAGE, NOT_CONVERGED, LOW_CORRELATION, FOLDED = range(7)
SMALLEST_DETERMINANT = 0.02


@njit(cache=True, nogil=True, fastmath=FAST)
def load_whole(image, slope_x, slope_y, mask, x, y, radius, sub):  # type: ignore[no-untyped-def]
    """Fill sub (4, side, side) with grey value, slopes and weight at a point on a pixel."""
    h, w = image.shape
    ix, iy = int(np.round(x)), int(np.round(y))
    for j in range(2 * radius + 1):
        row = iy + j - radius
        for i in range(2 * radius + 1):
            column = ix + i - radius
            if 0 <= row < h and 0 <= column < w and mask[row, column]:
                sub[0, j, i] = image[row, column]
                sub[1, j, i] = slope_x[row, column]
                sub[2, j, i] = slope_y[row, column]
                sub[3, j, i] = 1.0
            else:
                sub[:, j, i] = 0.0


@njit(cache=True, nogil=True, fastmath=FAST)
def load_between(  # type: ignore[no-untyped-def]
    coefficients, is_quintic, mask, x, y, radius, sub
):
    """The same at a point between pixels; all pixels of the subset share its weights."""
    h, w = mask.shape
    ix, iy = int(np.floor(x)), int(np.floor(y))
    wx, wy = shared_weights(x - ix, is_quintic), shared_weights(y - iy, is_quintic)
    side = 2 * radius + 1
    along = np.zeros((2, side + 5, side))
    for j in range(side + 5):
        row = iy + j - radius - 2 + PAD
        if not 0 <= row < h + 2 * PAD:
            continue
        for i in range(side):
            first = ix + i - radius - 2 + PAD
            if not 0 <= first < w + 2 * PAD - 5:
                continue
            value, slope = 0.0, 0.0
            for k in range(6):
                value += wx[0, k] * coefficients[row, first + k]
                slope += wx[1, k] * coefficients[row, first + k]
            along[0, j, i], along[1, j, i] = value, slope
    for j in range(side):
        row = iy + j - radius
        for i in range(side):
            column = ix + i - radius
            sub[:, j, i] = 0.0
            # the four pixels around the place have to be in the region
            if not (0 <= row < h - 1 and 0 <= column < w - 1):
                continue
            if not (mask[row, column] and mask[row + 1, column + 1]):
                continue
            for k in range(6):
                sub[0, j, i] += wy[0, k] * along[0, j + k, i]
                sub[1, j, i] += wy[0, k] * along[1, j + k, i]
                sub[2, j, i] += wy[1, k] * along[0, j + k, i]
            sub[3, j, i] = 1.0


@njit(cache=True, nogil=True, fastmath=FAST)
def reference_sums(sub, radius, n, hessian, ones, grey):  # type: ignore[no-untyped-def]
    """Take the mean off the grey values; fill the projected Hessian (n, n) and its projections.

    ones (n,), grey (n,): sums of each column of the Jacobian, and with the grey values.
    Returns the number of pixels and the sum of squares of the grey values.
    """
    side = 2 * radius + 1
    count, total = 0.0, 0.0
    for j in range(side):
        for i in range(side):
            count += sub[3, j, i]
            total += sub[0, j, i]
    mean = total / max(count, 1.0)
    top = 5 if n == N_PARAMETER else 3
    half = 3 if n == N_PARAMETER else 2
    products = np.zeros((3, 5, 5))
    singles = np.zeros((2, 2, 3, 3))
    row = np.empty((7, 5))
    squares = 0.0
    for j in range(side):
        b = float(j - radius)
        row[:] = 0.0
        for i in range(side):
            a = float(i - radius)
            f = (sub[0, j, i] - mean) * sub[3, j, i]
            sub[0, j, i] = f
            squares += f * f
            sx, sy = sub[1, j, i], sub[2, j, i]
            power = 1.0
            for k in range(top):
                row[0, k] += sx * sx * power
                row[1, k] += sx * sy * power
                row[2, k] += sy * sy * power
                if k < half:
                    row[3, k] += sx * power
                    row[4, k] += sy * power
                    row[5, k] += sx * f * power
                    row[6, k] += sy * f * power
                power *= a
        power = 1.0
        for m in range(top):
            for k in range(top):
                for c in range(3):
                    products[c, k, m] += row[c, k] * power
            if m < half:
                for k in range(half):
                    singles[0, 0, k, m] += row[3, k] * power
                    singles[0, 1, k, m] += row[4, k] * power
                    singles[1, 0, k, m] += row[5, k] * power
                    singles[1, 1, k, m] += row[6, k] * power
            power *= b
    for k in range(n):
        ones[k] = FACTOR[k] * singles[0, COMPONENT[k], POWER_A[k], POWER_B[k]]
        grey[k] = FACTOR[k] * singles[1, COMPONENT[k], POWER_A[k], POWER_B[k]]
    if count == 0.0 or squares == 0.0:
        return count, 0.0
    for k in range(n):
        for m in range(n):
            pair = products[
                COMPONENT[k] + COMPONENT[m], POWER_A[k] + POWER_A[m], POWER_B[k] + POWER_B[m]
            ]
            hessian[k, m] = FACTOR[k] * FACTOR[m] * pair
            hessian[k, m] -= ones[k] * ones[m] / count + grey[k] * grey[m] / squares
    return count, squares


@njit(cache=True, nogil=True)
def factorise(matrix, n):  # type: ignore[no-untyped-def]
    """Cholesky factor in the lower triangle of matrix (n, n); False where it is singular."""
    for k in range(n):
        pivot = matrix[k, k]
        for m in range(k):
            pivot -= matrix[k, m] ** 2
        if not pivot > 1e-9 * matrix[k, k]:
            return False
        matrix[k, k] = np.sqrt(pivot)
        for r in range(k + 1, n):
            value = matrix[r, k]
            for m in range(k):
                value -= matrix[r, m] * matrix[k, m]
            matrix[r, k] = value / matrix[k, k]
    return True


@njit(cache=True, nogil=True)
def solve(factor, n, right):  # type: ignore[no-untyped-def]
    """Solve with the Cholesky factor, in place of right (n,)."""
    for k in range(n):
        for m in range(k):
            right[k] -= factor[k, m] * right[m]
        right[k] /= factor[k, k]
    for k in range(n - 1, -1, -1):
        for m in range(k + 1, n):
            right[k] -= factor[m, k] * right[m]
        right[k] /= factor[k, k]


@njit(cache=True, nogil=True, fastmath=FAST)
def deformed_sums(  # type: ignore[no-untyped-def]
    coefficients, is_quintic, sub, radius, x, y, p, n, right
):
    """Sums over the deformed subset: right (n,) with the Jacobian.

    Returns whether all of it is in the image, and the sums of g, g² and f g; g from its middle.
    """
    side = 2 * radius + 1
    bottom, last = coefficients.shape[0] - 2 * PAD - 1.0, coefficients.shape[1] - 2 * PAD - 1.0
    sums = np.zeros((2, 3, 3))
    sum_g, sum_gg, sum_fg = 0.0, 0.0, 0.0
    cx, cy = x + p[0], y + p[1]
    if not (0.0 <= cx <= last and 0.0 <= cy <= bottom):
        return False, 0.0, 0.0, 0.0
    middle = value3(coefficients, cx, cy)
    for j in range(side):
        b = float(j - radius)
        x0, y0 = cx + b * (p[3] + 0.5 * b * p[8]), cy + b * (1.0 + p[5] + 0.5 * b * p[11])
        x1, y1 = 1.0 + p[2] + b * p[7], p[4] + b * p[10]
        u0, u1, u2, v0, v1, v2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(side):
            if sub[3, j, i] == 0.0:
                continue
            a = float(i - radius)
            gx, gy = x0 + a * (x1 + 0.5 * a * p[6]), y0 + a * (y1 + 0.5 * a * p[9])
            if not (0.0 <= gx <= last and 0.0 <= gy <= bottom):
                return False, 0.0, 0.0, 0.0
            if is_quintic:
                g = value5(coefficients, gx, gy) - middle
            else:
                g = value3(coefficients, gx, gy) - middle
            sum_g += g
            sum_gg += g * g
            sum_fg += g * sub[0, j, i]
            along = g * sub[1, j, i]
            u0 += along
            u1 += along * a
            u2 += along * a * a
            along = g * sub[2, j, i]
            v0 += along
            v1 += along * a
            v2 += along * a * a
        power = 1.0
        for m in range(3):
            sums[0, 0, m] += u0 * power
            sums[0, 1, m] += u1 * power
            sums[0, 2, m] += u2 * power
            sums[1, 0, m] += v0 * power
            sums[1, 1, m] += v1 * power
            sums[1, 2, m] += v2 * power
            power *= b
    for k in range(n):
        right[k] = FACTOR[k] * sums[COMPONENT[k], POWER_A[k], POWER_B[k]]
    return True, sum_g, sum_gg, sum_fg
