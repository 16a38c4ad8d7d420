"""One subset: inverse compositional Gauss-Newton on the ZNSSD, compiled.

Shape functions of the offset (a, b) from the subset's centre, px, parameters p in this order:
u = p0 + p2 a + p3 b + p6 a²/2 + p7 a b + p8 b²/2,
v = p1 + p4 a + p5 b + p9 a²/2 + p10 a b + p11 b²/2.
Minimised is sum (f + df - (scale g + light))² over p, scale and light, where light is a constant
or a plane over the subset. Scale and light are eliminated by projecting the Jacobian off f and off
the light's terms: with a constant that is the Gauss-Newton step of the ZNSSD (Pan, Li, Tong 2013,
Exp. Mech. 53:1277) in its exact form; a plane also takes out uneven light that changes. The Hessian
belongs to the reference and is made once.
"""

from __future__ import annotations

import numpy as np

from calib.dic.interpolation import FAST, PAD, cubic_values, quintic_values
from fe.compiled import kernel

N_PARAMETER = 12
# component (0: along x, 1: along y), powers of a and b, and factor of each parameter
COMPONENT = np.array([0, 1, 0, 0, 1, 1, 0, 0, 0, 1, 1, 1])
POWER_A = np.array([0, 0, 1, 0, 1, 0, 2, 1, 0, 2, 1, 0])
POWER_B = np.array([0, 0, 0, 1, 0, 1, 0, 1, 2, 0, 1, 2])
FACTOR = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5, 1.0, 0.5, 0.5, 1.0, 0.5])
# codes of Reason, which numba does not read
VALID, OUTSIDE_REGION, NO_SPECKLE, LEFT_IMAGE, NOT_CONVERGED, LOW_CORRELATION, FOLDED = range(7)
UNCERTAIN = 9
SMALLEST_DETERMINANT = 0.02
AT_ONCE = 256
"""pixels that are interpolated at once: enough for vector units, few enough for the first cache"""


@kernel(nogil=True, error_model="numpy", fastmath=FAST)
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


@kernel(nogil=True, error_model="numpy", fastmath=FAST)
def row_moments(sub, j, radius, row):  # type: ignore[no-untyped-def]
    """Sums over row j with powers of a into row (7, 5); returns the sum of f²."""
    xx0, xx1, xx2, xx3, xx4 = 0.0, 0.0, 0.0, 0.0, 0.0
    xy0, xy1, xy2, xy3, xy4 = 0.0, 0.0, 0.0, 0.0, 0.0
    yy0, yy1, yy2, yy3, yy4 = 0.0, 0.0, 0.0, 0.0, 0.0
    x0, x1, x2, x3, y0, y1, y2, y3 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    fx0, fx1, fx2, fy0, fy1, fy2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    squares = 0.0
    for i in range(2 * radius + 1):
        a = float(i - radius)
        f = sub[0, j, i]
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
        x3, y3 = x3 + sx * a2 * a, y3 + sy * a2 * a
        sx, sy = sx * f, sy * f
        fx0, fx1, fx2 = fx0 + sx, fx1 + sx * a, fx2 + sx * a2
        fy0, fy1, fy2 = fy0 + sy, fy1 + sy * a, fy2 + sy * a2
    row[0, 0], row[0, 1], row[0, 2], row[0, 3], row[0, 4] = xx0, xx1, xx2, xx3, xx4
    row[1, 0], row[1, 1], row[1, 2], row[1, 3], row[1, 4] = xy0, xy1, xy2, xy3, xy4
    row[2, 0], row[2, 1], row[2, 2], row[2, 3], row[2, 4] = yy0, yy1, yy2, yy3, yy4
    row[3, 0], row[3, 1], row[3, 2], row[3, 3] = x0, x1, x2, x3
    row[4, 0], row[4, 1], row[4, 2], row[4, 3] = y0, y1, y2, y3
    row[5, 0], row[5, 1], row[5, 2] = fx0, fx1, fx2
    row[6, 0], row[6, 1], row[6, 2] = fy0, fy1, fy2
    return squares


@kernel(nogil=True, error_model="numpy")
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


@kernel(nogil=True, error_model="numpy")
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


@kernel(nogil=True, error_model="numpy", fastmath=FAST)
def take_light_off(sub, radius, n_light, gram):  # type: ignore[no-untyped-def]
    """Take the constant (n_light 1) or plane (3) that fits best off the grey values.

    gram (3, 3) becomes the Cholesky factor of the sums of products of 1, a, b over the pixels.
    Returns the number of pixels; 0 where there are too few for a plane.
    """
    sums, powers = np.zeros(3), np.zeros(6)
    side = 2 * radius + 1
    for j in range(side):
        b = float(j - radius)
        w0, w1, w2, f0, f1 = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(side):
            a, w, f = float(i - radius), sub[3, j, i], sub[0, j, i]
            w0, w1, w2, f0, f1 = w0 + w, w1 + w * a, w2 + w * a * a, f0 + f, f1 + f * a
        sums[0], sums[1], sums[2] = sums[0] + f0, sums[1] + f1, sums[2] + f0 * b
        powers[0], powers[1], powers[2] = powers[0] + w0, powers[1] + w1, powers[2] + w0 * b
        powers[3], powers[4], powers[5] = powers[3] + w2, powers[4] + w1 * b, powers[5] + w0 * b * b
    gram[0, 0], gram[1, 1], gram[2, 2] = powers[0], powers[3], powers[5]
    gram[1, 0], gram[2, 0], gram[2, 1] = powers[1], powers[2], powers[4]
    if not (powers[0] > 0.0 and factorise(gram, n_light)):
        return 0.0
    solve(gram, n_light, sums)
    sums[n_light:] = 0.0
    for j in range(side):
        level = sums[0] + sums[2] * float(j - radius)
        for i in range(side):
            light = level + sums[1] * float(i - radius)
            sub[0, j, i] = (sub[0, j, i] - light) * sub[3, j, i]
    return powers[0]


