"""Log-likelihood of a measured displacement field under a forward model's field prediction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.inference.field_noise import FieldCovariance
from calib.inference.forward import FieldBasis, Prediction
from calib.inference.gaussian import LOG_2PI, gram_and_logdet
from calib.inference.shared_error import AlongError
from fe.response import Array


@dataclass(frozen=True)
class ProjectedField:
    """The field's misfit as a function of the k weights: exact, and independent of n_point.

    With Sigma the error covariance, M the modes, d the measured field minus the offset and e the
    shared error's field: precision G = M Sigma^-1 M^T, best weights w0 = G^-1 M Sigma^-1 d, misfit
    of these c = d^T Sigma^-1 d - w0^T G w0.
    """

    precision: Array
    """(k, k) G"""
    best: Array
    """(k,) w0"""
    constant: float
    """-0.5 (c + ln |Sigma| + n ln 2 pi)"""
    shared: Array
    """(k,) M Sigma^-1 e"""
    shared_pull: float
    """d^T Sigma^-1 e"""
    shared_precision: float
    """e^T Sigma^-1 e"""

    def along(self, weights: Array, variance: Array | None) -> AlongError:
        """Log-likelihood along the shared error, weights ~ N(weights, diag variance) integrated.

        N(d; M^T w + z e, Sigma + M^T V M) by Woodbury in the form I + V^1/2 G V^1/2, which stays
        positive definite for V = 0 and for modes the data do not see.
        """
        off = self.best - weights
        pulled = off @ self.precision
        misfit = np.einsum("mk,mk->m", off, pulled)
        slope = self.shared_pull - weights @ self.shared
        curvature = np.full(len(weights), self.shared_precision)
        if variance is not None:
            root = np.sqrt(variance).T
            matrix = root[:, None] * self.precision[:, :, None] * root[None, :]
            diagonal = np.arange(self.best.size)
            matrix[diagonal, diagonal] += 1.0
            vectors = np.stack([root * pulled.T, root * self.shared[:, None]])
            gained, logdet = gram_and_logdet(matrix, vectors)
            misfit = misfit - gained[0, 0] + logdet
            slope = slope - gained[0, 1]
            curvature = curvature - gained[1, 1]
        return AlongError(self.constant - 0.5 * misfit, slope, curvature)


def project(
    observed: Array, covariance: FieldCovariance, basis: FieldBasis, shared: Array
) -> ProjectedField:
    """Reduce a field (n_step, n_point, 3) to the modes of `basis`, which must not be identity.

    `shared` (n_step, n_point, 3) is the field of one SD of the shared error, mm.
    """
    if basis.modes is None:
        raise ValueError("basis: an identity basis has no modes to project on")
    total = covariance.with_patterns(basis.truncation)
    difference = observed - basis.offset
    stacked = np.concatenate([basis.modes, shared[None], difference[None]])
    products = total.inner(stacked, stacked)
    precision, pull = products[:-2, :-2], products[:-2, -1]
    best = np.asarray(np.linalg.lstsq(precision, pull, rcond=None)[0], dtype=np.float64)
    misfit = products[-1, -1] - best @ precision @ best
    constant = -0.5 * (misfit + total.logdet + observed.size * LOG_2PI)
    return ProjectedField(
        precision=0.5 * (precision + precision.T),
        best=best,
        constant=float(constant),
        shared=products[:-2, -2],
        shared_pull=float(products[-1, -2]),
        shared_precision=float(products[-2, -2]),
    )


@dataclass(frozen=True)
class FieldLikelihood:
    """Gaussian likelihood of one measured field under models with a given basis."""

    observed: Array
    """(n_step, n_point, 3) measured displacement, mm"""
    covariance: FieldCovariance
    """errors of measurement and mesh, without the emulator's and the shared error"""
    basis: FieldBasis
    shared: Array
    """(n_step, n_point, 3) one SD of the error that the field shares with the forces, mm"""

    def __post_init__(self) -> None:
        expected = self.covariance.shape
        shapes = {
            "observed": self.observed.shape,
            "basis": self.basis.offset.shape,
            "shared": self.shared.shape,
        }
        for name, shape in shapes.items():
            if shape != expected:
                raise ValueError(f"{name}: expected field of shape {expected}, found {shape}")

    @cached_property
    def projected(self) -> ProjectedField:
        """The projected problem (for a basis with modes)."""
        return project(self.observed, self.covariance, self.basis, self.shared)

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
        return FieldLikelihood(
            np.delete(self.observed, index, axis=0),
            self.covariance.without_step(index),
            basis,
            np.delete(self.shared, index, axis=0),
        )

    def with_basis(self, basis: FieldBasis) -> FieldLikelihood:
        """The same data and errors for a model with another basis."""
        return replace(self, basis=basis)

    def along(self, prediction: Prediction) -> AlongError:
        """Log-likelihood of the field along the shared error; not finite where a solve failed."""
        weights = prediction.weights
        if weights is None:
            raise ValueError("prediction: holds no field although field data are to be compared")
        if self.basis.modes is not None:
            return self.projected.along(weights, prediction.weight_variance)
        return self._full(weights, prediction.field_factor)

    def _full(self, weights: Array, factor: Array | None) -> AlongError:
        """Whole fields, no basis: for the few evaluations of a direct model."""
        truncated = self.covariance.with_patterns(self.basis.truncation)
        result = np.full((3, len(weights)), [[-np.inf], [0.0], [0.0]])
        for index, field in enumerate(self.basis.fields(weights)):
            if np.all(np.isfinite(field)):
                covariance = truncated if factor is None else truncated.with_patterns(factor[index])
                vectors = np.stack([self.observed - field, self.shared])
                gram = covariance.inner(vectors, vectors)
                misfit = gram[0, 0] + covariance.logdet + field.size * LOG_2PI
                result[:, index] = -0.5 * misfit, gram[0, 1], gram[1, 1]
        return AlongError(*result)

    def without_step(self, prediction: Prediction, index: int) -> AlongError:
        """As `along`, for all increments but one: marginals of a normal leave out its rows."""
        kept, factor = prediction.weights, prediction.field_factor
        if self.basis.modes is None and kept is not None:
            kept = np.delete(kept.reshape(-1, *self.observed.shape), index, axis=1)
            kept = kept.reshape(len(kept), -1)
        if factor is not None:
            factor = np.delete(factor, index, axis=2)
        return self._left_out[index].along(replace(prediction, weights=kept, field_factor=factor))
