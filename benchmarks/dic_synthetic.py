"""Image correlation against images whose truth is exact: bias, noise, stated deviations."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.exact_speckle import Array, Speckle, exposed, speckle
from calib.dic import (
    CorrelationSettings,
    correlate,
    follow,
    grid_points,
    prepare,
    rectangle_mask,
)

WIDTH, HEIGHT = 640, 480
X, Y = np.arange(float(WIDTH)), np.arange(float(HEIGHT))
NOISE = 2.55
"""grey levels, 1 % of full scale"""
SHIFTS = tuple(k / 10 for k in range(11))
MARGIN = 24
REPEATS = 4
"""pairs of noisy images"""
SPOT_RADII = (1.2, 1.5, 2.5)
"""px: full widths at half maximum of the autocorrelation of some 4, 5 and 8 px"""


def _grid(step: int) -> Array:
    box = (MARGIN, MARGIN, WIDTH - MARGIN, HEIGHT - MARGIN)
    return grid_points(rectangle_mask((HEIGHT, WIDTH), box), step)[0]


def bound(pattern: Speckle, contrast: float, points: Array, settings: CorrelationSettings) -> Array:
    """(n, 2) Cramer-Rao bound of u and v of each subset, px.

    Both images are noisy with NOISE, the pattern and its slopes are known exactly (differences of
    the pattern itself over 0.001 px), and the model is that of the settings: shape functions of
    order 1, a scale and a plane of light.
    """
    h = 5e-4
    slopes = (
        contrast * (pattern(X + h, Y) - pattern(X - h, Y)) / (2 * h),
        contrast * (pattern(X, Y + h) - pattern(X, Y - h)) / (2 * h),
    )
    grey = contrast * pattern(X, Y)
    R = settings.radius
    b, a = (v.ravel() for v in np.mgrid[-R : R + 1, -R : R + 1].astype(float))
    out = np.empty((len(points), 2))
    for index, (x, y) in enumerate(points.astype(int)):
        cut = (slice(y - R, y + R + 1), slice(x - R, x + R + 1))
        gx, gy, f = (image[cut].ravel() for image in (*slopes, grey))
        columns = [gx, gy, gx * a, gx * b, gy * a, gy * b, f, np.ones_like(f), a, b]
        design = np.stack(columns, axis=1)
        scale = np.linalg.norm(design, axis=0)
        information = (design / scale).T @ (design / scale)
        inverse = np.linalg.inv(information) / np.outer(scale, scale)
        out[index] = np.sqrt(2 * NOISE**2 * np.diag(inverse)[:2])
    return out


def shift() -> dict[str, Any]:
    """Bias over sub-pixel shifts, and noise over the bound, subset 31, order 1."""
    settings = CorrelationSettings()
    points = _grid(16)
    biases: dict[str, list[float]] = {}
    ratios, noise = [], []
    for radius in SPOT_RADII:
        rng = np.random.default_rng(int(10 * radius))
        pattern = speckle(WIDTH, HEIGHT, rng, radius)
        still = pattern(X, Y)
        spread = float(still.std())
        least = bound(pattern, 45.0 / spread, points, settings)
        means = []
        for amount in SHIFTS:
            errors = []
            for move in np.array([[amount, -amount], [amount, 1 - amount]]):
                moved = pattern(X - move[0], Y - move[1])
                for _ in range(REPEATS):
                    a, b = (exposed(seen, rng, NOISE, spread=spread) for seen in (still, moved))
                    found = correlate(a, b, points, settings)
                    errors.append(found.displacement - move)
                    off = errors[-1] - errors[-1].mean(axis=0)
                    ratios.append(np.sqrt(np.mean((off / least) ** 2)))
            means.append(float(np.mean([np.nanmean(e[:, 0]) for e in errors])))
            noise.append(float(np.mean([np.nanstd(e) for e in errors])))
        biases[f"spot_radius_{radius:g}"] = [round(m, 6) for m in means]
    worst = max(abs(value) for values in biases.values() for value in values)
    return {
        "shift_bias_px": round(worst, 6),
        "shift_bias_by_shift_px": {"shifts": list(SHIFTS), **biases},
        "shift_noise_px": round(float(np.mean(noise)), 6),
        "noise_over_crb": round(float(np.mean(ratios)), 4),
        "noise_over_crb_range": [round(float(v), 4) for v in (min(ratios), max(ratios))],
    }


def glare(rng: np.random.Generator, n: int) -> Array:
    """(h, w) grey levels that n bright smooth spots of 10 to 60 px add, fixed in space."""
    out = np.zeros((HEIGHT, WIDTH))
    for _ in range(n):
        x, y, r = rng.uniform(0, WIDTH), rng.uniform(0, HEIGHT), rng.uniform(10, 60)
        across = np.exp(-0.5 * ((X - x) / r) ** 2)
        out += rng.uniform(40, 120) * np.outer(np.exp(-0.5 * ((Y - y) / r) ** 2), across)
    return out


def _standardised(n_spots: int, settings: CorrelationSettings, seeds: range) -> dict[str, Any]:
    z, lost = [], 0
    points = _grid(16)
    for seed in seeds:
        rng = np.random.default_rng(1000 * n_spots + seed)
        pattern = speckle(WIDTH, HEIGHT, rng, rng.uniform(1.3, 2.5))
        spread = float(pattern(X, Y).std())
        stretch, move = rng.uniform(0.97, 1.03, 2), rng.uniform(-2, 2, 2)
        noise = rng.uniform(1.0, 5.0)
        a = exposed(pattern(X, Y), rng, noise, 35.0, spread)
        seen = pattern((X - move[0]) / stretch[0], (Y - move[1]) / stretch[1])
        light = glare(rng, n_spots) if n_spots else np.zeros((HEIGHT, WIDTH))
        b = exposed(seen + light * spread / 35.0, rng, noise, 35.0, spread)
        found = correlate(a, b, points, settings)
        truth = points * (stretch - 1) + move
        z.append(((found.displacement - truth) / found.sigma)[found.valid])
        lost += int(np.sum(~found.valid))
    every = np.concatenate(z).ravel()
    return {
        "sd": round(float(np.std(every)), 4),
        "coverage_95": round(float(np.mean(np.abs(every) < 1.96)), 4),
        "points": int(every.size // 2),
        "lost": lost,
    }


def sigma() -> dict[str, Any]:
    """Standardised errors over 8 patterns, noises and stretches, without and with glare.

    None of these patterns was looked at while the code was written."""
    seeds = range(100, 108)
    figures = {
        "without_glare": _standardised(0, CorrelationSettings(), seeds),
        "with_glare": _standardised(6, CorrelationSettings(), seeds),
        "with_glare_order_2": _standardised(6, CorrelationSettings(order=2), seeds),
    }
    return {"sigma_calibration": figures}


def compression() -> dict[str, Any]:
    """A block pressed to 40 % of its height in six images, with widening sides."""
    rng = np.random.default_rng(0)
    pattern = speckle(WIDTH, HEIGHT, rng, 2.5)
    spread = float(pattern(X, Y).std())
    points = grid_points(rectangle_mask((HEIGHT, WIDTH), (80, 40, WIDTH - 80, HEIGHT - 40)), 16)[0]
    a = exposed(pattern(X, Y), rng, NOISE, spread=spread)
    frames, truths = [], []
    for share in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6):
        flat, wide = 1 - share, 1 + 0.3 * share
        looks_x, looks_y = (X - WIDTH / 2) / wide + WIDTH / 2, (Y - HEIGHT) / flat + HEIGHT
        frames.append(exposed(pattern(looks_x, looks_y), rng, NOISE, spread=spread))
        away = [(points[:, 0] - WIDTH / 2) * (wide - 1), (points[:, 1] - HEIGHT) * (flat - 1)]
        truths.append(np.column_stack(away))
    settings = CorrelationSettings()
    *_, last = follow(prepare(a, settings.degree), frames, points, settings)
    error = last.displacement - truths[-1]
    figures = {
        "rms_px": round(float(np.sqrt(np.nanmean(error**2))), 5),
        "valid_share": round(float(last.valid.mean()), 4),
        "standardised_sd": round(float(np.nanstd(error / last.sigma)), 4),
    }
    return {"compression_60_percent": figures}
