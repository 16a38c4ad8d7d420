"""Samples one by one, each condensed to a few numbers: its forces and the weights of its field.

What is a sample's own error and what all samples share are kept apart: errors of mesh and emulator,
of the load cell's gain and the like are the same in all samples and do not average away. Given the
constants of every sample all is normal, and the common errors can be integrated out or drawn.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from calib.data.dataset import Dataset, SampleData
from calib.inference.condensed_field import (
    ROUNDING,
    FieldCondenser,
    FieldPart,
    cholesky_of,
    diagonal,
)
from calib.inference.field_floor import FieldFloor
from calib.inference.forward import ForwardModel, Prediction
from calib.inference.gaussian import LOG_2PI
from calib.inference.noise import ForceErrors, NoiseSettings, force_errors
from calib.inference.sample_errors import SampleErrors
from fe.response import Array


class White(NamedTuple):
    """Residuals and common errors in units of the samples' own errors, uncorrelated."""

    residual: Array
    """(m, n, p)"""
    factor: Array
    """(m, n, p, q) one SD of each common error"""


@dataclass(frozen=True)
class CondensedSamples:
    """Data of n samples, p numbers each: forces [N] and weights of the field [mm]."""

    names: tuple[str, ...]
    forward: ForwardModel
    data: Array
    """(n, p)"""
    whitening: Array
    """(n, p, p) W_i with W_i (own covariance) W_i^T = I; rows of zeros for what a sample lacks"""
    errors: ForceErrors
    """errors that all samples' forces share"""
    field: tuple[FieldPart, ...] = ()
    """one a sample; none without fields"""

    @property
    def without_field(self) -> tuple[str, ...]:
        """Samples whose forces count alone beside the fields of others."""
        parts = zip(self.names, self.field, strict=False)  # none without fields
        return tuple(name for name, part in parts if not np.isfinite(part.own).all())

    @property
    def n_step(self) -> int:
        """Number of increments."""
        return self.errors.discretisation.size

    @cached_property
    def n_data(self) -> npt.NDArray[np.int64]:
        """(n,) numbers that each sample has."""
        return np.asarray(
            np.count_nonzero(np.diagonal(self.whitening, axis1=1, axis2=2), axis=1), dtype=np.int64
        )

    @cached_property
    def log_norm(self) -> float:
        """Ln of the constant of all samples' densities."""
        scale = np.diagonal(self.whitening, axis1=1, axis2=2)
        known = scale > 0
        return float(np.log(scale[known]).sum() - 0.5 * known.sum() * LOG_2PI)

    def white(self, theta: Array) -> White:
        """Residuals at theta (m, n, d) of every sample; NaN where the forward model failed."""
        m, n, d = theta.shape
        found = self.forward.predict(np.ascontiguousarray(theta.reshape(m * n, d)))
        force = found.force.reshape(m, n, -1)
        parts = [force]
        if self.field:
            assert found.weights is not None
            parts += [found.weights.reshape(m, n, -1), np.zeros((m, n, self._n_nuisance(found)))]
        residual = self.data - np.concatenate(parts, axis=2)
        factor = self._common(force, found)
        white = np.einsum("nij,mnj->mni", self.whitening, residual)
        return White(white, np.matmul(self.whitening, factor))

    def forces(self, theta: Array, z: Array) -> tuple[Array, Array]:
        """(m, n_step) forces at theta (m, d), N, and what common errors z (m, q) add to them."""
        m, n, s = len(theta), len(self.names), self.n_step
        force, moved = np.empty((m, s)), np.empty((m, s))
        # The common errors are laid out for all samples: of a new one those of the first.
        for rows in np.array_split(np.arange(m), max(1, m * n // 4096)):
            found = self.forward.predict(np.repeat(theta[rows], n, axis=0))
            every = found.force.reshape(len(rows), n, s)
            factor = self._common(every, found)[:, 0, :s]
            force[rows] = every[:, 0]
            moved[rows] = np.einsum("msq,mq->ms", factor, z[rows])
        return force, moved

    def _common(self, force: Array, found: Prediction) -> Array:
        """(m, n, p, q) what one SD of each common error changes in each sample's numbers."""
        m, n, s = force.shape
        blocks = [self._of_force(force, found)]
        if self.field and found.weights is not None:
            weights = found.weights.reshape(m, n, -1)
            blocks.append(self._of_field(found, m))
        p, shared = self.data.shape[1], len(self.errors.shared)
        total = np.zeros((m, n, p, sum(block.shape[3] for block in blocks) + shared))
        total[:, :, :s, : blocks[0].shape[3]] = blocks[0]
        if len(blocks) > 1:
            total[:, :, s:, blocks[0].shape[3] : total.shape[3] - shared] = blocks[1]
        for index, error in enumerate(self.errors.shared):
            column = total.shape[3] - shared + index
            total[:, :, :s, column] = force @ error.force.T
            if len(blocks) > 1:
                offset = np.array([part.by_offset[index] for part in self.field])
                by_weight = np.array([part.by_weight[index] for part in self.field])
                total[:, :, s:, column] = offset + np.einsum("mnk,nkj->mnj", weights, by_weight)
        return total

    def _of_force(self, force: Array, found: Prediction) -> Array:
        """(m, n, n_step, n_step or 0) factor of the errors of mesh and emulator, N."""
        m, n, s = force.shape
        error = np.sqrt(0.5) * self.errors.discretisation * force
        if found.force_covariance is None and not self.errors.discretisation.any():
            return np.zeros((m, n, s, 0))
        total = error[..., :, None] * error[..., None, :] + diagonal(error**2)
        if found.force_covariance is not None:
            total += found.force_covariance.reshape(m, n, s, s)
        # rounding of an emulator's nearly singular covariance
        return cholesky_of(total, ROUNDING * force**2)

    def _n_nuisance(self, found: Prediction) -> int:
        """Number of weights of the fields that are not of modes."""
        assert found.weights is not None
        return int(self.field[0].weights.size - found.weights.shape[1])

    @cached_property
    def _see_the_same(self) -> bool:
        """Whether the model's errors are the same in all fields, as where all are whole."""
        seen = [part.common for part in self.field if np.isfinite(part.own).all()]
        return all(np.array_equal(each, seen[0]) for each in seen)

    def _of_field(self, found: Prediction, m: int) -> Array:
        """(m, n, k, q) factor of the errors of mesh and emulator, mm.

        Where all samples are complete all roots of their covariance have the same meaning, and the
        least is taken.
        """
        common = np.array([part.common for part in self.field])
        variance = np.zeros((m, *common.shape[:2]))
        if found.weight_variance is not None:
            modes = found.weight_variance.shape[1]
            variance[:, :, :modes] = found.weight_variance.reshape(m, len(common), modes)
        if not self._see_the_same:
            every = np.broadcast_to(common, (m, *common.shape))
            return np.concatenate([every, diagonal(np.sqrt(variance))], axis=3)
        total = common @ common.transpose(0, 2, 1) + diagonal(variance)
        scale = np.abs(total).max(axis=(2, 3))[..., None] + np.finfo(np.float64).tiny
        return cholesky_of(total, np.broadcast_to(ROUNDING * scale, total.shape[:3]))


def condense(
    dataset: Dataset,
    forward: ForwardModel,
    noise: NoiseSettings,
    own: SampleErrors,
    *,
    force_discretisation: Array | float = 0.0,
    field_floor: FieldFloor | float = 0.0,
    field_patterns: Array | None = None,
) -> CondensedSamples:
    """Condense the samples of a dataset; arguments as of `likelihood.build_likelihood`.

    The field is used where dataset and forward model have one.
    Raises ValueError without samples or with fewer than two, for forces that are not finite, and
    without noise of the load cell.
    """
    samples = checked_samples(dataset)
    if not noise.load_cell_sd > 0.0:
        raise ValueError(
            "load_cell_sd: expected above 0 N where samples are told one by one, found "
            f"{noise.load_cell_sd}"
        )
    nothing = np.zeros((dataset.travel.size, dataset.travel.size))
    errors = force_errors(dataset, noise, force_discretisation, mean=nothing)
    fields: list[FieldPart] = []
    if dataset.field is not None and forward.field_basis is not None:
        condenser = FieldCondenser(
            dataset, dataset.field, samples, forward.field_basis, noise, own, errors
        )
        fields = condenser.parts(field_floor, field_patterns)
    data, whitening = [], []
    for index, force in enumerate(samples.force):
        part = fields[index] if fields else None
        data.append(force if part is None else np.concatenate([force, part.weights]))
        whitening.append(_whitening(dataset, force, noise, own, part, errors.slope))
    return CondensedSamples(
        samples.names, forward, np.array(data), np.array(whitening), errors, tuple(fields)
    )


def checked_samples(dataset: Dataset) -> SampleData:
    """The samples one by one; raises ValueError where there are fewer than two or NaN forces."""
    samples = dataset.samples
    if samples is None:
        raise ValueError("samples: found none one by one, expected two or more")
    if len(samples.names) < 2:
        raise ValueError(
            "samples: found one, expected two or more: of the scatter between samples one says "
            "nothing"
        )
    if not np.isfinite(samples.force).all():
        raise ValueError("samples: expected finite forces, found NaN or infinity")
    return samples


def _whitening(
    dataset: Dataset,
    force: Array,
    noise: NoiseSettings,
    own: SampleErrors,
    part: FieldPart | None,
    slope: Array,
) -> Array:
    """Inverse factor of the covariance of one sample's own errors; zeros for a missing field."""
    s = force.size
    k = 0 if part is None else part.weights.size
    # the mean curve of the sample's own size: less noisy than its own
    smooth = dataset.force_mean * (force.sum() / dataset.force_mean.sum())
    shift = np.zeros(s + k)
    shift[:s] = own.travel_zero_sd * (slope @ smooth)
    total = np.zeros((s + k, s + k))
    total[:s, :s] = noise.load_cell_sd**2 * np.eye(s)
    known = s
    if part is not None and np.isfinite(part.own).all():
        total[s:, s:], shift[s:], known = part.own, part.by_travel, s + k
    total += np.outer(shift, shift)
    inverse = np.zeros((s + k, s + k))
    lower = np.linalg.cholesky(total[:known, :known])
    inverse[:known, :known] = np.linalg.inv(lower)
    return inverse
