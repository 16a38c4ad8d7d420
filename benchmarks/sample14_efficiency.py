"""DIC Challenge sample 14: noise times resolution beside the theory of the second Challenge.

The theory to which its codes are held (Reu et al. 2022, Exp. Mech. 62:639): a subset passes of a
field what the polynomial of its order fitted by least squares does; 10 % of a wave of period l are
lost at l = 67.8 px for a subset of 17 px of order 1 (3.99 subsets). Noise times this l, the
metrological efficiency indicator, is one number for all subsets of an order.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import brentq

from benchmarks.sample14 import STEP, Sample, Wave, averaged, followed, grid, ours, trade_off
from calib.dic import CorrelationSettings
from calib.dic.interpolation import Array, grid_slopes, spline_of

EFFICIENT = ((1, 31), (1, 41), (2, 91), (2, 111))
"""subsets that lose 10 % of a wave of a period that L5 has (100 to 870 px)"""
BLURRED, BLURS = ((1, 31), (2, 51)), (0.0, 0.5, 1.0)
"""order and subset; SDs of a blur of the images, px"""
NEAR_TOP = 0.09
"""px of the truth's 0.1"""
STILL = 96
"""columns that do not move in any image (0.01 px at the last)"""


def resolution(subset: float, order: int) -> float:
    """Period of the wave of which a subset's polynomial loses 10 %, px (Reu et al. 2022)."""
    places = (np.arange(2001) - 1000) / 2001 * subset
    weights = np.linalg.pinv(np.vander(places / subset, order + 1, increasing=True))[0]

    def passed(period: float) -> float:
        return float(weights @ np.cos(2 * np.pi * places / period)) - 0.9

    return float(brentq(passed, 1.05 * subset, 8 * subset))


def effective_subset(wave: Wave, truth: Array, subset: int, order: int) -> float:
    """Side of the subset whose polynomial passes most nearly what was measured, px.

    By the sum of squares over all columns, a parabola through it about its least. Raises ValueError
    where it has none: what was measured is not that of a subset.
    """
    sides = np.arange(max(subset // 2 * 2 - 19, 5), subset + 21, 2)
    columns = np.arange(truth.size)
    off = [
        np.sum((wave.mean - np.interp(wave.x, columns, followed(truth, int(side), order))) ** 2)
        for side in sides
    ]
    power = sides.astype(float) ** (2 * order)
    # what is lost of a wave grows with this power of the side, so its square is a parabola in it
    a, b, _ = np.polyfit(power, off, 2)
    if not (a > 0 and b < 0):
        raise ValueError(f"mean: expected a wave as a subset of some {subset} px passes it")
    return float((-b / (2 * a)) ** (1 / (2 * order)))


def efficiency(sample: Sample) -> dict[str, Any]:
    """Noise times resolution beside its theory, with the noise of the images as it is measured.

    The images do not move in their first columns: their differences there are noise. A subset's
    theory: sqrt(2) noise / (RMS slope x side), for order 2 times sqrt(7 / 2), the factor by which
    the least-squares value in the middle of a square is less certain with a quadratic.
    """
    slope = float(np.sqrt(np.mean(grid_slopes(spline_of(sample.reference, 5))[0] ** 2)))
    noise = {
        level: float((image - sample.reference)[:, :STILL].std() / np.sqrt(2))
        for level, image in sample.deformed.items()
    }
    figures: dict[str, Any] = {
        "noise_grey": {level: round(value, 3) for level, value in noise.items()},
        "slope_grey_per_px": round(slope, 3),
    }
    points, truth = grid(sample), sample.truth["L5"]
    for order, subset in EFFICIENT:
        settings = CorrelationSettings(subset=subset, order=order)
        wave = averaged(points, ours(sample, "L5", points, settings).displacement[:, 0])
        random = float(np.sqrt(wave.variance.mean()))
        least = np.sqrt(2) * noise["L5"] / (slope * subset) * (1 if order == 1 else np.sqrt(3.5))
        found = resolution(effective_subset(wave, truth, subset, order), order)
        theory = resolution(subset, order)
        figures[f"order_{order}_subset_{subset}"] = {
            "noise_px": round(random, 5),
            "noise_theory_px": round(float(least), 5),
            "resolution_px": round(found, 1),
            "resolution_theory_px": round(theory, 1),
            "indicator_px2": round(random * found, 3),
            "indicator_theory_px2": round(least * theory, 3),
        }
    return figures


def indicator(wave: Wave, truth: Array, settings: CorrelationSettings) -> float:
    """Noise times the period of which a tenth is lost, as measured, px^2."""
    side = effective_subset(wave, truth, settings.subset, settings.order)
    noise = float(np.sqrt(wave.variance.mean()))
    return round(noise * resolution(side, settings.order), 3)


def interpolation(sample: Sample) -> dict[str, Any]:
    """What the bias of the interpolation adds to the wave, by blur, with what is stated of it.

    Stated: median of the points where the truth is beyond 0.09 px.
    """
    points = grid(sample, 2 * STEP)
    figures: dict[str, Any] = {}
    for order, subset in BLURRED:
        for blur in BLURS:
            settings = CorrelationSettings(subset=subset, order=order, blur=blur)
            name = f"order_{order}_subset_{subset}_blur_{blur:g}"
            figures[name] = {}
            for level, truth in sample.truth.items():
                found = ours(sample, level, points, settings)
                wave = averaged(points, found.displacement[:, 0])
                far = np.abs(np.interp(points[:, 0], np.arange(truth.size), truth)) > NEAR_TOP
                stated = np.nanmedian(found.interpolation[far, 0])
                all_of_it = trade_off(wave, truth, subset, order)
                kept = ("mean_loss_px", "mean_filter_loss_px", "noise_px")
                figures[name][level] = {key: all_of_it[key] for key in kept}
                figures[name][level]["stated_interpolation_px"] = round(float(stated), 5)
                if level == "L5" and order == 1:
                    figures[name][level]["indicator_px2"] = indicator(wave, truth, settings)
    return figures
