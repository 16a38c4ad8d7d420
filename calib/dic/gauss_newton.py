"""Iteration of one subset to its minimum, and the loop over points, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calib.dic.interpolation import FAST, Array
from calib.dic.interpolation_bias import wave_size
from calib.dic.residual import clumping, deviations, noise_share, noise_variance, reject_glare
from calib.dic.subset import (
    AT_ONCE,
    FOLDED,
    LEFT_IMAGE,
    LOW_CORRELATION,
    N_PARAMETER,
    NO_SPECKLE,
    NOT_CONVERGED,
    OUTSIDE_REGION,
    SMALLEST_DETERMINANT,
    UNCERTAIN,
    VALID,
    deformed_sums,
    factorise,
    load,
    reference_sums,
    solve,
    take_light_off,
)
from calib.dic.warp import compose_inverse
from fe.compiled import kernel

MOST_TRIALS = 4
"""iterations from start to end, with fewer pixels each time"""
LAST_STEP = 10.0
"""tolerances; a larger step is always followed by another"""


class Fit(NamedTuple):
    """What an iteration ended with."""

    reason: int
    iterations: int
    zncc: float
    scale: float
    """of g to f"""
    pixels: float
    """of weight 1"""
    squares: float
    """sum of f²"""
    inverse: Array
    """(2, 2) of the Hessian, at the displacement"""
    diagonal: Array
    """(2,) of the Hessian"""


@kernel(nogil=True, error_model="numpy", fastmath=FAST)
def size_of(step, n, radius):  # type: ignore[no-untyped-def]
    """Square of how far a step moves the edge of the subset, px²."""
    size = step[0] ** 2 + step[1] ** 2
    for k in range(2, 6):
        size += (step[k] * radius) ** 2
    for k in range(6, n):
        size += (0.5 * step[k] * radius * radius) ** 2
    return size


@kernel(nogil=True, error_model="numpy")
def is_done(size, before, tolerance):  # type: ignore[no-untyped-def]
    """Whether the next step would be below the tolerance, px; size, before: squares of the steps.

    With a Hessian that is not renewed, steps shrink by one ratio. It is trusted for a step that is
    small itself, so that residuals, which are those before it, are those of the end.
    """
    if size < tolerance**2:
        return True
    if not size < (LAST_STEP * tolerance) ** 2 or not size < 0.25 * before:
        return False
    return size * (size / before) < tolerance**2


@kernel(nogil=True, error_model="numpy")
def judged(reason, p, zncc, least):  # type: ignore[no-untyped-def]
    """The reason after the iteration, with what its end says."""
    if reason == VALID and (1.0 + p[2]) * (1.0 + p[5]) - p[3] * p[4] < SMALLEST_DETERMINANT:
        return FOLDED
    if reason in (VALID, NOT_CONVERGED) and zncc < least:
        return LOW_CORRELATION
    return reason


@kernel(nogil=True, error_model="numpy", fastmath=FAST)
def iterate(  # type: ignore[no-untyped-def]
    coefficients, is_quintic, sub, radius, x, y, p, n, n_light, limits, values, fitted
):
    """Gauss-Newton from p (12,), in place.

    limits: tolerance px, iterations, smallest zncc. values (side, side) and fitted (3,): g and its
    light at the end. Returns a Fit.
    """
    side = 2 * radius + 1
    hessian, light, grey, gram = np.zeros((n, n)), np.zeros((n, 3)), np.zeros(n), np.zeros((3, 3))
    diagonal, inverse = np.zeros(2), np.full((2, 2), np.nan)
    count, squares = take_light_off(sub, radius, n_light, gram), 0.0
    if count > 0.0:
        squares = reference_sums(sub, radius, n, gram, n_light, hessian, light, grey)
    diagonal[0], diagonal[1] = hessian[0, 0], hessian[1, 1]
    if squares <= 1e-12 or not factorise(hessian, n):
        return Fit(NO_SPECKLE, 0, np.nan, 1.0, count, squares, inverse, diagonal)
    right, lit, step = np.zeros(n), np.zeros(3), np.zeros(N_PARAMETER)
    zncc, scale, reason, iteration = np.nan, 1.0, NOT_CONVERGED, 0
    room = max(AT_ONCE // side, 1) * side
    work, first = np.empty((15, room)), np.empty(room, np.int64)
    x0, y0, before = p[0], p[1], 0.0
    while iteration < limits[1]:
        iteration += 1
        inside, sum_gg, sum_fg = deformed_sums(
            coefficients, is_quintic, sub, radius, x, y, p, n, right, lit, values, work, first
        )
        if not inside:
            reason = LEFT_IMAGE
            break
        fitted[:] = lit
        solve(gram, n_light, fitted)
        fitted[n_light:] = 0.0
        spread = sum_gg - np.sum(lit * fitted)
        if not spread > 1e-12 * squares:
            reason = LOW_CORRELATION
            break
        zncc = sum_fg / np.sqrt(spread * squares)
        scale = np.sqrt(squares / spread)
        for k in range(n):
            off = grey[k] * sum_fg / squares
            for q in range(n_light):
                off += light[k, q] * fitted[q]
            step[k] = scale * (right[k] - off)
        solve(hessian, n, step)
        size = size_of(step, n, radius)
        if not compose_inverse(p, step):
            break
        if (p[0] - x0) ** 2 + (p[1] - y0) ** 2 > (2.0 * radius) ** 2:
            break
        if is_done(size, before, limits[0]):
            reason = VALID
            break
        before = size
    for k in range(2):
        step[:] = 0.0
        step[k] = 1.0
        solve(hessian, n, step)
        inverse[0, k], inverse[1, k] = step[0], step[1]
    reason = judged(reason, p, zncc, limits[2])
    return Fit(reason, iteration, zncc, scale, count, squares, inverse, diagonal)


@kernel(nogil=True, error_model="numpy")
def correlate_range(  # type: ignore[no-untyped-def]
    reference, deformed, is_quintic, noise, points, todo, radius, n, n_light, limits, parameters,
    results
):  # fmt: skip
    """Correlate pixels points[todo], from and into parameters (n_point, 12).

    reference: a Reference; deformed, the other image's spline; noise: a Noise.
    limits: tolerance, iterations, smallest zncc, largest sigma, smallest share of pixels, and
    threshold of glare in standard deviations, 0 for none.
    results (n_point, 7): zncc, sigma of u and v, reason, iterations, interpolation of u and v.
    """
    image, slope_x, slope_y, mask = reference[:4]
    growth = reference.growth
    n_fitted = (n + 1) * 0.5 * (growth[0] + growth[1]) + n_light * growth[2]
    side = 2 * radius + 1
    sub = np.zeros((4, side, side))
    values, fitted, ratio = np.empty((side, side)), np.zeros(3), np.zeros(2)
    for index in todo:
        x, y = points[index]
        p = parameters[index]
        load(image, slope_x, slope_y, mask, x, y, radius, sub)
        out = results[index]
        out[:] = np.nan
        out[4] = 0.0
        # the pixel of the point itself is in the middle
        if sub[3, radius, radius] == 0.0 or sub[3].sum() < limits[4] * side * side:
            out[3] = OUTSIDE_REGION
            continue
        for trial in range(MOST_TRIALS):
            fit = iterate(
                deformed, is_quintic, sub, radius, x, y, p, n, n_light, limits, values, fitted
            )
            out[0], out[3], out[4] = fit.zncc, fit.reason, out[4] + fit.iterations
            may_hide = fit.reason in (VALID, LOW_CORRELATION)
            if limits[5] == 0.0 or not may_hide or trial == MOST_TRIALS - 1:
                break
            if reject_glare(sub, values, radius, fitted, fit.scale, limits[5]) == 0:
                break
            if sub[3].sum() < limits[4] * side * side:
                out[3] = LOW_CORRELATION
                break
        if out[3] != VALID:
            continue
        variance = noise_variance(
            fit, n_fitted, noise_share(noise.values, deformed, x, y, p, radius)
        )
        clumping(sub, values, radius, fitted, fit.scale, ratio)
        out[1], out[2] = deviations(p, fit, variance, noise.slope, ratio, growth)
        wave_size(
            sub, reference.error_x, reference.error_y, x, y, radius, p, variance, noise,
            fit.diagonal, out[5:],
        )  # fmt: skip
        if not max(out[1], out[2]) <= limits[3]:
            out[3] = UNCERTAIN
