"""Images made ready once for many correlations, and the compiled loop spread over threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from calib.dic.blur import blurred, growth
from calib.dic.gauss_newton import correlate_range
from calib.dic.interpolation import Array, Degree, Spline, grid_slopes, spline_of
from calib.dic.interpolation_bias import error_images
from calib.dic.noise_response import noise_of_spline
from calib.dic.progress import Progress
from calib.dic.reasons import Reason
from calib.dic.settings import CorrelationSettings
from calib.dic.subset import N_PARAMETER
from fe.executors import usable_cores

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]
N_RESULT = 7
PARTS_PER_THREAD = 8
"""so that threads end together, though points differ in their iterations"""
LEAST_PART, MOST_PART = 8, 1024
"""points: few enough for a word of how far it has come, each second or so"""


class Reference(NamedTuple):
    """The image that the subsets are cut from."""

    image: Array
    """(h, w) grey levels"""
    slope_x: Array
    slope_y: Array
    mask: BoolArray
    """(h, w) False where a pixel does not count"""
    error_x: Array
    """(h, w) what interpolation a quarter px off adds: see `interpolation_bias`"""
    error_y: Array
    growth: Array
    """(3,) what a blur makes of the noise: see `blur.growth`"""


class Task(NamedTuple):
    """One correlation under way: points and what is known of each, which is changed in place."""

    reference: Reference
    deformed: Spline
    points: Array
    """(n, 2) whole px"""
    parameters: Array
    """(n, 12) of the shape functions: the start, then what was found"""
    results: Array
    """(n, 7) zncc, sigma of u and v, reason, iterations, interpolation's deviation of u and v"""
    settings: CorrelationSettings
    progress: Progress | None = None


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


def prepare(
    image: Array, degree: Degree, mask: BoolArray | None = None, blur: float = 0.0
) -> Reference:
    """Spline and slopes of a reference image (h, w), blurred by a Gaussian of SD `blur` px.

    Raises ValueError for a mask of another shape.
    """
    if mask is None:
        mask = np.ones(image.shape, dtype=np.bool_)
    if mask.shape != image.shape:
        raise ValueError(f"mask: expected the image's shape {image.shape}, found {mask.shape}")
    image = blurred(image, blur)
    slope_x, slope_y = grid_slopes(spline_of(image, degree))
    of_blur = growth(slope_x * mask, slope_y * mask, blur)
    valued = np.ascontiguousarray(mask, np.bool_)
    return Reference(image, slope_x, slope_y, valued, *error_images(image, degree), of_blur)


def deformed_spline(image: Array, settings: CorrelationSettings) -> Spline:
    """The image (h, w) in which the points are looked for, as the settings ask for it."""
    return spline_of(blurred(image, settings.blur), settings.degree)


def n_threads(settings: CorrelationSettings) -> int:
    """Threads to use."""
    return settings.threads or usable_cores()


def refine(task: Task, todo: IntArray) -> None:
    """Correlate points[todo] from their parameters, into these and the results.

    Every point is for itself, so that the result does not depend on the number of threads.
    """
    settings = task.settings
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
    noise = noise_of_spline(settings.degree, settings.blur)

    def run(part: IntArray) -> None:
        """Correlate some of the points."""
        correlate_range(
            task.reference, task.deformed.coefficients, task.deformed.is_quintic, noise,
            task.points, part, settings.radius, n, n_light, limits, task.parameters, task.results,
        )  # fmt: skip

    threads = n_threads(settings)
    size = max(todo.size // (PARTS_PER_THREAD * threads), LEAST_PART)
    size = min(size, MOST_PART)
    parts = [todo[start : start + size] for start in range(0, todo.size, size)]
    threads = min(threads, len(parts))
    if threads <= 1:
        for part in parts:
            run(part)
            report(task)
    else:
        with ThreadPoolExecutor(threads) as pool:
            for _ in pool.map(run, parts):
                report(task)


def report(task: Task) -> None:
    """Tell how many points have been looked at."""
    if task.progress is not None:
        reached = int(np.count_nonzero(task.results[:, 3] != Reason.NOT_REACHED))
        task.progress(reached, len(task.results))
