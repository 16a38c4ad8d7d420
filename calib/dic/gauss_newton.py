"""Iteration of one subset to its minimum, and the loop over points, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from calib.dic.interpolation import FAST
from calib.dic.subset import (
    FOLDED,
    LEFT_IMAGE,
    LOW_CORRELATION,
    N_PARAMETER,
    NO_SPECKLE,
    NOT_CONVERGED,
    OUTSIDE_REGION,
    SMALLEST_DETERMINANT,
    VALID,
    deformed_sums,
    factorise,
    load,
    reference_sums,
    solve,
)
from calib.dic.warp import compose_inverse


@njit(cache=True, nogil=True)
def noise_share(table, coefficients, x, y, p, radius):  # type: ignore[no-untyped-def]
    """Mean variance of interpolated unit noise over the deformed subset (table over [0, 1])."""
    total, count = 0.0, 0
    for j in range(-radius, radius + 1, 3):
        for i in range(-radius, radius + 1, 3):
            a, b = float(i), float(j)
            gx = x + a + p[0] + p[2] * a + p[3] * b + 0.5 * p[6] * a * a + p[7] * a * b
            gy = y + b + p[1] + p[4] * a + p[5] * b + 0.5 * p[9] * a * a + p[10] * a * b
            gx += 0.5 * p[8] * b * b
            gy += 0.5 * p[11] * b * b
            tx, ty = gx - np.floor(gx), gy - np.floor(gy)
            last = table.size - 1
            total += table[int(tx * last + 0.5)] * table[int(ty * last + 0.5)]
            count += 1
    return total / count


@njit(cache=True, nogil=True, fastmath=FAST)
def iterate(  # type: ignore[no-untyped-def]
    coefficients, is_quintic, sub, radius, x, y, p, n, limits
):
    """Gauss-Newton from p (12,), in place.

    limits: tolerance px, iterations, smallest zncc. Returns reason, iterations, zncc, scale of g to
    f, pixels, and the inverse of the Hessian (2, 2) with its diagonal (2,) at the displacement.
    """
    hessian, ones, grey = np.zeros((n, n)), np.zeros(n), np.zeros(n)
    count, squares = reference_sums(sub, radius, n, hessian, ones, grey)
    diagonal, inverse = np.zeros(2), np.full((2, 2), np.nan)
    if squares <= 1e-12:
        return NO_SPECKLE, 0, np.nan, 1.0, count, inverse, diagonal
    diagonal[0], diagonal[1] = hessian[0, 0], hessian[1, 1]
    if not factorise(hessian, n):
        return NO_SPECKLE, 0, np.nan, 1.0, count, inverse, diagonal
    right, step = np.zeros(n), np.zeros(N_PARAMETER)
    zncc, scale, reason, iteration = np.nan, 1.0, NOT_CONVERGED, 0
    side = 2 * radius + 1
    work, first = np.empty((15, side)), np.empty(side, np.int64)
    x0, y0 = p[0], p[1]
    while iteration < limits[1]:
        iteration += 1
        inside, sum_g, sum_gg, sum_fg = deformed_sums(
            coefficients, is_quintic, sub, radius, x, y, p, n, right, work, first
        )
        if not inside:
            reason = LEFT_IMAGE
            break
        spread = sum_gg - sum_g * sum_g / count
        if not spread > 1e-12 * squares:
            reason = LOW_CORRELATION
            break
        zncc = sum_fg / np.sqrt(spread * squares)
        scale = np.sqrt(squares / spread)
        for k in range(n):
            step[k] = scale * (right[k] - ones[k] * sum_g / count - grey[k] * sum_fg / squares)
        solve(hessian, n, step)
        size = step[0] ** 2 + step[1] ** 2
        for k in range(2, 6):
            size += (step[k] * radius) ** 2
        for k in range(6, n):
            size += (0.5 * step[k] * radius * radius) ** 2
        if not compose_inverse(p, step):
            break
        if (p[0] - x0) ** 2 + (p[1] - y0) ** 2 > (2.0 * radius) ** 2:
            break
        if size < limits[0] ** 2:
            reason = VALID
            break
    if reason == VALID:
        if (1.0 + p[2]) * (1.0 + p[5]) - p[3] * p[4] < SMALLEST_DETERMINANT:
            reason = FOLDED
        elif zncc < limits[2]:
            reason = LOW_CORRELATION
    elif reason == NOT_CONVERGED and zncc < limits[2]:
        reason = LOW_CORRELATION
    for k in range(2):
        step[:] = 0.0
        step[k] = 1.0
        solve(hessian, n, step)
        inverse[0, k], inverse[1, k] = step[0], step[1]
    return reason, iteration, zncc, scale, count, inverse, diagonal


@njit(cache=True, nogil=True)
def correlate_range(  # type: ignore[no-untyped-def]
    image, slope_x, slope_y, mask, deformed, is_quintic, noise, points, todo,
    radius, n, limits, parameters, results
):  # fmt: skip
    """Correlate pixels points[todo], from and into parameters (n_point, 12).

    image, slope_x, slope_y (h, w) of the reference; deformed, the other image's spline.
    noise: (slope energy, table...), the variances of slope and value of splined unit noise.
    limits: tolerance, iterations, smallest zncc, largest sigma, smallest share of pixels.
    results (n_point, 5): zncc, sigma of u and v, reason, iterations.
    """
    side = 2 * radius + 1
    sub = np.zeros((4, side, side))
    table = noise[1:]
    for index in todo:
        x, y = points[index]
        p = parameters[index]
        load(image, slope_x, slope_y, mask, x, y, radius, sub)
        out = results[index]
        out[:] = np.nan
        out[4] = 0.0
        if sub[3].sum() < limits[4] * side * side:
            out[3] = OUTSIDE_REGION
            continue
        reason, iterations, zncc, scale, count, inverse, diagonal = iterate(
            deformed, is_quintic, sub, radius, x, y, p, n, limits
        )
        out[0], out[3], out[4] = zncc, reason, iterations
        if reason != VALID:
            continue
        squares = np.sum(sub[0] ** 2)
        share = noise_share(table, deformed, x, y, p, radius)
        # the noise of one image from the residual, both being equally noisy in grey levels
        variance = squares * (1.0 - zncc**2) / max(count - n - 2.0, 1.0)
        variance /= 1.0 + scale**2 * share
        # in the deformed image: increments belong to the reference's frame, d x = F d X
        f00, f01, f10, f11 = 1.0 + p[2], p[3], p[4], 1.0 + p[5]
        # where the image shrinks, its pixels are fewer than those of the subset
        density = scale**2 / (f00 * f11 - f01 * f10)
        spread = np.zeros(3)
        for k in range(2):
            # noise in the slopes of the reference makes the Hessian too large
            excess = min(count * variance * noise[0] / diagonal[k], 0.75)
            growth = 1.0 / (1.0 - excess)
            spread[k] = variance * max(inverse[k, k], 0.0) * (growth + density * growth**2)
        spread[2] = inverse[0, 1] / np.sqrt(max(inverse[0, 0] * inverse[1, 1], 1e-300))
        spread[2] *= np.sqrt(spread[0] * spread[1])
        across = f00 * f00 * spread[0] + 2.0 * f00 * f01 * spread[2] + f01 * f01 * spread[1]
        down = f10 * f10 * spread[0] + 2.0 * f10 * f11 * spread[2] + f11 * f11 * spread[1]
        out[1], out[2] = np.sqrt(across), np.sqrt(down)
        if not max(out[1], out[2]) <= limits[3]:
            out[3] = NO_SPECKLE
