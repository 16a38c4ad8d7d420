"""Mean over the samples, and what is known of its error from how they differ."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calib.data.qc.noise_floor import LEAST_POINTS, pooled_noise
from calib.data.qc.placing_errors import Placed, field_slopes, placed
from calib.data.readers.frames import BoolArray
from fe.response import Array

MOST_PATTERNS = 0.5
"""of the number of samples less one"""
SURELY = 3.0
"""SDs by which two slopes differ surely"""
BEYOND_NOISE = 1.15
"""times the largest square that noise makes, for what that scatters by and is known to"""
ROUNDING = 1e-9
"""of a number of samples: 0.56 of 25 is 14"""


class Placing(NamedTuple):
    """What is known of the samples' errors of place and travel before their mean is taken."""

    slopes: Array
    """(3, n_step, n, 3) of the samples' fields in x, y and travel, mm/mm; NaN where not known"""
    slope_sd: Array
    """of these, by how the samples' own scatter, mm/mm"""
    moved: Array
    """(n_sample, 3) errors of x, y and travel that the fields have been freed of, mm"""


class MeanField(NamedTuple):
    """Mean field of the samples at the points that enough of them have."""

    kept: BoolArray
    """(n,) points that are in it"""
    displacement: Array
    """(n_step, n_kept, 3) mean, mm"""
    n_samples: Array
    """(n_kept,) number of samples with the point in all steps"""
    patterns: Array
    """(q, n_step, n_kept, 3) errors of the mean of known shape, one SD each, mm: of place and
    travel, and the directions in which samples differ beyond them by more than noise"""
    residual: Array
    """(n_sample, n_step, n_kept, 3) what is left of the samples' deviations, mm; NaN where a sample
    has no such point"""
    residual_std: Array
    """(3,) its SD, mm"""
    place_errors: Array
    """(n_sample, 3) what was taken off each sample for errors of its x, y and travel, mm"""


def mean_force(forces: Array) -> tuple[Array, Array]:
    """Mean (n_step,) and covariance (n_step, n_step) between samples of forces (n, n_step), N."""
    covariance = np.atleast_2d(np.cov(forces, rowvar=False, ddof=1))
    return forces.mean(axis=0), covariance


def mean_field(
    fields: Array,
    points: Array,
    travel: Array,
    min_share: float,
    noise_std: Array | None,
    placing: Placing | None = None,
) -> MeanField:
    """Mean of fields (n_sample, n_step, n, 3) [mm] at points (n, 2) and travel (n_step,), both mm.

    NaN where a sample has nothing. `noise_std` (3,) [mm] is about the noise of one sample's field;
    components are weighed by it.

    A point enters when at least `min_share` of the samples have it in all steps. The samples'
    deviations from the mean are freed of errors of place and travel (`placing_errors`); those that
    were taken off before, and better slopes, come with `placing`. The rest is split in principal
    patterns, of which those are kept that noise would not show (`_n_patterns`).
    Raises ValueError when no point is left.
    """
    n = len(fields)
    complete: BoolArray = np.asarray(np.isfinite(fields).all(axis=(1, 3)))
    count: Array = np.asarray(complete.sum(axis=0), dtype=np.float64)
    kept: BoolArray = np.asarray(count >= max(min_share * n - ROUNDING, 1))
    if not kept.any():
        raise ValueError("expected points that enough samples have, found none")
    has = complete[:, kept][:, None, :, None]
    values = np.where(has, fields[:, :, kept], 0.0)
    mean = values.sum(axis=0) / count[kept][:, None]
    off = np.where(has, values - mean, 0.0)
    if n < 3:
        left, std = np.where(has, off, np.nan), _std(off, count[kept])
        return MeanField(kept, mean, count[kept], off[:0], left, std, np.zeros((n, 3)))
    scale = _std(off, count[kept]) if noise_std is None else noise_std
    scale = np.where(scale > 0, scale, 1.0)
    slopes = field_slopes(mean, points[kept], travel)
    if placing is not None:
        slopes = _sharper(slopes, placing.slopes[:, :, kept], placing.slope_sd[:, :, kept])
    errors = placed(off, complete[:, kept], slopes, scale)
    # where samples lack a point, those that have it need not be in the right place on average
    mean = mean - np.einsum("ap,aipc->ipc", _shifts(errors, complete[:, kept]), errors.shapes)
    flat = (errors.rest / scale).reshape(n, -1)
    vectors, values, shapes = np.linalg.svd(flat, full_matrices=False)
    residual = np.where(has, errors.rest, np.nan)
    q = _n_patterns(values[: n - 1], _independent(residual, points[kept]))
    scores = vectors[:, :q] * values[:q]
    free = shapes[:q].reshape(q, *mean.shape) * scale
    sizes = errors.sizes if placing is None else errors.sizes + placing.moved
    patterns = _patterns(
        np.concatenate([sizes, scores], axis=1), np.concatenate([errors.shapes, free])
    )
    left = np.where(has, (flat - scores @ shapes[:q]).reshape(off.shape) * scale, np.nan)
    std = _std(np.nan_to_num(left), count[kept]) * np.sqrt((n - 1) / (n - 1 - q))
    return MeanField(kept, mean, count[kept], patterns, left, std, errors.sizes)


