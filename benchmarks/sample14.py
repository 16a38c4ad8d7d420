"""DIC Challenge sample 14, u(x) of 0.1 px: loss of amplitude against noise, ours and published.

Published, as far as it is at hand:
- DICe's own regression test on these images (github.com/dicengine/dice, tests/regression,
  dic_challenge_14_nlvc and _vsg, commits 27a7807 and d3a5ebc): subset 35, step 25, first order;
  the root of the sum of squares over the columns of (mean of u less truth) is at most 0.06 px.
- The theory of the second Challenge: see `sample14_efficiency`.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from calib.dic import Correlation, CorrelationSettings, correlate, grid_points, read_image
from calib.dic import rectangle_mask as rectangle
from calib.dic.interpolation import Array
from calib.dic.overlap import error_correlation

LEVELS = {"L1": 1, "L5": 5}
"""columns of u in the table of truths"""
BOX = (40, 30, 2008, 560)
STEP = 8
SETTINGS = ((1, 21), (1, 31), (2, 31), (2, 41), (2, 51))
"""order and subset"""
DICE_SUBSET, DICE_STEP, DICE_BOUND = 35, 25, 0.06
LEAST_SIZE = 0.05
"""px: smaller half waves are not looked at"""


class Sample(NamedTuple):
    """The images and the truth."""

    reference: Array
    """(h, w)"""
    deformed: dict[str, Array]
    """(h, w) by level"""
    truth: dict[str, Array]
    """(w,) u at each column, px"""


class Wave(NamedTuple):
    """u averaged over the rows of points."""

    x: Array
    """(n,) columns, px"""
    mean: Array
    variance: Array
    """(n,) of u over the rows, px^2"""


def read_sample(data: Path) -> Sample:
    """Images and truth from the folder of published images."""
    folder = data / "dic2d_sample14_sinusoid"
    table = np.loadtxt(folder / "command.csv", delimiter=",")
    return Sample(
        read_image(folder / "Sample14 Reference.tif").grey,
        {name: read_image(file_of(folder, name)).grey for name in LEVELS},
        {name: table[:, column] for name, column in LEVELS.items()},
    )


def file_of(folder: Path, level: str) -> Path:
    """The deformed image of a level."""
    return folder / f"Sample14 {level} Amp0.1b.tif"


def averaged(points: Array, u: Array) -> Wave:
    """Mean and variance of u (n,) over the rows of points (n, 2), which make whole columns."""
    good = np.isfinite(u)
    x, column = np.unique(np.round(points[good, 0], 6), return_inverse=True)
    count = np.bincount(column)
    mean = np.bincount(column, u[good]) / count
    variance = np.bincount(column, (u[good] - mean[column]) ** 2) / count
    return Wave(x, mean, variance)


def half_waves(truth: Array) -> list[slice]:
    """Between the zeros of the truth (n,) at the columns: where it is large enough to be seen."""
    edges = np.flatnonzero(np.diff(np.sign(truth)) != 0) + 1
    parts = [slice(start, end) for start, end in pairwise(edges)]
    return [
        part
        for part in parts
        if part.stop - part.start >= 3 and np.abs(truth[part]).max() >= LEAST_SIZE
    ]


def losses(mean: Array, truth: Array) -> Array:
    """(m,) what each half wave has lost of its height, px of a 0.1 px wave.

    The height measured is the factor by which the true half wave fits it best.
    """
    return np.array(
        [
            (1 - mean[part] @ truth[part] / (truth[part] @ truth[part])) * np.abs(truth[part]).max()
            for part in half_waves(truth)
        ]
    )


def followed(truth: Array, subset: int, order: int) -> Array:
    """(w,) what a subset passes of the truth (w,): the polynomial fitted by least squares."""
    return np.asarray(savgol_filter(truth, subset, order))


def trade_off(wave: Wave, truth: Array, subset: int, order: int) -> dict[str, float]:
    """Loss and noise of one program at one subset, with those of the subset's polynomial."""
    columns = np.arange(truth.size)
    there = np.interp(wave.x, columns, truth)
    passed = np.interp(wave.x, columns, followed(truth, subset, order))
    lost, by_filter = losses(wave.mean, there), losses(passed, there)
    return {
        "amplitude_error_px": _rounded(np.abs(lost).max()),
        "filter_loss_px": _rounded(np.abs(by_filter).max()),
        "mean_loss_px": _rounded(lost.mean()),
        "mean_filter_loss_px": _rounded(by_filter.mean()),
        "rms_of_mean_px": _rounded(np.sqrt(np.mean((wave.mean - there) ** 2))),
        "noise_px": _rounded(np.sqrt(wave.variance.mean())),
    }


