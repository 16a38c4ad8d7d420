"""Log-likelihood of a measured displacement field under a forward model's field prediction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.inference.field_noise import FieldCovariance
from calib.inference.forward import FieldBasis, Prediction
from calib.inference.gaussian import LOG_2PI, quadratic_and_logdet
from fe.response import Array


@dataclass(frozen=True)
class ProjectedField:
    """The field's misfit as a function of the k weights: exact, and independent of n_point.

    With Sigma the error covariance, M the modes and d the measured field minus the offset:
    precision G = M Sigma^-1 M^T, best weights w0 = G^-1 M Sigma^-1 d, misfit of these
    c = d^T Sigma^-1 d - w0^T G w0.
    """

    precision: Array
    """(k, k)"""
    best: Array
    """(k,)"""
    constant: float
    """-0.5 (c + ln |Sigma| + n ln 2 pi)"""

    def log_prob(self, weights: Array, variance: Array | None) -> Array:
        """(m,) log-likelihood, weights ~ N(weights, diag variance) integrated out exactly.

        N(d; M^T w, Sigma + M^T V M) by Woodbury in the form I + V^1/2 G V^1/2, which stays
        positive definite for V = 0 and for modes the data do not see.
        """
        off = self.best - weights
        pulled = off @ self.precision
        misfit = np.einsum("mk,mk->m", off, pulled)
        if variance is not None:
            root = np.sqrt(variance).T
            matrix = root[:, None] * self.precision[:, :, None] * root[None, :]
            diagonal = np.arange(self.best.size)
            matrix[diagonal, diagonal] += 1.0
            gained, logdet = quadratic_and_logdet(matrix, root * pulled.T)
            misfit = misfit - gained + logdet
        value = self.constant - 0.5 * misfit
        finite: Array = np.where(np.isfinite(value), value, -np.inf)
        return finite


def project(observed: Array, covariance: FieldCovariance, basis: FieldBasis) -> ProjectedField:
    """Reduce a field (n_step, n_point, 3) to the modes of `basis`, which must not be identity."""
    if basis.modes is None:
        raise ValueError("basis: an identity basis has no modes to project on")
    total = covariance.with_patterns(basis.truncation)
    difference = (observed - basis.offset)[None]
    stacked = np.concatenate([basis.modes, difference])
    products = total.inner(stacked, stacked)
    precision, pull = products[:-1, :-1], products[:-1, -1]
    best = np.asarray(np.linalg.lstsq(precision, pull, rcond=None)[0], dtype=np.float64)
    misfit = products[-1, -1] - best @ precision @ best
    constant = -0.5 * (misfit + total.logdet + observed.size * LOG_2PI)
    return ProjectedField(0.5 * (precision + precision.T), best, float(constant))


@dataclass(frozen=True)
class FieldLikelihood:
    """Gaussian likelihood of one measured field under models with a given basis."""

    observed: Array
    """(n_step, n_point, 3) measured displacement, mm"""
    covariance: FieldCovariance
    """errors of measurement and mesh, without the emulator's"""
    basis: FieldBasis

    def __post_init__(self) -> None:
        expected = self.covariance.shape
        for name, shape in (("observed", self.observed.shape), ("basis", self.basis.offset.shape)):
            if shape != expected:
                raise ValueError(f"{name}: expected field of shape {expected}, found {shape}")

    @cached_property
    def projected(self) -> ProjectedField:
        """The projected problem (for a basis with modes)."""
        return project(self.observed, self.covariance, self.basis)

    @cached_property
    def _left_out(self) -> tuple[FieldLikelihood, ...]:
        """The same likelihood without each increment in turn."""
        return tuple(self._without_step(i) for i in range(self.observed.shape[0]))

    def _without_step(self, index: int) -> FieldLikelihood:
        modes = self.basis.modes
        basis = FieldBasis(
            np.delete(self.basis.offset, index, axis=0),
            None if modes is None else np.delete(modes, index, axis=1),
            np.delete(self.basis.truncation, index, axis=1),
        )
        observed = np.delete(self.observed, index, axis=0)
        return FieldLikelihood(observed, self.covariance.without_step(index), basis)

    def with_basis(self, basis: FieldBasis) -> FieldLikelihood:
        """The same data and errors for a model with another basis."""
        return replace(self, basis=basis)

    def log_prob(self, prediction: Prediction) -> Array:
        """(m,) log-likelihood of the field; -inf where the prediction failed."""
        weights = prediction.weights
        if weights is None:
            raise ValueError("prediction: holds no field although field data are to be compared")
        if self.basis.modes is not None:
            return self.projected.log_prob(weights, prediction.weight_variance)
        return self._full(weights, prediction.field_factor)

    def _full(self, weights: Array, factor: Array | None) -> Array:
        """Whole fields, no basis: for the few evaluations of a direct model."""
        truncated = self.covariance.with_patterns(self.basis.truncation)
        value = np.full(len(weights), -np.inf)
        for index, field in enumerate(self.basis.fields(weights)):
            if np.all(np.isfinite(field)):
                covariance = truncated if factor is None else truncated.with_patterns(factor[index])
                residual = (self.observed - field)[None]
                misfit = covariance.inner(residual, residual)[0, 0]
                value[index] = -0.5 * (misfit + covariance.logdet + field.size * LOG_2PI)
        return value

    def pointwise(self, prediction: Prediction) -> Array:
        """(m, n_step) log density of each increment's field given the other increments' fields.

        log p(y) - log p(y without i): the second is the same likelihood with the increment's
        rows left out, since marginals of a normal are obtained by leaving out.
        """
        total = self.log_prob(prediction)
        weights = prediction.weights
        columns = []
        for index, rest in enumerate(self._left_out):
            kept = weights
            if self.basis.modes is None and weights is not None:
                fields = weights.reshape(-1, *self.observed.shape)
                kept = np.delete(fields, index, axis=1).reshape(len(weights), -1)
            factor = prediction.field_factor
            if factor is not None:
                factor = np.delete(factor, index, axis=2)
            left = replace(prediction, weights=kept, field_factor=factor)
            columns.append(total - rest.log_prob(left))
        return np.column_stack(columns)
