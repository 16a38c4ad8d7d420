"""Gaussian log-likelihood of measured forces and field, vectorised over theta."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from calib.data.dataset import Dataset
from calib.inference.field_likelihood import FieldLikelihood
from calib.inference.field_noise import Kernel, field_covariance
from calib.inference.forward import ForwardModel, Prediction, identity_basis
from calib.inference.gaussian import conditional_log_densities, log_density_along
from calib.inference.noise import ForceErrors, NoiseSettings, force_errors, slope_matrix
from calib.inference.shared_error import AlongError, marginal
from fe.response import Array


@dataclass(frozen=True)
class Likelihood:
    """ln p(data | theta) with all errors in the covariance, which depends on theta.

    Force: N(y; f(theta), Sigma_mean + emulator + discretisation). Field: N(u; u(theta), noise +
    discretisation + emulator). Given theta they share one error, the zero of the travel.
    """

    forward: ForwardModel
    force: Array
    """(n_step,) measured mean force, N"""
    errors: ForceErrors
    field: FieldLikelihood | None = None

    def log_prob(self, theta: Array) -> Array:
        """(m,) log-likelihood at theta (m, n); -inf where the forward model failed."""
        prediction = self.predict(theta)
        parts = [self._force_along(prediction, np.arange(self.force.size))]
        if self.field is not None:
            parts.append(self._field(self.field).along(prediction))
        return marginal(parts)

    def predict(self, theta: Array) -> Prediction:
        """What the forward model says at theta (m, n), whose last columns may be of the errors."""
        return self.forward.predict(theta)

    def pointwise(self, theta: Array) -> Array:
        """(m, n_step) log density of each increment given all others, for leave-one-out scores.

        Increments are dependent, so the density of one alone would count shared errors as if
        they were independent evidence (Buerkner, Gabry, Vehtari 2021). With a field, an
        increment is its force and its field together: log p(y) - log p(y without i).
        """
        prediction = self.predict(theta)
        if self.field is None:
            return conditional_log_densities(
                self.force_covariance(prediction), self.force - prediction.force
            )
        field = self._field(self.field)
        steps = np.arange(self.force.size)
        total = marginal([self._force_along(prediction, steps), field.along(prediction)])
        columns = []
        for index in range(steps.size):
            force = self._force_along(prediction, np.delete(steps, index))
            columns.append(total - marginal([force, field.along(prediction, index)]))
        return np.column_stack(columns)

    def force_covariance(self, prediction: Prediction) -> Array:
        """(m, n_step, n_step) covariance of the force residual, the travel's zero included, N^2."""
        force = np.ascontiguousarray(prediction.force.T)
        covariance = self.errors.covariance(force, prediction.force_covariance)
        shift = self.errors.zero_shift(force)
        covariance += shift[:, None] * shift[None, :]
        return np.ascontiguousarray(covariance.transpose(2, 0, 1))

    def _force_along(self, prediction: Prediction, steps: npt.NDArray[np.intp]) -> AlongError:
        """Log density of the forces at `steps` along the travel's zero."""
        force = np.ascontiguousarray(prediction.force.T)
        covariance = self.errors.covariance(force, prediction.force_covariance)
        residual = self.force[:, None] - force
        return log_density_along(
            covariance[np.ix_(steps, steps)], residual[steps], self.errors.zero_shift(force)[steps]
        )

    def force_misfit(self, theta: Array) -> Array:
        """(m,) chi-square (y - f)^T Sigma^-1 (y - f) of the forces at theta (m, n)."""
        prediction = self.predict(theta)
        residual = self.force - prediction.force
        solved = np.linalg.solve(self.force_covariance(prediction), residual[:, :, None])
        misfit: Array = np.einsum("mi,mi->m", residual, solved[:, :, 0])
        return misfit

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
    field_floor: Array | float = 0.0,
    field_patterns: Array | None = None,
    kernel: Kernel = "exponential",
) -> Likelihood:
    """Likelihood of `dataset` under `forward`; the field is used when the dataset has one.

    `force_discretisation` (n_step,) is the relative SD of the mesh error of the force,
    `field_floor` that of the field [mm], one for all or (n_step, 3), and `field_patterns`
    (q, n_step, n_point, 3) its parts of known shape [mm], each of one SD.
    Raises ValueError when shapes disagree, the noise is impossible (see `noise`), or the
    forward model has no field where the data have one.
    """
    errors = force_errors(dataset, noise, force_discretisation)
    if dataset.field is None:
        return Likelihood(forward, dataset.force_mean, errors)
    covariance = field_covariance(
        dataset.field, kernel=kernel, floor=field_floor, patterns=field_patterns
    )
    basis = forward.field_basis
    if basis is None:
        # A direct model shows the shape of its field with its first run only.
        basis = identity_basis(dataset.field.displacement.shape)
    shift = noise.travel_zero_sd * slope_matrix(dataset.travel)
    field = FieldLikelihood(dataset.field.displacement, covariance, basis, shift)
    return Likelihood(forward, dataset.force_mean, errors, field)
