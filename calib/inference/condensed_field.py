"""The field of one sample, condensed to what it says of the weights of the emulator's modes.

u_i = offset + M^T w(x_i) + errors tells of the sample's constants x_i through the k weights w of
the modes M alone. Its generalised least squares estimate of them,

    w_i = H_i (u_i - offset),   H_i = (M S^-1 M^T)^-1 M S^-1,   H_i M^T = I,

has the errors H_i (own + common), whose covariances follow exactly. To the modes come directions
in which nuisances of the test move the field, the zero of the travel first: what a sample's field
says of its own zero is known of its force too. The model predicts zero along these. S is the
covariance of the mean field (noise, place, model), so that the mean of the w_i holds what the
likelihood of the averaged sample takes from the field (modes that the data do not see have the
weight zero). A sample that lacks points has an H_i of the points that it has.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag, eigh

from calib.data.dataset import Dataset, FieldData, SampleData
from calib.inference.field_floor import FieldFloor
from calib.inference.field_noise import FieldCovariance, field_covariance
from calib.inference.forward import FieldBasis
from calib.inference.noise import ForceErrors, NoiseSettings
from calib.inference.sample_errors import SampleErrors, own_field_patterns
from fe.response import Array

ROUNDING = 1e-10
"""of a covariance, relative to its largest entry"""

SEEN = 1e-6
"""of directions of length 1: what changes a sample's field by less is not seen at its points"""
SAME = 1e-3
"""share of a direction by which it must differ from others to be one more"""
COUNTS = 1e-2
"""variance, as a share of the samples' own, from which on what incomplete samples see otherwise of
common errors is told from errors of their own"""
MOST = 2
"""times as many columns as there are directions may do so: the work goes with their square"""


class FieldPart(NamedTuple):
    """What one sample's field says of k weights: of k' modes, then of nuisances."""

    weights: Array
    """(k,) w_i"""
    own: Array
    """(k, k) covariance of its own errors; infinite where the sample has no field"""
    by_travel: Array
    """(k,) change of w_i by one SD of the sample's own zero of the travel"""
    common: Array
    """(k, q) factor of the model's errors, which are the same in all samples; q = k where all are
    complete"""
    by_offset: Array
    """(s, k) change of w_i by one SD of each nuisance that all samples share, of the offset"""
    by_weight: Array
    """(s, k', k) the same of the fields of the modes' unit weights"""


