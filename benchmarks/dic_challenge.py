"""Image correlation on images that others published: DIC Challenge, OpenCorr, SUN-DIC, DICe."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from calib.data.readers import read_dic
from calib.dic import (
    Correlation,
    CorrelationSettings,
    Reason,
    correlate,
    follow,
    grid_points,
    prepare,
    read_image,
    rectangle_mask,
)
from calib.dic.interpolation import Array, Degree


def _grid(image: Array, box: tuple[float, float, float, float], step: int) -> Array:
    return grid_points(rectangle_mask((image.shape[0], image.shape[1]), box), step)[0]


def _lost(found: Correlation) -> dict[str, int]:
    reasons = {r.name.lower(): int(np.sum(found.reason == r)) for r in list(Reason)[1:]}
    return {name: count for name, count in reasons.items() if count}


def sample5(data: Path) -> dict[str, Any]:
    """Shift of 0.1 px with noise and a change of contrast; the other image did not move."""
    folder = data / "dic2d_sample5_shift"
    a = read_image(folder / "Sample5 Reference.tif").grey
    points = _grid(a, (30, 30, 482, 482), 16)
    figures: dict[str, Any] = {}
    worst = 0.0
    for name, truth in (
        ("Sample5-000 X0.00 Y0.00 N2 C75 R10.tif", 0.0),
        ("Sample5-001 X0.10 Y0.10 N2 C100 R20.tif", 0.1),
    ):
        found = correlate(a, read_image(folder / name).grey, points)
        error = found.displacement - truth
        bias = error.mean(axis=0)
        worst = max(worst, float(np.abs(bias).max()))
        figures[f"shift_{truth:g}"] = {
            "bias_px": [round(float(v), 6) for v in bias],
            "noise_px": [round(float(v), 6) for v in error.std(axis=0)],
            "stated_sigma_px": [round(float(v), 6) for v in np.median(found.sigma, axis=0)],
            "standardised_sd": round(float(np.std((error - bias) / found.sigma)), 4),
        }
    return {"sample5_bias_px": round(worst, 6), "sample5": figures}


def sample14(data: Path) -> dict[str, Any]:
    """Sinusoids of 0.1 px of rising frequency: loss of amplitude against noise, by subset.

    The truth is u(x); measured u is averaged over the rows of points. Over each half wave the
    amplitude error is the difference of measured and true extreme; stated is the largest.
    """
    folder = data / "dic2d_sample14_sinusoid"
    a = read_image(folder / "Sample14 Reference.tif").grey
    table = np.loadtxt(folder / "command.csv", delimiter=",")
    points = _grid(a, (40, 30, 2008, 560), 8)
    columns = np.unique(points[:, 0])
    figures: dict[str, Any] = {}
    for order, subset in ((1, 21), (1, 31), (2, 31), (2, 41), (2, 51)):
        settings = CorrelationSettings(subset=subset, order=order)
        name = f"order_{order}_subset_{subset}"
        figures[name] = {}
        for level, column in (("L1", 1), ("L5", 5)):
            found = correlate(
                a, read_image(folder / f"Sample14 {level} Amp0.1b.tif").grey, points, settings
            )
            u = found.displacement[:, 0].reshape(-1, columns.size)
            truth = np.interp(columns, table[:, 0], table[:, column])
            mean = np.nanmean(u, axis=0)
            figures[name][level] = {
                "amplitude_error_px": round(_amplitude_error(columns, mean, truth), 5),
                "rms_of_mean_px": round(float(np.sqrt(np.mean((mean - truth) ** 2))), 5),
                "noise_px": round(float(np.sqrt(np.nanmean(np.nanvar(u, axis=0)))), 5),
                "lost": int(np.sum(~found.valid)),
            }
    best = figures["order_2_subset_51"]
    return {
        "sample14_amplitude_error_px": best["L5"]["amplitude_error_px"],
        "sample14_noise_px": best["L5"]["noise_px"],
        "sample14": figures,
    }


def _amplitude_error(x: Array, mean: Array, truth: Array) -> float:
    """Largest relative loss over the half waves, as px of a 0.1 px wave.

    The amplitude measured in a half wave is the factor by which the true wave fits it best.
    """
    edges = np.flatnonzero(np.diff(np.sign(truth)) != 0) + 1
    errors = []
    for start, end in pairwise(edges):
        part = slice(start, end)
        size = float(np.abs(truth[part]).max())
        if end - start < 3 or size < 0.05:
            continue
        factor = float(mean[part] @ truth[part] / (truth[part] @ truth[part]))
        errors.append(abs(factor - 1) * size)
    return max(errors) if errors else float("nan")


def stretch(data: Path) -> dict[str, Any]:
    """30 % of uniform stretch, displacements to 750 px, from one image to the other."""
    folder = data / "dic2d_large_stretch"
    a, b = (read_image(folder / f"utn_{name}.png").grey for name in ("00", "30"))
    points = _grid(a, (40, 40, 2461, 461), 20)
    found = correlate(a, b, points)
    truth = np.column_stack([0.30 * points[:, 0], -0.09 * (points[:, 1] - 250)])
    error = found.displacement - truth
    return {
        "stretch_rms_px": round(float(np.sqrt(np.nanmean(error**2))), 5),
        "stretch": {
            "points": len(points),
            "lost": _lost(found),
            "bias_px": [round(float(v), 6) for v in np.nanmean(error, axis=0)],
            "standardised_sd": round(float(np.nanstd(error / found.sigma)), 4),
        },
    }


def sample12(data: Path) -> dict[str, Any]:
    """Plate with a hole: differences from DICe's result at its points, over what is stated.

    The difference of two independent results would have a deviation of sqrt(2) sigma; the same
    images make it smaller. What is left has a wave over the displacement's fraction of a pixel, as
    interpolation gives it: its amplitude, and the share without it. The wave of ours by itself is
    that of the reference image against itself shifted by a quarter px, exactly for a picture
    without frequencies beyond Nyquist's (its noise, which goes along, makes it an upper bound).
    """
    folder = data / "dic2d_sample12_openhole"
    a = read_image(folder / "oht_cfrp_00.tiff").grey
    figures: dict[str, Any] = {}
    for name in ("04", "08", "11"):
        (gold,) = read_dic(folder / "gold" / f"DICe_solution_{name}.txt", 1.0).frames
        points = gold.position[:, :2] * [1.0, -1.0]
        truth = gold.displacement[:, :2] * [1.0, -1.0]
        found = correlate(a, read_image(folder / f"oht_cfrp_{name}.tiff").grey, points)
        both = found.valid & gold.valid
        off = (found.displacement - truth)[both]
        z = off / (np.sqrt(2) * found.sigma[both])
        phase = 2.0 * np.pi * truth[both]
        middle = np.median(off, axis=0)
        wave = np.sum((off - middle) * np.sin(phase), axis=0) / np.sum(np.sin(phase) ** 2, axis=0)
        rest = (off - middle - wave * np.sin(phase)) / (np.sqrt(2) * found.sigma[both])
        figures[name] = {
            "points": int(both.sum()),
            "lost": _lost(found),
            "median_difference_px": [round(float(v), 5) for v in np.median(off, axis=0)],
            "sd_difference_px": [round(float(v), 5) for v in off.std(axis=0)],
            "stated_sigma_px": [round(float(v), 5) for v in np.median(found.sigma[both], axis=0)],
            "within_two_deviations": round(float(np.mean(np.abs(z) < 2)), 4),
            "wave_px": [round(float(v), 5) for v in wave],
            "within_two_without_wave": round(float(np.mean(np.abs(rest) < 2)), 4),
        }
    figures["own_wave_px"] = {
        f"degree_{degree}": _bias_at_quarter(a, points, degree) for degree in (3, 5)
    }
    return {"sample12_against_dice": figures}


def _bias_at_quarter(image: Array, points: Array, degree: Degree) -> float:
    """Median error in x for an image shifted by 0.25 px in Fourier space, px."""
    h, w = image.shape
    # mirrored, so that it has no jump at its borders
    whole = np.fft.fft2(np.pad(image, ((0, h), (0, w)), mode="symmetric"))
    moved = np.fft.ifft2(ndimage.fourier_shift(whole, (0.0, 0.25))).real[:h, :w]
    found = correlate(image, moved, points, CorrelationSettings(degree=degree))
    return round(float(np.nanmedian(found.displacement[:, 0]) - 0.25), 5)


def strip(data: Path) -> dict[str, Any]:
    """A real strip under uneven light: points lost, and one against two steps to the last image."""
    folder = data / "dic2d_sundic_strip"
    a, b, c = (read_image(folder / f"img_{k}.tif").grey for k in (0, 2, 4))
    settings = CorrelationSettings(subset=33)
    points = _grid(a, (350, 120, 1450, 480), 5)
    first, last = follow(prepare(a, settings.degree), [b, c], points, settings)
    direct = correlate(a, c, points, settings)
    # the way over img_2 with a renewed reference
    places = points + first.displacement
    step = correlate(b, c, places[first.valid], settings)
    both = first.displacement[first.valid] + step.displacement
    off = both - direct.displacement[first.valid]
    spread = np.hypot(np.hypot(first.sigma[first.valid], step.sigma), direct.sigma[first.valid])
    return {
        "strip": {
            "points": len(points),
            "lost": [_lost(first), _lost(last), _lost(direct)],
            "lowest_zncc": round(float(np.nanmin([first.zncc, last.zncc])), 4),
            "relative_minus_absolute_px": {
                "median": [round(float(v), 5) for v in np.nanmedian(off, axis=0)],
                "sd": [round(float(v), 5) for v in np.nanstd(off, axis=0)],
                "stated": round(float(np.nanmedian(spread)), 5),
            },
        }
    }
