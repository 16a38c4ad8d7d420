"""Images made ready once for many correlations, and the compiled loop spread over threads."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from calib.dic.gauss_newton import correlate_range
from calib.dic.interpolation import (
    AT_PIXEL,
    Array,
    Degree,
    Spline,
    grid_slopes,
    spline_of,
    weights3,
    weights5,
)
from calib.dic.settings import CorrelationSettings
from calib.dic.subset import N_PARAMETER

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]
N_RESULT = 5
TABLE = 64
PARTS_PER_THREAD = 8
"""so that threads end together, though points differ in their iterations"""
LEAST_PART = 8


class Reference(NamedTuple):
    """The image that the subsets are cut from."""

    image: Array
    """(h, w) grey levels"""
    slope_x: Array
    slope_y: Array
    mask: BoolArray
    """(h, w) False where a pixel does not count"""


def as_image(image: npt.ArrayLike, name: str) -> Array:
    """A grey image as float64; raises ValueError for anything that is none."""
    grey = np.ascontiguousarray(image, dtype=np.float64)
    if grey.ndim != 2 or min(grey.shape) < 8:
        raise ValueError(
            f"{name}: expected a grey image (h, w) of 8 px or more, found {grey.shape}"
        )
    if not np.all(np.isfinite(grey)):
        raise ValueError(f"{name}: expected finite grey values, found others")
    return grey


def prepare(image: Array, degree: Degree, mask: BoolArray | None = None) -> Reference:
    """Spline and slopes of a reference image (h, w).

    Raises ValueError for a mask of another shape.
    """
    if mask is None:
        mask = np.ones(image.shape, dtype=np.bool_)
    if mask.shape != image.shape:
        raise ValueError(f"mask: expected the image's shape {image.shape}, found {mask.shape}")
    spline = spline_of(image, degree)
    slope_x, slope_y = grid_slopes(spline)
    return Reference(image, slope_x, slope_y, np.ascontiguousarray(mask, np.bool_))


@cache
def noise_of_spline(degree: Degree) -> Array:
    """(TABLE + 2,) for white noise of variance 1: variance of the slope at a pixel, then that of
    the value at the places 0 to 1 between two pixels of a line.
    """
    n, reach = 64, degree // 2
    inverse = ndimage.spline_filter1d(np.eye(n), degree, axis=0, mode="grid-wrap")
    middle = n // 2
    slope = AT_PIXEL[degree][1] @ inverse[middle - reach : middle + reach + 1]
    values = []
    for t in np.linspace(0, 1, TABLE + 1):
        weights = np.array(weights5(t) if degree == 5 else weights3(t))
        values.append(float(np.sum((weights @ inverse[middle - reach : middle + reach + 2]) ** 2)))
    return np.array([float(np.sum(slope**2)), *values])


def n_threads(settings: CorrelationSettings) -> int:
    """Threads to use."""
    return settings.threads or len(os.sched_getaffinity(0))


def refine(
    reference: Reference,
    deformed: Spline,
    points: Array,
    todo: IntArray,
    parameters: Array,
    settings: CorrelationSettings,
) -> Array:
    """Correlate pixels points[todo] from parameters (n_point, 12), which are overwritten.

    Returns (n_todo, 5): zncc, sigma of u and v, reason, iterations. Every point is for itself, so
    that the result does not depend on the number of threads.
    """
    n = 6 if settings.order == 1 else N_PARAMETER
    n_light = 3 if settings.light == "plane" else 1
    limits = np.array(
        [
            settings.tolerance,
            settings.max_iterations,
            settings.min_zncc,
            settings.max_sigma,
            settings.min_share,
            settings.glare,
        ]
    )
    noise = noise_of_spline(settings.degree)
    results = np.empty((len(points), N_RESULT))

    def run(part: IntArray) -> None:
        """Correlate some of the points, into `parameters` and `results`."""
        correlate_range(
            reference.image, reference.slope_x, reference.slope_y,
            reference.mask, deformed.coefficients,
            deformed.is_quintic, noise, points, part, settings.radius, n, n_light, limits,
            parameters, results,
        )  # fmt: skip

    threads = n_threads(settings)
    size = max(todo.size // (PARTS_PER_THREAD * threads), LEAST_PART)
    parts = [todo[start : start + size] for start in range(0, todo.size, size)]
    threads = min(threads, len(parts))
    if threads <= 1:
        run(todo)
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(run, parts))
    return np.asarray(results[todo])