def _sharper(smooth: Array, sharp: Array, sd: Array) -> Array:
    """Slopes: the smooth ones, but for places where the sharp ones surely differ.

    Sharp ones everywhere would bring their noise, times the common error of place, to all points.
    """
    with np.errstate(invalid="ignore"):
        surely = np.abs(sharp - smooth) > SURELY * sd
    return np.where(surely, sharp, smooth)


def _std(off: Array, count: Array) -> Array:
    """(3,) SD of deviations (n_sample, n_step, n, 3) from the mean of `count` (n,) samples."""
    pairs = off.shape[1] * np.maximum(count - 1, 0).sum()
    squares = (off**2).sum(axis=(0, 1, 2))
    return np.asarray(np.sqrt(squares / max(pairs, 1)), dtype=np.float64)


def _shifts(errors: Placed, complete: BoolArray) -> Array:
    """(q, n) mean errors of place and travel of the samples that have each point, mm."""
    sizes = errors.sizes - errors.sizes.mean(axis=0)
    shifts: Array = sizes.T @ complete / complete.sum(axis=0)
    return shifts


def _patterns(sizes: Array, shapes: Array) -> Array:
    """(q, ...) errors of the mean, one SD each, of samples with `sizes` (n, q) of `shapes`.

    Of few samples their covariance is uncertain itself: widened as that of the forces is
    (`calib.inference.noise.mean_covariance`).
    """
    n, q = sizes.shape
    covariance = np.cov(sizes, rowvar=False, ddof=1).reshape(q, q)
    covariance = covariance * ((n - 1) / max(n - q - 2, 1))
    # in units of their own size: shapes may be large where sizes are small
    unit = np.sqrt(np.diag(covariance))
    unit = np.where(unit > 0, unit, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    roots = unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0) / len(sizes))
    patterns: Array = np.einsum("ak,a...->k...", roots, shapes)
    return patterns[np.any(patterns != 0, axis=(1, 2, 3))]


def _n_patterns(sizes: Array, n_independent: float) -> int:
    """How many of the deviations' principal patterns, of these singular values, noise cannot make.

    Of m samples' noise at N independent places the largest square is about (1 + sqrt(m / N))^2
    times their mean (Marchenko and Pastur, Math. USSR Sb. 1, 1967).
    """
    squares = sizes**2
    most = int(MOST_PATTERNS * squares.size)
    for q in range(most):
        edge = (1 + np.sqrt((squares.size - q) / n_independent)) ** 2
        if squares[q] <= BEYOND_NOISE * edge * squares[q:].mean():
            return q
    return most


def _independent(residual: Array, points: Array) -> float:
    """Number of independent values in the noise of one sample's deviations (n_sample, ...)."""
    try:
        noise = pooled_noise(with_enough(residual), points, roughly=True)
    except ValueError:  # too little to tell how they are correlated
        return float(residual[0].size)
    return noise.effective_number(points, residual.shape[1])


def with_enough(residual: Array) -> list[Array]:
    """The samples' deviations (n_step, n, 3), of those that show how noise is correlated."""
    known = np.isfinite(residual).all(axis=(1, 3)).sum(axis=1)
    is_enough = (known >= LEAST_POINTS) & (residual.shape[1] >= 2)
    return [one for one, enough in zip(residual, is_enough, strict=True) if enough]
