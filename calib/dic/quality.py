"""Exposure and speckle of an image, before anything is correlated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage

from calib.dic.images import GreyImage
from calib.dic.interpolation import Array, grid_slopes, spline_of
from calib.dic.prepared import BoolArray

LEAST_CONTRAST, MOST_SATURATED = 0.02, 0.05
SMALLEST_SPECKLE, LARGEST_SPECKLE = 2.5, 20.0
"""px; finer speckle aliases, coarser is against T 2.6.1"""
LEAST_SPECKLES = 3.0
"""along the side of a subset"""
MOST_ALIKE = 0.7
"""autocorrelation of speckle at a distance; of a dozen speckles at random it may reach 0.55"""


@dataclass(frozen=True)
class Quality:
    """What an image is worth in its region; grey levels as in the file, lengths in px."""

    mean: float
    """grey level"""
    contrast: float
    """standard deviation of the grey levels as a share of full scale"""
    dark: float
    """share of pixels at zero"""
    saturated: float
    """share of pixels at the largest grey level: full scale, or where the sensor clips"""
    speckle: float
    """mean diameter of speckles: full width at half maximum of the autocorrelation, px"""
    mean_gradient: float
    """mean intensity gradient (Pan, Lu, Xie 2010, Opt. Lasers Eng. 48:469), grey levels per px"""
    noise: float
    """standard deviation of the grey levels of one image, from a repeat, or, without one, at most
    as found where the image is smoothest"""
    predicted_sigma: float
    """standard deviation of a displacement of a typical subset by that noise in both images, px"""
    warnings: tuple[str, ...]
    """one sentence each"""


def image_noise(image: Array, repeat: Array, mask: BoolArray) -> float:
    """Noise of one image of a still object, grey levels: SD of the difference of two / sqrt 2.

    A change of exposure in between is taken out.
    """
    a, b = image[mask], repeat[mask]
    slope = np.sum((a - a.mean()) * (b - b.mean())) / np.sum((b - b.mean()) ** 2)
    return float(np.std(a - slope * b) / np.sqrt(1 + slope**2))


def smooth_noise(image: Array, mask: BoolArray) -> float:
    """Upper estimate of the noise from one image, grey levels.

    SD by median of the filter of Immerkaer (1996, Comp. Vision Image Underst. 64:300), which is
    blind to planes and saddles, over the pixels where it is smallest: speckle adds to it.
    """
    kernel = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]])
    square = ndimage.uniform_filter(ndimage.convolve(image, kernel) ** 2, 7)
    inner = ndimage.binary_erosion(mask, iterations=5)
    values = square[inner if inner.any() else mask]
    return float(np.sqrt(max(np.quantile(values, 0.1), 0.0)) / 6)


def _autocorrelation(grey: Array, mask: BoolArray) -> tuple[Array, Array]:
    """Mean product (2 h, 2 w) of pixels in the mask (h, w) by their distance, and their number.

    grey (h, w) is 0 beside the mask; negative distances are in the later half.
    """
    shape = [2 * side for side in grey.shape]
    power = np.abs(fft.rfft2(grey, s=shape)) ** 2
    count = np.abs(fft.rfft2(mask.astype(np.float64), s=shape)) ** 2
    pairs = np.maximum(fft.irfft2(count, s=shape), 1.0)
    return np.asarray(fft.irfft2(power, s=shape) / pairs), pairs


def period(image: Array, mask: BoolArray, scale: float) -> float:
    """Distance at which the pattern repeats itself, px; NaN where it does not.

    That of the nearest peak of the autocorrelation beside the middle one, at distances that half
    of the mask (h, w) has; of what is finer than `scale` [px]: light that changes over the image
    is no pattern.
    """
    weight = np.maximum(ndimage.gaussian_filter(mask.astype(np.float64), scale), 1e-3)
    smooth = ndimage.gaussian_filter(np.where(mask, image, 0.0), scale) / weight
    fine = np.where(mask, image - smooth, 0.0)
    fine[mask] -= fine[mask].mean()
    found, pairs = (fft.fftshift(array) for array in _autocorrelation(fine, mask))
    middle = found.shape[0] // 2, found.shape[1] // 2
    if not found[middle] > 0:
        return float("nan")
    alike = (found > MOST_ALIKE * found[middle]) & (pairs >= 0.5 * pairs[middle])
    parts, _ = ndimage.label(alike)
    peaks = alike & (parts != parts[middle]) & (found >= ndimage.maximum_filter(found, 3))
    if not peaks.any():
        return float("nan")
    y, x = np.nonzero(peaks)
    return float(np.hypot(y - middle[0], x - middle[1]).min())


def speckle_size(image: Array, mask: BoolArray) -> float:
    """Full width at half maximum of the autocorrelation over the mask (h, w), px; NaN if flat."""
    grey = np.where(mask, image - image[mask].mean(), 0.0)
    correlation, _ = _autocorrelation(grey, mask)
    if not correlation[0, 0] > 0:
        return float("nan")
    widths = []
    for line in (correlation[0, : grey.shape[1]], correlation[: grey.shape[0], 0]):
        below = np.flatnonzero(line < line[0] / 2)
        if below.size == 0:
            return float("nan")
        k = int(below[0])
        widths.append(k - 1 + (line[k - 1] - line[0] / 2) / (line[k - 1] - line[k]))
    return float(np.mean(widths) * 2)


def quality(
    image: GreyImage, mask: BoolArray, subset: int, repeat: GreyImage | None = None
) -> Quality:
    """Judge an image in its mask (h, w) for a subset of `subset` px."""
    grey, full = image.grey, image.full_scale
    values = grey[mask]
    slope_x, slope_y = (slope[mask] for slope in grid_slopes(spline_of(grey, 3)))
    noise = smooth_noise(grey, mask) if repeat is None else image_noise(grey, repeat.grey, mask)
    # noise adds to the square of the slopes: 1.57 is the gain of the cubic spline's slope
    squares = max(float(np.mean(slope_x**2 + slope_y**2)) / 2 - 1.57 * noise**2, 0.0)
    sigma = np.sqrt(2) * noise / (subset * np.sqrt(squares)) if squares > 0 else float("inf")
    size = speckle_size(grey, mask)
    contrast = float(values.std() / full)
    warnings = []
    if repeat is not None and np.array_equal(repeat.grey, grey):
        warnings.append(f"{repeat.name} is pixel for pixel {image.name}, so it shows no noise")
    if np.isfinite(again := period(grey, mask, subset)):
        warnings.append(
            f"the pattern repeats itself every {again:.0f} px, expected speckle at random: points "
            "may be found whole periods off"
        )
    dark, saturated = float(np.mean(values <= 0)), float(np.mean(values >= values.max()))
    return Quality(
        mean=float(values.mean()),
        contrast=contrast,
        dark=dark,
        saturated=saturated,
        speckle=size,
        mean_gradient=float(np.mean(np.hypot(slope_x, slope_y))),
        noise=noise,
        predicted_sigma=float(sigma),
        warnings=(*warnings, *_warnings(contrast, dark, saturated, size, subset)),
    )


def _warnings(
    contrast: float, dark: float, saturated: float, size: float, subset: int
) -> tuple[str, ...]:
    found = []
    if contrast < LEAST_CONTRAST:
        found.append(
            f"contrast is {contrast:.1%} of full scale, expected {LEAST_CONTRAST:.0%} or more"
        )
    for name, share in (("black", dark), ("saturated", saturated)):
        if share > MOST_SATURATED:
            most = f"{MOST_SATURATED:.0%} or less"
            found.append(f"{share:.0%} of the pixels are {name}, expected {most}")
    if np.isfinite(size):
        if size < SMALLEST_SPECKLE:
            found.append(f"speckles of {size:.1f} px alias, expected {SMALLEST_SPECKLE} or more")
        if size > LARGEST_SPECKLE:
            found.append(
                f"speckles of {size:.1f} px are coarse, expected {LARGEST_SPECKLE:g} at most"
            )
        if subset < LEAST_SPECKLES * size:
            needed = int(np.ceil(LEAST_SPECKLES * size)) // 2 * 2 + 1
            found.append(f"a subset of {subset} px has few speckles, expected {needed} px or more")
    return tuple(found)