def _rounded(value: float) -> float:
    return round(float(value), 5)


def ours(sample: Sample, level: str, points: Array, settings: CorrelationSettings) -> Correlation:
    """What softcal finds at points (n, 2)."""
    return correlate(sample.reference, sample.deformed[level], points, settings)


def grid(sample: Sample, step: int = STEP) -> Array:
    """(n, 2) points of the comparison, px."""
    h, w = sample.reference.shape
    return grid_points(rectangle((h, w), BOX), step)[0]


def by_settings(sample: Sample) -> dict[str, Any]:
    """Trade-off at each order and subset, and how large a loss noise alone would show."""
    points = grid(sample)
    figures: dict[str, Any] = {}
    for order, subset in SETTINGS:
        settings = CorrelationSettings(subset=subset, order=order)
        name = f"order_{order}_subset_{subset}"
        figures[name] = {}
        for level, truth in sample.truth.items():
            found = ours(sample, level, points, settings)
            wave = averaged(points, found.displacement[:, 0])
            figures[name][level] = {
                **trade_off(wave, truth, subset, order),
                **by_noise(wave, truth, points, settings),
                "lost": int(np.sum(~found.valid)),
            }
    return figures


def by_noise(
    wave: Wave, truth: Array, points: Array, settings: CorrelationSettings
) -> dict[str, float]:
    """The loss to expect of a subset that follows its polynomial and has this noise, px.

    Errors of points go together as their subsets overlap, so the mean over the rows and the fit
    of a half wave leave more than independent points would. Of 20,000 draws.
    """
    columns = np.arange(truth.size)
    there = np.interp(wave.x, columns, truth)
    passed = np.interp(wave.x, columns, followed(truth, settings.subset, settings.order))
    expected, parts = losses(passed, there), half_waves(there)
    y = np.unique(points[:, 1])
    rows = float(error_correlation(settings, np.zeros(1), y[:, None] - y).mean())
    across = error_correlation(settings, wave.x[:, None] - wave.x, np.zeros(1))
    weights = np.zeros((len(parts), wave.x.size))
    for weight, part in zip(weights, parts, strict=True):
        size = np.abs(there[part]).max()
        weight[part] = there[part] / (there[part] @ there[part]) * size
    covariance = wave.variance.mean() * rows * weights @ across @ weights.T
    draws = np.random.default_rng(0).multivariate_normal(expected, covariance, 20_000)
    middle, high = np.quantile(np.abs(draws).max(axis=1), [0.5, 0.95])
    return {
        "expected_error_px": _rounded(middle),
        "expected_error_95_px": _rounded(high),
        "mean_loss_sd_px": _rounded(np.sqrt(covariance.mean())),
    }


def dice_bound(sample: Sample) -> dict[str, Any]:
    """The figure that DICe's own regression test bounds by 0.06 px, by its subset and columns.

    Columns and rows as DICe's Schema::initialize lays them: from subset - 1 in steps. With a third
    of it: what a subset of order 1 does not follow, and what the noise of the means leaves.
    """
    h, w = sample.reference.shape
    xs, ys = (
        DICE_SUBSET - 1 + DICE_STEP * np.arange((side - 2 * DICE_SUBSET) // DICE_STEP + 1)
        for side in (w, h)
    )
    x, y = np.meshgrid(xs, ys)
    points = np.column_stack([x.ravel(), y.ravel()]).astype(float)
    figures: dict[str, Any] = {"bound_px": DICE_BOUND, "columns": len(xs), "rows": len(ys)}
    for order in (1, 2):
        settings = CorrelationSettings(subset=DICE_SUBSET, order=order)
        for level, truth in sample.truth.items():
            wave = averaged(points, ours(sample, level, points, settings).displacement[:, 0])
            rows = error_correlation(settings, np.zeros(1), (ys[:, None] - ys).astype(float))
            passed = followed(truth, DICE_SUBSET, order)
            figures[f"order_{order}_{level}"] = {
                "difference_px": _rounded(np.linalg.norm(wave.mean - truth[xs])),
                "not_followed_px": _rounded(np.linalg.norm(passed[xs] - truth[xs])),
                "by_noise_px": _rounded(np.sqrt(wave.variance.sum() * rows.mean())),
            }
    return figures
