"""First guesses without any knowledge: a few points whose surroundings are found by correlation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import fft
from skimage.feature import match_template

from calib.dic.interpolation import Array
from calib.dic.prepared import BoolArray, IntArray, Task, refine
from calib.dic.reasons import Reason

N_SEED = 12
ENOUGH = 3
"""good seeds are enough; the others are found by propagation"""
WINDOWS = (2, 4, 8)
"""sides of the windows of phase correlation, in subsets"""


def seed_points(points: Array, inside: IntArray, n: int = N_SEED) -> IntArray:
    """Indices of up to n of points[inside], far from each other, the middle first."""
    chosen = points[inside]
    first = int(np.argmin(np.sum((chosen - np.median(chosen, axis=0)) ** 2, axis=1)))
    picked = [first]
    distance = np.sum((chosen - chosen[first]) ** 2, axis=1)
    while len(picked) < min(n, inside.size):
        farthest = int(np.argmax(distance))
        picked.append(farthest)
        distance = np.minimum(distance, np.sum((chosen - chosen[farthest]) ** 2, axis=1))
    return inside[picked]


def phase_shift(reference: Array, deformed: Array, point: Array, side: int) -> Array | None:
    """Whole-pixel shift of a window around point by phase correlation (Kuglin, Hines 1975), px.

    Of images of different sizes the window is of the part that both have.
    """
    h, w = np.minimum(reference.shape, deformed.shape)
    side = int(min(side, h, w))
    x0 = int(np.clip(round(point[0]) - side // 2, 0, w - side))
    y0 = int(np.clip(round(point[1]) - side // 2, 0, h - side))
    cut = (slice(y0, y0 + side), slice(x0, x0 + side))
    taper = np.hanning(side + 2)[1:-1]
    window = np.outer(taper, taper)
    a, b = (window * (image[cut] - image[cut].mean()) for image in (reference, deformed))
    if not (a.any() and b.any()):
        return None
    cross = np.conj(fft.rfft2(a)) * fft.rfft2(b)
    peak = fft.irfft2(
        cross / np.maximum(np.abs(cross), 1e-12 * np.abs(cross).max()), s=(side, side)
    )
    y, x = np.unravel_index(int(np.argmax(peak)), peak.shape)
    return np.array([x - side * (x > side // 2), y - side * (y > side // 2)], dtype=np.float64)


def template_shift(reference: Array, deformed: Array, point: Array, radius: int) -> Array | None:
    """Whole-pixel shift of the subset around point by its correlation with the whole image, px."""
    h, w = reference.shape
    x, y = (round(float(value)) for value in point)
    if not (radius <= x < w - radius and radius <= y < h - radius):
        return None
    template = reference[y - radius : y + radius + 1, x - radius : x + radius + 1]
    if np.ptp(template) == 0 or np.ptp(deformed) == 0:
        return None
    if min(deformed.shape) < len(template):
        return None
    map_: Array = match_template(deformed, template)
    top, left = np.unravel_index(int(np.argmax(map_)), map_.shape)
    return np.array([left + radius - x, top + radius - y], dtype=np.float64)


def _shifts(reference: Array, deformed: Array, point: Array, side: int) -> Iterator[Array | None]:
    """Guesses, cheap ones first."""
    for window in WINDOWS:
        yield phase_shift(reference, deformed, point, window * side)
    yield np.zeros(2)
    yield template_shift(reference, deformed, point, side // 2)
    yield template_shift(reference, deformed, point, side)


def in_region(task: Task) -> BoolArray:
    """(n,) whether the pixel of each point is one of the region."""
    x, y = np.round(task.points).astype(np.int64).T
    h, w = task.reference.mask.shape
    on_image = (x >= 0) & (x < w) & (y >= 0) & (y < h)
    inside: BoolArray = on_image & task.reference.mask[np.clip(y, 0, h - 1), np.clip(x, 0, w - 1)]
    return inside


def find_seeds(task: Task, deformed_image: Array) -> None:
    """Correlate a few points of a task from scratch, in the deformed image (h, w)."""
    reference, points, settings = task.reference, task.points, task.settings
    inside = np.flatnonzero(in_region(task))
    if inside.size == 0:
        return
    good = 0
    for seed in seed_points(points, inside):
        one = np.array([seed])
        shifts = _shifts(reference.image, deformed_image, points[seed], settings.subset)
        for shift in shifts:
            if shift is None:
                continue
            task.parameters[seed] = 0.0
            task.parameters[seed, :2] = shift
            refine(task, one)
            if task.results[seed, 3] == Reason.VALID:
                good += 1
                break
        if good >= ENOUGH:
            return
