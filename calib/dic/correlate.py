"""Displacements of points between two images by subset correlation, with their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from calib.dic.interpolation import Array, Spline
from calib.dic.parts import reach_parts
from calib.dic.prepared import (
    BoolArray,
    IntArray,
    Reference,
    Task,
    as_image,
    deformed_spline,
    prepare,
    refine,
    report,
)
from calib.dic.progress import Progress
from calib.dic.propagate import propagate, unreached
from calib.dic.reasons import Reason
from calib.dic.seeds import find_seeds, in_region
from calib.dic.settings import CorrelationSettings
from calib.dic.shape import carried
from calib.dic.subset import N_PARAMETER


@dataclass(frozen=True)
class Correlation:
    """Result at n points; NaN where a point is not valid."""

    displacement: Array
    """(n, 2) u, v, px; x to the right, y down"""
    gradient: Array
    """(n, 2, 2) [[du/dx, du/dy], [dv/dx, dv/dy]] of the shape function at the point"""
    zncc: Array
    """(n,) zero-normalised correlation coefficient, also of points that are lost, where known"""
    sigma: Array
    """(n, 2) standard deviation of u and v by the noise of both images, px"""
    interpolation: Array
    """(n, 2) standard deviation of u and v by the bias of the interpolation, px: its size as
    predicted at the displacement's fraction of a pixel"""
    reason: IntArray
    """(n,) codes of Reason, 0 is valid"""
    iterations: IntArray
    """(n,) Gauss-Newton iterations"""
    parameters: Array
    """(n, 6 or 12) of the shape function; a guess for the next image"""

    @property
    def valid(self) -> BoolArray:
        """(n,) points that have a displacement."""
        return np.asarray(self.reason == Reason.VALID)

    @property
    def total(self) -> Array:
        """(n, 2) standard deviation of u and v by noise and interpolation, px."""
        return np.hypot(self.sigma, self.interpolation)


def correlate(
    reference: npt.ArrayLike,
    deformed: npt.ArrayLike,
    points: npt.ArrayLike,
    settings: CorrelationSettings | None = None,
    guess: npt.ArrayLike | None = None,
    mask: npt.ArrayLike | None = None,
) -> Correlation:
    """Find where points (n, 2), x and y in px of the reference image (h, w), are in the deformed.

    Points may lie between pixels; their subset is centred on the nearest one. The deformed image
    may have another size. guess (n, 2) displacements or (n, n_parameter) parameters; points whose
    guess is NaN, or all without one, are reached from their neighbours, the first from seeds.
    mask (h, w): pixels of the reference that count. Same bits for any number of threads.
    Raises ValueError for arrays of wrong shape or with values that are not finite.
    """
    settings = CorrelationSettings() if settings is None else settings
    image, other = as_image(reference, "reference"), as_image(deformed, "deformed")
    region = None if mask is None else np.asarray(mask, dtype=np.bool_)
    ready = prepare(image, settings.degree, region, settings.blur)
    return correlate_prepared(
        ready, other, deformed_spline(other, settings), points, settings, guess
    )


def correlate_prepared(
    reference: Reference,
    deformed_image: Array,
    deformed: Spline,
    points: npt.ArrayLike,
    settings: CorrelationSettings,
    guess: npt.ArrayLike | None = None,
    progress: Progress | None = None,
) -> Correlation:
    """The same with images that are ready, for series of images."""
    places = np.ascontiguousarray(points, dtype=np.float64)
    if places.ndim != 2 or places.shape[1:] != (2,) or len(places) == 0:
        raise ValueError(f"points: expected shape (n, 2) with n > 0, found {places.shape}")
    if not np.all(np.isfinite(places)):
        raise ValueError("points: expected finite positions in px, found others")
    # subsets are centred on pixels, where the reference needs no interpolation
    pixels = np.round(places)
    parameters, known = _start(guess, len(places), settings)
    parameters = carried(parameters, pixels - places)
    results = unreached(len(places))
    task = Task(reference, deformed, pixels, parameters, results, settings, progress)
    results[~in_region(task), 3] = Reason.OUTSIDE_REGION
    report(task)
    if known.any():
        refine(task, np.flatnonzero(known))
    if not known.all() and not (results[:, 3] == Reason.VALID).any():
        find_seeds(task, deformed_image)
    propagate(task)
    reach_parts(task, deformed_image)
    return _correlation(carried(parameters, places - pixels), results, settings)


def _start(
    guess: npt.ArrayLike | None, n: int, settings: CorrelationSettings
) -> tuple[Array, BoolArray]:
    """Parameters (n, 12) to start from, and which of them are known."""
    parameters = np.zeros((n, N_PARAMETER))
    if guess is None:
        return parameters, np.zeros(n, dtype=np.bool_)
    start = np.asarray(guess, dtype=np.float64)
    if start.ndim != 2 or len(start) != n or start.shape[1] not in (2, 6, N_PARAMETER):
        raise ValueError(f"guess: expected shape ({n}, 2, 6 or 12), found {start.shape}")
    known: BoolArray = np.asarray(np.isfinite(start).all(axis=1))
    n_used = min(start.shape[1], 6 if settings.order == 1 else N_PARAMETER)
    parameters[known, :n_used] = start[known, :n_used]
    return parameters, known


def _correlation(parameters: Array, results: Array, settings: CorrelationSettings) -> Correlation:
    reason = results[:, 3].astype(np.int64)
    lost = reason != Reason.VALID
    n = 6 if settings.order == 1 else N_PARAMETER
    kept = np.where(lost[:, None], np.nan, parameters[:, :n])
    return Correlation(
        displacement=kept[:, :2].copy(),
        gradient=kept[:, 2:6].reshape(-1, 2, 2).copy(),
        zncc=results[:, 0].copy(),
        sigma=np.where(lost[:, None], np.nan, results[:, 1:3]),
        interpolation=np.where(lost[:, None], np.nan, results[:, 5:7]),
        reason=reason,
        iterations=results[:, 4].astype(np.int64),
        parameters=kept,
    )