@dataclass(frozen=True)
class FieldCondenser:
    """Condenses the fields of all samples."""

    dataset: Dataset
    field: FieldData
    samples: SampleData
    basis: FieldBasis
    noise: NoiseSettings
    own: SampleErrors
    errors: ForceErrors

    @cached_property
    def modes(self) -> Array:
        """(k', n_step, n_point, 3) of the model; raises ValueError where it has none."""
        if self.basis.modes is None:
            raise ValueError("forward: expected one with modes of its field, as an emulator has")
        return self.basis.modes

    @cached_property
    def directions(self) -> Array:
        """(k, n_step, n_point, 3) modes, then what nuisances of the test do to the mean field, mm.

        The mean field as its modes have it: the derivative of noise over increments is more noise.
        What modes, or nuisances before, can do as well is left out.
        """
        off = (self.field.displacement - self.basis.offset).ravel()
        flat = self.modes.reshape(len(self.modes), -1)
        best = np.asarray(np.linalg.lstsq(flat.T, off, rcond=None)[0], dtype=np.float64)
        smooth = self.basis.fields(best[None])[0]
        by_errors = [error.field for error in self.errors.shared[1:] if error.field.any()]
        found = flat
        for matrix in (self.errors.slope, *by_errors):
            moved = np.tensordot(matrix, smooth, 1).ravel()
            left = moved - np.linalg.lstsq(found.T, moved, rcond=None)[0] @ found
            if left @ left > SAME**2 * (moved @ moved):
                found = np.vstack([found, moved])
        return found.reshape(-1, *self.basis.offset.shape)

    def parts(self, floor: FieldFloor | float, patterns: Array | None) -> list[FieldPart]:
        """The condensed fields; the model's errors by `floor` and `patterns`, see `condense`."""
        n = self.dataset.n_samples
        # The patterns of the data set are these samples' own deviations: a least squares estimate
        # that holds them for noise would not see any sample differ from the others.
        covariance = field_covariance(
            replace(self.field, patterns=None),
            floor=floor,
            patterns=patterns,
            freedom=self.noise.field_freedom,
        ).with_patterns(self.basis.truncation)
        own = own_field_patterns(self.dataset, self.field, self.samples, self.noise)
        noise = replace(
            covariance,
            noise_variance=covariance.noise_variance * n,
            floor=np.zeros_like(covariance.floor),
            patterns=own,
        )
        common = replace(covariance, noise_variance=np.zeros(3))
        covariance = covariance.with_patterns(own / np.sqrt(n))
        whole = np.ones(len(self.field.points), dtype=np.bool_)
        reference = self._estimator(covariance, whole)
        estimators = {whole.tobytes(): reference}
        seen = [np.isfinite(sample).all(axis=(0, 2)) for sample in self.samples.displacement]
        found: dict[int, FieldPart] = {}
        for index, (displacement, has) in enumerate(
            zip(self.samples.displacement, seen, strict=True)
        ):
            if not self._are_told_apart(has):
                continue
            if has.tobytes() not in estimators:
                estimators[has.tobytes()] = self._estimator(covariance, has)
            found[index] = self._part(displacement, estimators[has.tobytes()], noise)
        parts = list(found.values())
        by_part = [estimators[seen[index].tobytes()] for index in found]
        found = dict(zip(found, _with_common(parts, by_part, reference, common), strict=True))
        columns = max((part.common.shape[1] for part in found.values()), default=len(reference))
        return [found.get(index) or self._nothing(columns) for index in range(len(seen))]

    def _are_told_apart(self, has: npt.NDArray[np.bool_]) -> bool:
        """Whether the directions differ at the points that a sample has."""
        flat = self.directions.reshape(len(self.directions), -1)
        seen = self.directions[:, :, has].reshape(len(flat), -1)
        if seen.shape[1] < len(flat):
            return False
        sizes = np.linalg.svd(seen / np.linalg.norm(flat, axis=1)[:, None], compute_uv=False)
        return bool(sizes[-1] > SEEN)

    def _estimator(self, covariance: FieldCovariance, has: npt.NDArray[np.bool_]) -> Array:
        """(k, n_step, n_point, 3) H, with zeros at points that are missing."""
        seen = self.directions[:, :, has]
        solved = (covariance if has.all() else _at_points(covariance, has)).solve(seen)
        estimator = np.zeros_like(self.directions)
        gram = _products(seen, solved)
        estimator[:, :, has] = np.tensordot(np.linalg.pinv(gram, hermitian=True), solved, 1)
        return estimator

    def _part(self, displacement: Array, estimator: Array, noise: FieldCovariance) -> FieldPart:
        measured = np.nan_to_num(displacement) - self.basis.offset
        weights = _products(estimator, measured[None])[:, 0]
        smooth = self.basis.fields(weights[None, : len(self.modes)])[0]
        moved = np.tensordot(self.own.travel_zero_sd * self.errors.slope, smooth, 1)
        shared = self.errors.shared
        offsets = np.array([np.tensordot(error.field, self.basis.offset, 1) for error in shared])
        by_weight = [np.einsum("ij,kjpc->kipc", error.field, self.modes) for error in shared]
        return FieldPart(
            weights=weights,
            own=_symmetric(_products(estimator, noise.applied(estimator))),
            by_travel=_products(estimator, moved[None])[:, 0],
            common=np.zeros((len(weights), len(weights))),
            by_offset=_products(offsets, estimator),
            by_weight=np.array([_products(fields, estimator) for fields in by_weight]),
        )

    def _nothing(self, columns: int) -> FieldPart:
        """Of a sample without a field."""
        k, s = len(self.directions), len(self.errors.shared)
        none = np.zeros((k, k))
        by_weight = np.zeros((s, len(self.modes), k))
        unknown = np.full((k, k), np.inf)
        common = np.zeros((k, columns))
        return FieldPart(none[0], unknown, none[0], common, np.zeros((s, k)), by_weight)


