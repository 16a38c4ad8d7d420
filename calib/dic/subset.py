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

from calib.dic.interpolation import FAST, PAD, cubic_values, quintic_values

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
def load(image, slope_x, slope_y, mask, x, y, radius, sub):  # type: ignore[no-untyped-def]
    """Fill sub (4, side, side) with grey value, slopes and weight around a pixel x, y."""
    h, w = image.shape
    left, right = max(int(x) - radius, 0), min(int(x) + radius + 1, w)
    first, shift = int(y) - radius, max(int(x) - radius, 0) - (int(x) - radius)
    sub[:] = 0.0
    for j in range(2 * radius + 1):
        row = first + j
        if not 0 <= row < h:
            continue
        for i in range(left, right):
            weight = 1.0 if mask[row, i] else 0.0
            k = i - left + shift
            sub[0, j, k] = image[row, i] * weight
            sub[1, j, k] = slope_x[row, i] * weight
            sub[2, j, k] = slope_y[row, i] * weight
            sub[3, j, k] = weight


@njit(cache=True, nogil=True, fastmath=FAST)
def row_moments(sub, j, radius, mean, row):  # type: ignore[no-untyped-def]
    """Sums over row j with powers of a into row (7, 5); takes the mean off; returns sum of f²."""
    xx0, xx1, xx2, xx3, xx4 = 0.0, 0.0, 0.0, 0.0, 0.0
    xy0, xy1, xy2, xy3, xy4 = 0.0, 0.0, 0.0, 0.0, 0.0
    yy0, yy1, yy2, yy3, yy4 = 0.0, 0.0, 0.0, 0.0, 0.0
    x0, x1, x2, y0, y1, y2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    fx0, fx1, fx2, fy0, fy1, fy2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    squares = 0.0
    for i in range(2 * radius + 1):
        a = float(i - radius)
        f = (sub[0, j, i] - mean) * sub[3, j, i]
        sub[0, j, i] = f
        squares += f * f
        sx, sy = sub[1, j, i], sub[2, j, i]
        a2 = a * a
        xx, xy, yy = sx * sx, sx * sy, sy * sy
        xx0, xy0, yy0 = xx0 + xx, xy0 + xy, yy0 + yy
        xx1, xy1, yy1 = xx1 + xx * a, xy1 + xy * a, yy1 + yy * a
        xx, xy, yy = xx * a2, xy * a2, yy * a2
        xx2, xy2, yy2 = xx2 + xx, xy2 + xy, yy2 + yy
        xx3, xy3, yy3 = xx3 + xx * a, xy3 + xy * a, yy3 + yy * a
        xx4, xy4, yy4 = xx4 + xx * a2, xy4 + xy * a2, yy4 + yy * a2
        x0, x1, x2 = x0 + sx, x1 + sx * a, x2 + sx * a2
        y0, y1, y2 = y0 + sy, y1 + sy * a, y2 + sy * a2
        sx, sy = sx * f, sy * f
        fx0, fx1, fx2 = fx0 + sx, fx1 + sx * a, fx2 + sx * a2
        fy0, fy1, fy2 = fy0 + sy, fy1 + sy * a, fy2 + sy * a2
    row[0, 0], row[0, 1], row[0, 2], row[0, 3], row[0, 4] = xx0, xx1, xx2, xx3, xx4
    row[1, 0], row[1, 1], row[1, 2], row[1, 3], row[1, 4] = xy0, xy1, xy2, xy3, xy4
    row[2, 0], row[2, 1], row[2, 2], row[2, 3], row[2, 4] = yy0, yy1, yy2, yy3, yy4
    row[3, 0], row[3, 1], row[3, 2] = x0, x1, x2
    row[4, 0], row[4, 1], row[4, 2] = y0, y1, y2
    row[5, 0], row[5, 1], row[5, 2] = fx0, fx1, fx2
    row[6, 0], row[6, 1], row[6, 2] = fy0, fy1, fy2
    return squares


