"""Gaussian log-likelihood of measured forces and field, vectorised over theta."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from calib.data.dataset import Dataset
from calib.inference.field_floor import FieldFloor
from calib.inference.field_likelihood import FieldLikelihood
from calib.inference.field_noise import field_covariance
from calib.inference.field_patterns import with_patterns_of
from calib.inference.field_scales import FieldSizes
from calib.inference.force_factor import ForceNormal, on_log_scale
from calib.inference.forward import ForwardModel, Prediction, identity_basis
from calib.inference.gaussian import conditional_log_densities, density_and_misfit
from calib.inference.noise import ForceErrors, ForceSizes, NoiseSettings, force_errors
from calib.inference.shared_error import (
    AlongError,
    SharedPosterior,
    marginal,
    shared_posterior,
)
from calib.inference.student_force import (
    ForceDensity,
    student_marginal,
    student_shared_posterior,
)
from fe.response import Array

FORCE_NOISE, FIELD_NOISE = "force_noise", "field_noise"
DISCREPANCY, OF_FORCE = "discrepancy", "discrepancy_of_force"
SIZES = (FORCE_NOISE, FIELD_NOISE, DISCREPANCY, OF_FORCE)
"""sizes of the errors that may be unknown"""


@dataclass(frozen=True)
class Likelihood:
    """ln p(data | theta) with all errors in the covariance, which depends on theta.

    Force: N(y; f(theta), Sigma_mean + emulator + discretisation). Field: N(u; u(theta), noise +
    discretisation + emulator). Given theta they share one error, the zero of the travel. With
    `errors.freedom` the forces' normal is a multivariate t about it.
    """

    forward: ForwardModel
    force: Array
    """(n_step,) measured mean force, N"""
    errors: ForceErrors
    field: FieldLikelihood | None = None
    unknown: tuple[str, ...] = ()
    """names of the last columns of theta: logarithms of sizes of the errors, some of `SIZES`"""

    def __post_init__(self) -> None:
        if not set(self.unknown) <= set(SIZES):
            raise ValueError(f"unknown: expected some of {', '.join(SIZES)}, got {self.unknown}")
        if self.errors.freedom is not None and DISCREPANCY in self.unknown:
            raise ValueError(
                f"unknown: found {DISCREPANCY} with Student-t forces, expected one of the two"
            )

    def log_prob(self, theta: Array) -> Array:
        """(m,) log-likelihood at theta (m, n); -inf where the forward model failed."""
        return self.log_prob_of(theta, self.predict(theta))

    def log_prob_of(
        self, theta: Array, prediction: Prediction, field: FieldLikelihood | None = None
    ) -> Array:
        """(m,) log-likelihood of a given prediction, in the basis of the forward model or `field`.

        `field` is that of this likelihood with another basis (`FieldLikelihood.with_basis`).
        """
        return self._joint(*self._parts(theta, prediction, field))

    def shared_posterior(self, theta: Array) -> SharedPosterior:
        """Posterior of the nuisances of the test given theta (m, n), in their prior SDs."""
        force, others = self._parts(theta, self.predict(theta))
        if self.errors.freedom is not None:
            return student_shared_posterior(force, others, self.errors.freedom)
        return shared_posterior([force.along, *others])

    def _parts(
        self, theta: Array, prediction: Prediction, field: FieldLikelihood | None = None
    ) -> tuple[ForceDensity, list[AlongError]]:
        """The forces, and the field where there is one."""
        steps = np.arange(self.force.size)
        force = self._force_along(prediction, steps, self._force_sizes(theta))
        if self.field is None:
            return force, []
        field, sizes = field or self._field(self.field), self.field_sizes(theta)
        return force, [field.along(prediction, None, sizes)]

    def _joint(self, force: ForceDensity, others: list[AlongError]) -> Array:
        """(m,) ln density of forces and other parts, the errors that they share integrated out."""
        if self.errors.freedom is not None:
            return student_marginal(force, others, self.errors.freedom)
        return marginal([force.along, *others])

    def size(self, theta: Array, name: str) -> Array | None:
        """(m,) an unknown size of the errors at theta (m, n); None where it is known."""
        if name not in self.unknown:
            return None
        size: Array = np.exp(
            theta[:, theta.shape[1] - len(self.unknown) + self.unknown.index(name)]
        )
        return size

    def _force_sizes(self, theta: Array) -> ForceSizes | None:
        if not self.unknown:
            return None
        return ForceSizes(
            *(self.size(theta, name) for name in (FORCE_NOISE, DISCREPANCY, OF_FORCE))
        )

    def field_sizes(self, theta: Array) -> FieldSizes | None:
        """Unknown sizes of the field's errors at theta (m, n); None where they are known."""
        if not {FIELD_NOISE, DISCREPANCY} & set(self.unknown):
            return None
        return FieldSizes(self.size(theta, FIELD_NOISE), self.size(theta, DISCREPANCY))

    def field_errors(self, theta: Array, rng: np.random.Generator) -> Array:
        """(m, n_step, n_point, 3) draws of the field's own errors at theta (m, n), mm.

        Of measurement, mesh and discrepancy, and of what the modes leave out; not those shared with
        the forces. Raises ValueError without a field.
        """
        field = self.field
        if field is None:
            raise ValueError("likelihood: holds no field, expected one whose errors can be drawn")
        sizes, total = self.field_sizes(theta), field.total
        if sizes is None or field.scales is None:
            return total.sample(rng, len(theta))
        rows = (field.scales.covariance(total, sizes, row) for row in range(len(theta)))
        return np.concatenate([covariance.sample(rng, 1) for covariance in rows])

    def predict(self, theta: Array) -> Prediction:
        """What the forward model says at theta (m, n), whose last columns may be of the errors."""
        n = theta.shape[1] - len(self.unknown)
        return self.forward.predict(theta[:, :n] if self.unknown else theta)

    def pointwise(self, theta: Array) -> Array:
        """(m, n_step) log density of each increment given all others, for leave-one-out scores.

        Increments are dependent, so the density of one alone would count shared errors as if
        they were independent evidence (Buerkner, Gabry, Vehtari 2021). With a field, an
        increment is its force and its field together: log p(y) - log p(y without i).
        """
        prediction = self.predict(theta)
        if self.field is None and self.errors.freedom is None and self.errors.discrepancy is None:
            return conditional_log_densities(
                self.force_covariance(prediction, theta), self.force - prediction.force
            )
        field = None if self.field is None else self._field(self.field)
        steps = np.arange(self.force.size)
        sizes, own = self.field_sizes(theta), self._force_sizes(theta)
        total = self._joint(*self._parts(theta, prediction))
        columns = []
        for index in range(steps.size):
            force = self._force_along(prediction, np.delete(steps, index), own)
            others = [] if field is None else [field.along(prediction, index, sizes)]
            columns.append(total - self._joint(force, others))
        return np.column_stack(columns)

    def force_log_prob(self, theta: Array, steps: npt.NDArray[np.intp]) -> Array:
        """(m,) ln density of the forces at some of the steps, at theta (m, n)."""
        force = self._force_along(self.predict(theta), steps, self._force_sizes(theta))
        return self._joint(force, [])

    def force_covariance(self, prediction: Prediction, theta: Array | None = None) -> Array:
        """(m, n_step, n_step) covariance of the force residual, nuisances included, N^2.

        Of Student-t forces the scale matrix. `theta` (m, n) where sizes of the errors are unknown.
        Without the factor by which the model errs.
        """
        force = np.ascontiguousarray(prediction.force.T)
        sizes = None if theta is None else self._force_sizes(theta)
        covariance = self.errors.covariance(force, prediction.force_covariance, sizes)
        for shift in self.errors.shifts(force):
            covariance += shift[:, None] * shift[None, :]
        return np.ascontiguousarray(covariance.transpose(2, 0, 1))

    def _force_along(
        self, prediction: Prediction, steps: npt.NDArray[np.intp], sizes: ForceSizes | None
    ) -> ForceDensity:
        """Log normal density of the forces at `steps` along the nuisances of the test."""
        covariance, residual, shifts = self._force_normal(prediction, sizes)
        along, misfit = density_and_misfit(
            covariance[np.ix_(steps, steps)], residual[steps], shifts[:, steps]
        )
        return ForceDensity(along, misfit, len(steps))

    def _force_normal(self, prediction: Prediction, sizes: ForceSizes | None) -> ForceNormal:
        """Covariance, residuals and shifts, on the scale of ln of the force with a discrepancy."""
        force = np.ascontiguousarray(prediction.force.T)
        covariance = self.errors.covariance(force, prediction.force_covariance, sizes)
        shifts, factor = self.errors.shifts(force), self.errors.factor(sizes)
        if factor is None:
            return ForceNormal(covariance, self.force[:, None] - force, shifts)
        own = self.errors.measured(sizes)
        return on_log_scale(self.force, force, own, covariance - own, shifts, factor)

    def force_factor(self, theta: Array) -> Array:
        """(m, n_step) mean of ln of the factor by which the model errs, given theta and forces.

        D Sigma^-1 r, with D its covariance, Sigma that of the residuals r; zeros where there is
        none.
        """
        residual, solved = self._weighed_residual(theta)
        factor = self.factor_covariance(theta)
        if factor is None:
            return np.zeros_like(residual)
        mean: Array = np.einsum("mij,mj->mi", factor, self.force * solved)
        return mean

    def factor_covariance(self, theta: Array) -> Array | None:
        """(m, n_step, n_step) covariance of ln of that factor at theta (m, n); None without it."""
        factor = self.errors.factor(self._force_sizes(theta))
        if factor is None:
            return None
        shape = (len(theta), *factor.shape[:2])
        return np.broadcast_to(factor.transpose(2, 0, 1), shape)

    def force_misfit(self, theta: Array) -> Array:
        """(m,) chi-square r^T Sigma^-1 r of the forces at theta (m, n)."""
        residual, solved = self._weighed_residual(theta)
        misfit: Array = np.einsum("mi,mi->m", residual, solved)
        return misfit

    def _weighed_residual(self, theta: Array) -> tuple[Array, Array]:
        """(m, n_step) residuals r of the forces and Sigma^-1 r, all errors in Sigma."""
        covariance, residual, shifts = self._force_normal(
            self.predict(theta), self._force_sizes(theta)
        )
        total = (covariance + np.einsum("qim,qjm->ijm", shifts, shifts)).transpose(2, 0, 1)
        return residual.T, np.linalg.solve(total, residual.T[:, :, None])[:, :, 0]

    def with_forward(self, forward: ForwardModel) -> Likelihood:
        """The same data and errors under another forward model (emulator or direct)."""
        return replace(self, forward=forward)

    def _field(self, field: FieldLikelihood) -> FieldLikelihood:
        # A direct model knows the shape of its field only after its first run.
        basis = self.forward.field_basis
        if basis is None:
            raise ValueError("forward: predicts no field although field data are to be compared")
        if basis is field.basis:
            return field
        replaced = field.with_basis(basis)
        # Kept, so that its projection is computed once; the likelihood's value is unaffected.
        object.__setattr__(self, "field", replaced)
        return replaced


