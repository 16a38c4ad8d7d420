"""Log-likelihood of a measured displacement field under a forward model's field prediction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.inference.field_noise import FieldCovariance
from calib.inference.field_scales import FieldScales, FieldSizes
from calib.inference.forward import FieldBasis, Prediction
from calib.inference.gaussian import LOG_2PI, scaled_gram_and_logdet
from calib.inference.shared_error import AlongError
from calib.inference.tabled_field import TabledField, tabled
from fe.response import Array


@dataclass(frozen=True)
class ProjectedField:
    """The field's misfit as a function of the k weights: exact, and independent of n_point.

    With Sigma the error covariance, M the modes and d the measured field minus the offset:
    precision G = M Sigma^-1 M^T, best weights w0 = G^-1 M Sigma^-1 d, misfit of these
    c = d^T Sigma^-1 d - w0^T G w0. One SD of an error that field and forces share moves the
    predicted field by e = (1, w) E, with E the shifted offset and modes, for each of q errors.
    """

    precision: Array
    """(k, k) G"""
    best: Array
    """(k,) w0"""
    constant: float
    """-0.5 (c + ln |Sigma| + n ln 2 pi)"""
    shared_modes: Array
    """(q, k + 1, k) E Sigma^-1 M^T"""
    shared_pull: Array
    """(q, k + 1) E Sigma^-1 d"""
    shared_precision: Array
    """(q, q, k + 1, k + 1) E Sigma^-1 E^T"""

    def along(self, weights: Array, variance: Array | None) -> AlongError:
        """Log-likelihood along the shared errors, weights ~ N(weights, diag variance) integrated.

        N(d; M^T w + z e, Sigma + M^T V M) by Woodbury in the form I + V^1/2 G V^1/2, which stays
        positive definite for V = 0 and for modes the data do not see. The weights in e are taken
        at their mean.
        """
        off = self.best - weights
        pulled = off @ self.precision
        misfit = np.einsum("mk,mk->m", off, pulled)
        moved = np.column_stack([np.ones(len(weights)), weights])
        by_mode = [moved @ own for own in self.shared_modes]
        q = len(by_mode)
        slope = np.empty((q, len(weights)))
        curvature = np.empty((q, q, len(weights)))
        for a, (pull, own) in enumerate(zip(self.shared_pull, by_mode, strict=True)):
            slope[a] = moved @ pull - np.einsum("mk,mk->m", weights, own)
            for b in range(a + 1):
                curvature[a, b] = curvature[b, a] = np.einsum(
                    "mi,mi->m", moved @ self.shared_precision[a, b], moved
                )
        if variance is not None:
            root = np.sqrt(variance.T, order="C")
            vectors = np.empty((1 + q, *root.shape))
            for row, end in enumerate((pulled, *by_mode)):
                np.multiply(root, end.T, out=vectors[row])
            gained, logdet = scaled_gram_and_logdet(self.precision, root, vectors)
            misfit = misfit - gained[0, 0] + logdet
            slope = slope - gained[0, 1:]
            curvature = curvature - gained[1:, 1:]
        return AlongError(self.constant - 0.5 * misfit, slope, curvature)


def project(
    differences: Array, covariance: FieldCovariance, modes: Array, shared: Array
) -> list[ProjectedField]:
    """Reduce measured fields minus the offset (n, n_step, n_point, 3) to modes (k, ...).

    `shared` (q, k + 1, ...) is how one SD of each shared error moves the offset and the modes, mm.
    """
    k, size = len(modes), int(np.prod(differences.shape[1:]))
    q = len(shared)
    shape = (q * (k + 1), *differences.shape[1:])
    stacked = np.concatenate([modes, shared.reshape(shape), differences])
    products = covariance.inner(stacked, stacked)
    first = k + q * (k + 1)
    precision, own = products[:k, :k], slice(k, first)
    found = []
    for row in range(first, len(stacked)):
        pull = products[:k, row]
        best = np.asarray(np.linalg.lstsq(precision, pull, rcond=None)[0], dtype=np.float64)
        misfit = products[row, row] - best @ precision @ best
        found.append(
            ProjectedField(
                precision=0.5 * (precision + precision.T),
                best=best,
                constant=float(-0.5 * (misfit + covariance.logdet + size * LOG_2PI)),
                shared_modes=products[own, :k].reshape(q, k + 1, k),
                shared_pull=products[own, row].reshape(q, k + 1),
                shared_precision=products[own, own]
                .reshape(q, k + 1, q, k + 1)
                .transpose(0, 2, 1, 3),
            )
        )
    return found


@dataclass(frozen=True)
class FieldLikelihood:
    """Gaussian likelihood of one measured field under models with a given basis."""

    observed: Array
    """(n_step, n_point, 3) measured displacement, mm"""
    covariance: FieldCovariance
    """errors of measurement and mesh, without the emulator's and the shared error"""
    basis: FieldBasis
    shifts: Array
    """(q, n_step, n_step) changes a predicted field by one SD of each error that it shares with
    the forces: matrices over increments. Of the predicted field, since the measured one has noise
    of which the derivative over increments makes more"""
    scales: FieldScales | None = None
    """sizes of the noise and of a discrepancy where these are unknown"""

    def __post_init__(self) -> None:
        expected = self.covariance.shape
        for name, shape in (("observed", self.observed.shape), ("basis", self.basis.offset.shape)):
            if shape != expected:
                raise ValueError(f"{name}: expected field of shape {expected}, found {shape}")

    @cached_property
    def projected(self) -> ProjectedField:
        """The projected problem (for a basis with modes)."""
        return self._project(self.observed[None], None)[0]

    def of_fields(self, observed: Array) -> list[FieldLikelihood]:
        """The same for other measured fields (n, n_step, n_point, 3), projected all at once."""
        found = []
        for field, projected in zip(observed, self._project(observed, None), strict=True):
            likelihood = replace(self, observed=field)
            likelihood.__dict__["projected"] = projected  # where cached_property keeps it
            found.append(likelihood)
        return found

    @property
    def total(self) -> FieldCovariance:
        """Errors of measurement and mesh and what the modes leave out."""
        return self._covariance(None)

    @cached_property
    def _left_out(self) -> tuple[ProjectedField, ...]:
        """The projected problem without each increment in turn."""
        steps = range(self.observed.shape[0])
        return tuple(self._project(self.observed[None], step)[0] for step in steps)

    def _project(self, observed: Array, left_out: int | None) -> list[ProjectedField]:
        """The projected problem of each measured field, without one increment if asked."""
        if self.basis.modes is None:
            raise ValueError("basis: an identity basis has no modes to project on")
        modes = self.basis.modes
        shared = self.shared(np.concatenate([self.basis.offset[None], modes]))
        return project(
            _without(observed - self.basis.offset, left_out, axis=1),
            self._covariance(left_out),
            _without(modes, left_out, axis=1),
            _without(shared, left_out, axis=2),
        )

    def _covariance(self, left_out: int | None) -> FieldCovariance:
        """Errors of measurement and mesh and what the modes leave out."""
        total = self.covariance.with_patterns(self.basis.truncation)
        return total if left_out is None else total.without_step(left_out)

    def shared(self, fields: Array) -> Array:
        """(q, n, n_step, n_point, 3) change of fields (n, ...) by one SD of each shared error."""
        return np.stack([np.einsum("ij,qjpc->qipc", shift, fields) for shift in self.shifts])

    def with_basis(self, basis: FieldBasis) -> FieldLikelihood:
        """The same data and errors for a model with another basis."""
        return replace(self, basis=basis)

    def along(
        self,
        prediction: Prediction,
        left_out: int | None = None,
        sizes: FieldSizes | None = None,
    ) -> AlongError:
        """Log-likelihood of the field along the shared errors; not finite where a solve failed.

        Of all increments, or all but one: marginals of a normal leave out its rows. `sizes` where
        those of the errors are unknown.
        """
        weights = prediction.weights
        if weights is None:
            raise ValueError("prediction: holds no field although field data are to be compared")
        if sizes is not None and self.basis.modes is not None:
            tabled = self._tabled if left_out is None else self._tabled_left_out[left_out]
            return tabled.along(weights, prediction.weight_variance, sizes)
        if self.basis.modes is not None:
            projected = self.projected if left_out is None else self._left_out[left_out]
            return projected.along(weights, prediction.weight_variance)
        return self._full(weights, prediction.field_factor, left_out, sizes)

    @cached_property
    def _tabled(self) -> TabledField:
        """The projected problem over the sizes of the errors."""
        return self._table(None)

    @cached_property
    def _tabled_left_out(self) -> tuple[TabledField, ...]:
        return tuple(self._table(step) for step in range(self.observed.shape[0]))

    def _table(self, left_out: int | None) -> TabledField:
        if self.scales is None or self.basis.modes is None:
            raise ValueError("scales: expected those of the errors and a basis with modes")
        shared = self.shared(np.concatenate([self.basis.offset[None], self.basis.modes]))
        return tabled(
            _without(self.observed - self.basis.offset, left_out, axis=0),
            self._covariance(left_out),
            _without(self.basis.modes, left_out, axis=1),
            _without(shared, left_out, axis=2),
            self.scales.without_step(left_out),
        )

    def _full(
        self,
        weights: Array,
        factor: Array | None,
        left_out: int | None,
        sizes: FieldSizes | None,
    ) -> AlongError:
        """Whole fields, no basis: for the few evaluations of a direct model."""
        truncated = self._covariance(left_out)
        fields = self.basis.fields(weights)
        residual = _without(self.observed - fields, left_out, axis=1)
        shared = _without(self.shared(fields), left_out, axis=2)
        q, m = len(shared), len(weights)
        value, slope, curvature = np.full(m, -np.inf), np.zeros((q, m)), np.zeros((q, q, m))
        for index in np.flatnonzero(np.isfinite(fields).all(axis=(1, 2, 3))):
            covariance = truncated
            if sizes is not None and self.scales is not None:
                scales = self.scales.without_step(left_out)
                covariance = scales.covariance(truncated, sizes, int(index))
            if factor is not None:
                covariance = covariance.with_patterns(_without(factor[index], left_out, axis=1))
            vectors = np.concatenate([residual[index][None], shared[:, index]])
            gram = covariance.inner(vectors, vectors)
            misfit = gram[0, 0] + covariance.logdet + residual[index].size * LOG_2PI
            value[index] = -0.5 * misfit
            slope[:, index], curvature[:, :, index] = gram[0, 1:], gram[1:, 1:]
        return AlongError(value, slope, curvature)


def _without(values: Array, step: int | None, *, axis: int) -> Array:
    return values if step is None else np.delete(values, step, axis=axis)