@njit(cache=True, nogil=True, fastmath=FAST)
def reference_sums(sub, radius, n, hessian, ones, grey):  # type: ignore[no-untyped-def]
    """Take the mean off the grey values; fill the projected Hessian (n, n) and its projections.

    ones (n,), grey (n,): sums of each column of the Jacobian, and with the grey values.
    Returns the number of pixels and the sum of squares of the grey values.
    """
    count = sub[3].sum()
    mean = sub[0].sum() / max(count, 1.0)
    top, half = (5, 3) if n == N_PARAMETER else (3, 2)
    products = np.zeros((3, 5, 5))
    singles = np.zeros((4, 3, 3))
    row = np.empty((7, 5))
    squares = 0.0
    for j in range(2 * radius + 1):
        squares += row_moments(sub, j, radius, mean, row)
        power = 1.0
        for m in range(top):
            for c in range(3):
                for k in range(top):
                    products[c, k, m] += row[c, k] * power
            if m < half:
                for c in range(4):
                    for k in range(half):
                        singles[c, k, m] += row[3 + c, k] * power
            power *= float(j - radius)
    for k in range(n):
        ones[k] = FACTOR[k] * singles[COMPONENT[k], POWER_A[k], POWER_B[k]]
        grey[k] = FACTOR[k] * singles[2 + COMPONENT[k], POWER_A[k], POWER_B[k]]
    if not squares > 0.0:
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
def deformed_row(  # type: ignore[no-untyped-def]
    coefficients, is_quintic, weight, b, radius, x, y, p, work, first
):
    """Grey values of row b of the deformed subset into work[0]; False where one leaves the image.

    weight (side,): pixels of weight 0 may leave it.
    """
    side = 2 * radius + 1
    stride = coefficients.shape[1]
    bottom, last = coefficients.shape[0] - 2 * PAD - 1.0, stride - 2 * PAD - 1.0
    x0 = x + p[0] + b * (p[3] + 0.5 * b * p[8])
    y0 = y + p[1] + b * (1.0 + p[5] + 0.5 * b * p[11])
    x1, y1 = 1.0 + p[2] + b * p[7], p[4] + b * p[10]
    lost = 0
    for i in range(side):
        a = float(i - radius)
        gx, gy = x0 + a * (x1 + 0.5 * a * p[6]), y0 + a * (y1 + 0.5 * a * p[9])
        cx, cy = min(max(gx, 0.0), last), min(max(gy, 0.0), bottom)
        work[1, i], work[2, i] = cx, cy
        if (gx != cx or gy != cy) and weight[i] != 0.0:
            lost += 1
    if lost > 0:
        return False
    flat = coefficients.ravel()
    if is_quintic:
        quintic_values(flat, stride, work[1], work[2], side, first, work[3:], work[0])
    else:
        cubic_values(flat, stride, work[1], work[2], side, first, work[3:], work[0])
    return True


@njit(cache=True, nogil=True, fastmath=FAST)
def deformed_sums(  # type: ignore[no-untyped-def]
    coefficients, is_quintic, sub, radius, x, y, p, n, right, work, first
):
    """Sums over the deformed subset: right (n,) with the Jacobian; work (15, side), first (side,).

    Returns whether all of it is in the image, and the sums of g, g² and f g; g from its corner.
    """
    side = 2 * radius + 1
    sums = np.zeros((2, 3, 3))
    sum_g, sum_gg, sum_fg, origin = 0.0, 0.0, 0.0, 0.0
    for j in range(side):
        b = float(j - radius)
        if not deformed_row(coefficients, is_quintic, sub[3, j], b, radius, x, y, p, work, first):
            return False, 0.0, 0.0, 0.0
        if j == 0:
            origin = work[0, 0]
        u0, u1, u2, v0, v1, v2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(side):
            a = float(i - radius)
            g = (work[0, i] - origin) * sub[3, j, i]
            sum_g += g
            sum_gg += g * g
            sum_fg += g * sub[0, j, i]
            along, across = g * sub[1, j, i], g * sub[2, j, i]
            u0, v0 = u0 + along, v0 + across
            along, across = along * a, across * a
            u1, v1 = u1 + along, v1 + across
            u2, v2 = u2 + along * a, v2 + across * a
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
