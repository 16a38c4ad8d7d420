"""What the residual of a subset tells: pixels in glare, and the deviation of its displacement."""

from __future__ import annotations

import numpy as np

from calib.dic.interpolation import FAST
from fe.compiled import kernel

BLOCK = 6
"""px; a little more than a usual speckle"""
CLUMPED = 1.6
"""ratio that white noise does not reach: it is 1 with a deviation of some 0.3"""
MOST_EXCESS = 0.75
HEAVY_TAIL = 5.0
"""fourth moment over squared second (3 for normal noise) above which residuals are searched"""


@kernel(nogil=True, error_model="numpy", fastmath=FAST)
def reject_glare(sub, values, radius, fitted, scale, threshold):  # type: ignore[no-untyped-def]
    """Take out pixels whose residual is no noise, and their neighbours; returns how many.

    values (side, side): g; fitted (3,): its plane; scale of g to f. A pixel is out when its
    residual is more than `threshold` robust standard deviations from the median of all, and only
    where the residuals have heavier tails than noise has.
    """
    side = 2 * radius + 1
    residual = np.empty((side, side))
    count, second, fourth = 0.0, 0.0, 0.0
    for j in range(side):
        level = fitted[0] + fitted[2] * float(j - radius)
        for i in range(side):
            g = values[j, i] - level - fitted[1] * float(i - radius)
            r = (sub[0, j, i] - scale * g) * sub[3, j, i]
            residual[j, i] = r
            count += sub[3, j, i]
            second += r * r
            fourth += r * r * r * r
    if fourth * count <= HEAVY_TAIL * second * second:
        return 0
    kept = residual.ravel()[sub[3].ravel() > 0.0]
    middle = np.median(kept)
    limit = threshold * 1.4826 * np.median(np.abs(kept - middle))
    out = 0
    for j in range(side):
        for i in range(side):
            if sub[3, j, i] > 0.0 and abs(residual[j, i] - middle) > limit:
                residual[j, i] = np.nan
    for j in range(side):
        for i in range(side):
            if np.isnan(residual[j, i]):
                for m in range(max(j - 1, 0), min(j + 2, side)):
                    for k in range(max(i - 1, 0), min(i + 2, side)):
                        out += 1 if sub[3, m, k] > 0.0 else 0
                        sub[:, m, k] = 0.0
    return out


@kernel(nogil=True, error_model="numpy")
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


@kernel(nogil=True, error_model="numpy", fastmath=FAST)
def clumping(sub, values, radius, fitted, scale, ratio):  # type: ignore[no-untyped-def]
    """How much larger than by white noise the variance of the slopes' sums with the residual is.

    ratio (2,) of u and v: sum over blocks of squared sums, over the sum of squares. 1 for white
    noise, more where the residual goes with the speckle: changed surface, shape, interpolation.
    """
    side = 2 * radius + 1
    blocks = (side + BLOCK - 1) // BLOCK
    sums = np.zeros((2, blocks, blocks))
    alone_x, alone_y = 1e-300, 1e-300
    for j in range(side):
        level = fitted[0] + fitted[2] * float(j - radius)
        for i in range(side):
            g = values[j, i] - level - fitted[1] * float(i - radius)
            r = (sub[0, j, i] - scale * g) * sub[3, j, i]
            x, y = r * sub[1, j, i], r * sub[2, j, i]
            alone_x += x * x
            alone_y += y * y
            sums[0, j // BLOCK, i // BLOCK] += x
            sums[1, j // BLOCK, i // BLOCK] += y
    ratio[0], ratio[1] = np.sum(sums[0] ** 2) / alone_x, np.sum(sums[1] ** 2) / alone_y


@kernel(nogil=True, error_model="numpy")
def noise_variance(fit, n_fitted, share):  # type: ignore[no-untyped-def]
    """Of one image in a subset, from the residual, both being equally noisy in grey levels.

    fit: a Fit. n_fitted: independent values that fitting takes off the residual. share: variance of
    splined unit noise in the deformed subset.
    """
    # of an image and itself the correlation is 1 up to rounding
    left = max(1.0 - fit.zncc**2, 0.0)
    variance = fit.squares * left / max(fit.pixels - n_fitted, 1.0)
    return variance / (1.0 + fit.scale**2 * share)


@kernel(nogil=True, error_model="numpy")
def deviations(p, fit, variance, noise, ratio, expected):  # type: ignore[no-untyped-def]
    """Standard deviation of u and v in the deformed image, px, by the noise of both images.

    fit: a Fit. variance: `noise_variance`. noise: variance of the slope of splined unit noise.
    ratio (2,): see `clumping`; expected (2,): what it is expected to be, 1 for white noise.
    """
    # increments belong to the reference's frame: d x = F d X
    f00, f01, f10, f11 = 1.0 + p[2], p[3], p[4], 1.0 + p[5]
    # where the image shrinks, its pixels are fewer than those of the subset
    density = fit.scale**2 / (f00 * f11 - f01 * f10)
    spread = np.zeros(3)
    for k in range(2):
        # noise in the slopes of the reference makes the Hessian too large
        excess = min(fit.pixels * variance * noise / fit.diagonal[k], MOST_EXCESS)
        growth = 1.0 / (1.0 - excess)
        spread[k] = variance * max(fit.inverse[k, k], 0.0) * (growth + density * growth**2)
        spread[k] *= ratio[k] if ratio[k] > CLUMPED * expected[k] else expected[k]
    together = fit.inverse[0, 1] / np.sqrt(max(fit.inverse[0, 0] * fit.inverse[1, 1], 1e-300))
    spread[2] = together * np.sqrt(spread[0] * spread[1])
    across = f00 * f00 * spread[0] + 2.0 * f00 * f01 * spread[2] + f01 * f01 * spread[1]
    down = f10 * f10 * spread[0] + 2.0 * f10 * f11 * spread[2] + f11 * f11 * spread[1]
    return np.sqrt(across), np.sqrt(down)