def build_likelihood(
    dataset: Dataset,
    forward: ForwardModel,
    noise: NoiseSettings,
    *,
    force_discretisation: Array | float = 0.0,
    field_floor: FieldFloor | float = 0.0,
    field_patterns: Array | None = None,
    unknown: Mapping[str, tuple[float, float]] | None = None,
) -> Likelihood:
    """Likelihood of `dataset` under `forward`; the field is used when the dataset has one.

    `force_discretisation` (n_step,) is the relative SD of the mesh error of the force,
    `field_floor` that of the field, or one SD for all [mm], and `field_patterns`
    (q, n_step, n_point, 3) its parts of known shape [mm], each of one SD. `unknown` are sizes of
    the errors that theta ends with, in order: name, one of `SIZES`, and its bounds.
    Raises ValueError when shapes disagree, the noise is impossible (see `noise`), or the
    forward model has no field where the data have one.
    """
    ranges = unknown or {}
    names = tuple(ranges)
    errors = force_errors(
        dataset, noise, force_discretisation, unknown_discrepancy=DISCREPANCY in names
    )
    measured = dataset.field
    if measured is None:
        return Likelihood(forward, dataset.force_mean, errors, unknown=names)
    covariance = field_covariance(
        measured,
        floor=field_floor,
        patterns=field_patterns,
        freedom=noise.field_freedom,
    )
    basis = forward.field_basis
    if basis is None:
        # A direct model shows the shape of its field with its first run only.
        basis = identity_basis(measured.displacement.shape)
    sizes = ranges.get(FIELD_NOISE), ranges.get(DISCREPANCY)
    covariance, scales = with_patterns_of(covariance, dataset.travel, measured, noise, sizes)
    shifts = np.stack([error.field for error in errors.shared])
    field = FieldLikelihood(measured.displacement, covariance, basis, shifts, scales)
    return Likelihood(forward, dataset.force_mean, errors, field, names)