def _with_common(
    parts: list[FieldPart], estimators: list[Array], reference: Array, common: FieldCovariance
) -> list[FieldPart]:
    """With the model's errors, which all samples share, as each sees them.

    Complete samples see k of them.  What others see otherwise has columns of its own, as many as
    count beside what is a sample's own; the rest is counted as that.
    """
    applied = common.applied(reference)
    factor = cholesky_of(*_with_rounding(_products(reference, applied)))
    others = {id(each): each for each in estimators if each is not reference}
    if not others:
        return [part._replace(common=factor) for part in parts]
    distinct = list(others.values())
    seen = [np.linalg.solve(factor, _products(applied, each)).T for each in distinct]
    both = np.concatenate(distinct)
    left = _products(both, common.applied(both))
    left -= np.concatenate(seen) @ np.concatenate(seen).T
    users = [[i for i, each in enumerate(estimators) if each is one] for one in distinct]
    own = [parts[which[0]].own / len(which) for which in users]
    columns, rest = _leading(_symmetric(left), own)
    none = np.zeros((len(factor), columns.shape[1]))
    found = [part._replace(common=np.hstack([factor, none])) for part in parts]
    k = len(factor)
    for which, sees, first in zip(users, seen, range(0, len(both), k), strict=True):
        rows = slice(first, first + k)
        for i in which:
            found[i] = parts[i]._replace(
                common=np.hstack([sees, columns[rows]]), own=parts[i].own + rest[rows, rows]
            )
    return found


def _leading(left: Array, own: list[Array]) -> tuple[Array, Array]:
    """(nk, q) columns of a covariance (nk, nk) that count beside n own ones (k, k), and the rest.

    Own ones are of the mean of the samples that share an estimator.
    """
    lower = block_diag(*[cholesky_of(*_with_rounding(each)) for each in own])
    white = np.linalg.solve(lower, np.linalg.solve(lower, left).T)
    values, vectors = np.linalg.eigh(_symmetric(white))
    counts = (values > COUNTS) & (np.arange(len(values))[::-1] < MOST * len(own[0]))
    columns = lower @ (vectors[:, counts] * np.sqrt(values[counts]))
    small = lower @ (vectors[:, ~counts] * np.sqrt(np.maximum(values[~counts], 0.0)))
    return columns, small @ small.T


def _at_points(covariance: FieldCovariance, has: npt.NDArray[np.bool_]) -> FieldCovariance:
    """The covariance at some of the points."""
    both = covariance.vectors.T @ covariance.correlation[:, has]
    smooth = both.T @ (covariance.floor_values[:, None] * both)
    correlation = covariance.correlation[np.ix_(has, has)]
    values, vectors = eigh(smooth, correlation)
    return replace(
        covariance,
        vectors=vectors,
        floor_values=np.maximum(values, 0.0),
        correlation=correlation,
        patterns=covariance.patterns[:, :, has],
    )


def _products(left: Array, right: Array) -> Array:
    """(a, b) products of fields (a, n_step, n_point, 3) and (b, ...)."""
    size = int(np.prod(right.shape[1:]))
    product: Array = left.reshape(-1, size) @ right.reshape(-1, size).T
    return product


def _symmetric(matrix: Array) -> Array:
    return 0.5 * (matrix + matrix.T)


def _with_rounding(matrix: Array) -> tuple[Array, Array]:
    scale = max(float(np.abs(matrix).max(initial=0.0)), np.finfo(np.float64).tiny)
    return _symmetric(matrix), np.full(len(matrix), ROUNDING * scale)


def diagonal(values: Array) -> Array:
    """(..., n, n) diagonal matrices of values (..., n)."""
    matrix: Array = values[..., :, None] * np.eye(values.shape[-1])
    return matrix


def cholesky_of(covariance: Array, jitter: Array) -> Array:
    """Lower factors (..., n, n) of covariances and (..., n) jitter; NaN where one is not finite."""
    total = covariance + diagonal(jitter)
    bad = ~np.isfinite(total).all(axis=(-2, -1))
    total[bad] = np.eye(total.shape[-1])
    factor = np.asarray(np.linalg.cholesky(total), dtype=np.float64)
    factor[bad] = np.nan
    return factor
