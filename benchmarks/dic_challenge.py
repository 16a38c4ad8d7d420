"""Image correlation on images that others published: DIC Challenge, OpenCorr, SUN-DIC, DICe."""

from __future__ import annotations

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
from calib.dic.interpolation import Array, Degree, grid_slopes, spline_of
from calib.dic.interpolation_bias import REACH, differences, filter_of

LOADS = ("04", "08", "11")
"""of sample 12"""
DICE_SUBSET = 27
BLURS = (0.5, 0.8, 1.0)
"""px; with the first our bias is half as large and the noise 2 % larger"""


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

    Stated of a difference: the noise of both (that of DICe's by our own with its subset of 27 px;
    the images being the same, they are not independent and the difference is smaller) and the bias
    of both interpolations by one formula, as two programs state them that do not know each other
    (`apart`), and with what is known of the two here, the same speckle and the same sign, so that
    the biases differ (`together`). Nothing is fitted.
    """
    folder = data / "dic2d_sample12_openhole"
    a = read_image(folder / "oht_cfrp_00.tiff").grey
    figures: dict[str, Any] = {}
    for blur in (0.0, *BLURS):
        name = "as_is" if blur == 0.0 else f"blur_{blur:g}"
        figures[name] = {number: _against_dice(folder, a, number, blur) for number in LOADS}
    figures["quarter_px_x"] = {
        f"degree_{degree}": _bias_at_quarter(a, points_of(folder), degree) for degree in (3, 5)
    }
    return {"sample12_against_dice": figures}


def points_of(folder: Path, number: str = LOADS[0]) -> Array:
    """(n, 2) px, where DICe has measured."""
    (gold,) = read_dic(folder / "gold" / f"DICe_solution_{number}.txt", 1.0).frames
    return np.asarray(gold.position[:, :2] * [1.0, -1.0])


def _against_dice(folder: Path, a: Array, number: str, blur: float) -> dict[str, Any]:
    (gold,) = read_dic(folder / "gold" / f"DICe_solution_{number}.txt", 1.0).frames
    points, truth = points_of(folder, number), gold.displacement[:, :2] * [1.0, -1.0]
    b = read_image(folder / f"oht_cfrp_{number}.tiff").grey
    ours = correlate(a, b, points, CorrelationSettings(blur=blur))
    theirs = correlate(a, b, points, CorrelationSettings(subset=DICE_SUBSET))
    both = ours.valid & theirs.valid & gold.valid
    off = (ours.displacement - truth)[both]
    noise = np.hypot(ours.sigma, theirs.sigma)[both]
    phase = np.sin(2.0 * np.pi * truth[both])
    wave = keys_wave(a, points, theirs.zncc)[both] * np.abs(phase)
    own = ours.interpolation[both]
    stated = {
        "noise_alone": noise,
        "apart": np.sqrt(noise**2 + own**2 + wave**2),
        "together": np.hypot(noise, wave - own),
    }
    # what is left when the predicted waves are taken off: both grow with the sine
    rest = off - (own - wave) * np.sign(phase)
    far = np.abs(phase) > 0.3
    share = {name: np.abs(off / sd) < 2 for name, sd in stated.items()}
    share["waves_taken_off"] = np.abs(rest / noise) < 2
    return {
        "points": int(both.sum()),
        "lost": _lost(ours),
        "median_difference_px": _rounded(np.median(off, axis=0)),
        "sd_difference_px": _rounded(off.std(axis=0)),
        "stated_noise_px": _rounded(np.median(ours.sigma[both], axis=0)),
        "stated_interpolation_px": _rounded(np.median(own, axis=0)),
        "stated_interpolation_dice_px": _rounded(np.median(wave, axis=0)),
        "wave_predicted_px": _rounded(
            np.nanmedian(np.where(far, (own - wave) / np.abs(phase), np.nan), axis=0)
        ),
        "wave_fitted_px": _rounded(
            np.sum((off - np.median(off, axis=0)) * phase, axis=0) / np.sum(phase**2, axis=0)
        ),
        "within_two_deviations": {
            name: round(float(np.mean(inside)), 4) for name, inside in share.items()
        },
    }


def _rounded(values: Array) -> list[float]:
    return [round(float(value), 5) for value in values]


def keys_transfer(frequency: Array) -> Array:
    """Transfer (n,) of R. G. Keys' fourth-order convolution (IEEE Trans. ASSP 29, 1981) in 1/px."""
    x = (np.arange(6000) + 0.5) / 2000
    near = 4 / 3 * x**3 - 7 / 3 * x**2 + 1
    middle = -7 / 12 * x**3 + 3 * x**2 - 59 / 12 * x + 2.5
    far = x**3 / 12 - 2 / 3 * x**2 + 1.75 * x - 1.5
    kernel = np.where(x < 1, near, np.where(x < 2, middle, far))
    return np.asarray(np.cos(2 * np.pi * np.outer(frequency, x)) @ kernel / 1000)


def keys_wave(image: Array, points: Array, zncc: Array) -> Array:
    """(n, 2) amplitude of the wave of DICe's result over the fraction of a pixel, px.

    By Keys' convolution in subsets of DICe's size, with its slopes: differences over four pixels.
    `zncc` (n,) tells the noise.
    """
    taps, slopes = filter_of(keys_transfer), np.zeros(REACH)
    slopes[:2] = 8 / 12, -1 / 12
    errors, gradients = (tuple(np.empty((2, *image.shape))) for _ in range(2))
    differences(image, taps, *errors)
    differences(image, slopes, *gradients)
    exact = grid_slopes(spline_of(image, 5))
    amplitude, half = np.empty((len(points), 2)), DICE_SUBSET // 2
    for index, (x, y) in enumerate(np.round(points).astype(int)):
        cut = np.s_[y - half : y + half + 1, x - half : x + half + 1]
        # residuals hold the noise of two images, that of one a little smoothed
        noise = image[cut].var() * (1 - zncc[index] ** 2) / 1.8 * image[cut].size
        for k in range(2):
            top = np.sum(gradients[k][cut] * errors[k][cut]) - 2 * noise * slopes @ taps
            bottom = np.sum(gradients[k][cut] * exact[k][cut]) - 2 * noise * slopes @ slopes
            amplitude[index, k] = top / bottom
    return amplitude


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
