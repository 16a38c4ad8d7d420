"""Mean over the samples, and what is known of its error from how they differ."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calib.data.qc.placing_errors import Placed, field_slopes, placed
from calib.data.readers.frames import BoolArray
from fe.response import Array

MOST_PATTERNS = 0.5
"""of the number of samples less one"""


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


def mean_force(forces: Array) -> tuple[Array, Array]:
    """Mean (n_step,) and covariance (n_step, n_step) between samples of forces (n, n_step), N."""
    covariance = np.atleast_2d(np.cov(forces, rowvar=False, ddof=1))
    return forces.mean(axis=0), covariance


def mean_field(
    fields: Array, points: Array, travel: Array, min_share: float, noise_std: Array | None
) -> MeanField:
    """Mean of fields (n_sample, n_step, n, 3) [mm] at points (n, 2) and travel (n_step,), both mm.

    NaN where a sample has nothing.

    A point enters when at least `min_share` of the samples have it in all steps. The samples'
    deviations from the mean are freed of errors of place and travel (`placing_errors`). The rest is
    split in principal patterns; the largest are kept until what is left is no more than `noise_std`
    (3,) [mm], the noise of one sample's field, says. Without it half of all patterns are kept.
    Raises ValueError when no point is left.
    """
    n = len(fields)
    complete: BoolArray = np.asarray(np.isfinite(fields).all(axis=(1, 3)))
    count: Array = np.asarray(complete.sum(axis=0), dtype=np.float64)
    kept: BoolArray = np.asarray(count >= max(min_share * n, 1))
    if not kept.any():
        raise ValueError("expected points that enough samples have, found none")
    has = complete[:, kept][:, None, :, None]
    values = np.where(has, fields[:, :, kept], 0.0)
    mean = values.sum(axis=0) / count[kept][:, None]
    off = np.where(has, values - mean, 0.0)
    if n < 3:
        left = np.where(has, off, np.nan)
        return MeanField(kept, mean, count[kept], off[:0], left, _std(off, count[kept]))
    scale = _std(off, count[kept]) if noise_std is None else noise_std
    scale = np.where(scale > 0, scale, 1.0)
    slopes = field_slopes(mean, points[kept], travel)
    errors = placed(off, complete[:, kept], slopes, scale)
    # where samples lack a point, those that have it need not be in the right place on average
    mean = mean - np.einsum("ap,aipc->ipc", _shifts(errors, complete[:, kept]), errors.shapes)
    flat = (errors.rest / scale).reshape(n, -1)
    vectors, values, shapes = np.linalg.svd(flat, full_matrices=False)
    q = _n_patterns(values[: n - 1], flat.shape[1], noise_std is not None)
    scores = vectors[:, :q] * values[:q]
    free = shapes[:q].reshape(q, *mean.shape) * scale
    patterns = _patterns(
        np.concatenate([errors.sizes, scores], axis=1), np.concatenate([errors.shapes, free])
    )
    left = flat - scores @ shapes[:q]
    freedom = (n - 1) / (n - 1 - q)
    residual = left.reshape(off.shape) * scale
    std = _std(residual, count[kept]) * np.sqrt(freedom)
    return MeanField(kept, mean, count[kept], patterns, np.where(has, residual, np.nan), std)


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
    """(q, ...) errors of the mean, one SD each, of samples with `sizes` (n, q) of `shapes`."""
    covariance = np.cov(sizes, rowvar=False, ddof=1).reshape(len(shapes), len(shapes))
    # in units of their own size: shapes may be large where sizes are small
    unit = np.sqrt(np.diag(covariance))
    unit = np.where(unit > 0, unit, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    roots = unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0) / len(sizes))
    patterns: Array = np.einsum("ak,a...->k...", roots, shapes)
    return patterns


def _n_patterns(sizes: Array, n_value: int, noise_known: bool) -> int:
    """Number of patterns to keep of deviations in units of the noise."""
    freedom = sizes.size
    most = int(MOST_PATTERNS * freedom)
    if not noise_known:
        return most
    squares = sizes**2
    for q in range(most):
        if squares[q:].sum() / ((freedom - q) * n_value) <= 1.1:
            return q
    return most