@kernel(nogil=True, error_model="numpy", fastmath=FAST)
def reference_sums(  # type: ignore[no-untyped-def]
    sub, radius, n, gram, n_light, hessian, light, grey
):
    """Fill the projected Hessian (n, n) and what it is projected off; light is taken off already.

    light (n, 3), grey (n,): sums of each column of the Jacobian with 1, a, b; with grey values.
    Returns the sum of squares of the grey values.
    """
    top, half = (5, 4) if n == N_PARAMETER else (3, 3)
    products = np.zeros((3, 5, 5))
    singles = np.zeros((4, 4, 4))
    row = np.zeros((7, 5))
    squares = 0.0
    for j in range(2 * radius + 1):
        squares += row_moments(sub, j, radius, row)
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
    if not squares > 0.0:
        return 0.0
    projected = np.zeros((n, 3))
    for k in range(n):
        c, a, b = COMPONENT[k], POWER_A[k], POWER_B[k]
        light[k, 0] = FACTOR[k] * singles[c, a, b]
        light[k, 1] = FACTOR[k] * singles[c, a + 1, b]
        light[k, 2] = FACTOR[k] * singles[c, a, b + 1]
        grey[k] = FACTOR[k] * singles[2 + c, a, b]
        projected[k] = light[k]
        solve(gram, n_light, projected[k])
        projected[k, n_light:] = 0.0
    for k in range(n):
        for m in range(n):
            pair = products[
                COMPONENT[k] + COMPONENT[m], POWER_A[k] + POWER_A[m], POWER_B[k] + POWER_B[m]
            ]
            off = grey[k] * grey[m] / squares
            for q in range(n_light):
                off += light[k, q] * projected[m, q]
            hessian[k, m] = FACTOR[k] * FACTOR[m] * pair - off
    return squares


@kernel(nogil=True, error_model="numpy", fastmath=FAST)
def deformed_rows(  # type: ignore[no-untyped-def]
    coefficients, is_quintic, weight, start, rows, radius, x, y, p, work, first
):
    """Grey values of rows `start` on of the deformed subset, one after the other, into work[0].

    Returns False where one leaves the image; weight (side, side): pixels of weight 0 may.
    """
    side = 2 * radius + 1
    stride = coefficients.shape[1]
    bottom, last = coefficients.shape[0] - 2 * PAD - 1.0, stride - 2 * PAD - 1.0
    lost = 0
    for row in range(rows):
        b = float(start + row - radius)
        x0 = x + p[0] + b * (p[3] + 0.5 * b * p[8])
        y0 = y + p[1] + b * (1.0 + p[5] + 0.5 * b * p[11])
        x1, y1 = 1.0 + p[2] + b * p[7], p[4] + b * p[10]
        at_x, at_y = work[1, row * side :], work[2, row * side :]
        for i in range(side):
            a = float(i - radius)
            gx, gy = x0 + a * (x1 + 0.5 * a * p[6]), y0 + a * (y1 + 0.5 * a * p[9])
            cx, cy = min(max(gx, 0.0), last), min(max(gy, 0.0), bottom)
            at_x[i], at_y[i] = cx, cy
            if (gx != cx or gy != cy) and weight[start + row, i] != 0.0:
                lost += 1
    if lost > 0:
        return False
    flat = coefficients.ravel()
    if is_quintic:
        quintic_values(flat, stride, work[1], work[2], rows * side, first, work[3:], work[0])
    else:
        cubic_values(flat, stride, work[1], work[2], rows * side, first, work[3:], work[0])
    return True


@kernel(nogil=True, error_model="numpy", fastmath=FAST)
def deformed_sums(  # type: ignore[no-untyped-def]
    coefficients, is_quintic, sub, radius, x, y, p, n, right, lit, values, work, first
):
    """Sums over the deformed subset: right (n,) with the Jacobian, lit (3,) with 1, a, b.

    values (side, side): the grey values g, from that of the first pixel; work (15, m side), first
    (m side,): room to work on m rows at once. Returns whether all of it is in the image, and the
    sums of g² and f g.
    """
    side = 2 * radius + 1
    at_once = first.size // side
    sums = np.zeros((2, 3, 3))
    lit[:] = 0.0
    sum_gg, sum_fg, origin = 0.0, 0.0, 0.0
    for j in range(side):
        b = float(j - radius)
        if j % at_once == 0:
            rows = min(at_once, side - j)
            if not deformed_rows(
                coefficients, is_quintic, sub[3], j, rows, radius, x, y, p, work, first
            ):
                return False, 0.0, 0.0
        if j == 0:
            origin = work[0, 0]
        grey = work[0, (j % at_once) * side :]
        u0, u1, u2, v0, v1, v2, g0, g1 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(side):
            a = float(i - radius)
            g = (grey[i] - origin) * sub[3, j, i]
            values[j, i] = g
            g0, g1 = g0 + g, g1 + g * a
            sum_gg += g * g
            sum_fg += g * sub[0, j, i]
            along, across = g * sub[1, j, i], g * sub[2, j, i]
            u0, v0 = u0 + along, v0 + across
            along, across = along * a, across * a
            u1, v1 = u1 + along, v1 + across
            u2, v2 = u2 + along * a, v2 + across * a
        lit[0], lit[1], lit[2] = lit[0] + g0, lit[1] + g1, lit[2] + g0 * b
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
    return True, sum_gg, sum_fg
