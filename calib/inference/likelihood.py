"""Gaussian log-likelihood of measured forces and field, vectorised over theta."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.data.dataset import Dataset
from calib.inference.field_likelihood import FieldLikelihood
from calib.inference.field_noise import Kernel, field_covariance
from calib.inference.forward import ForwardModel, Prediction, identity_basis
from calib.inference.gaussian import conditional_log_densities, log_density
from calib.inference.noise import ForceErrors, NoiseSettings, force_errors, slope_matrix
from fe.response import Array


@dataclass(frozen=True)
class Likelihood:
    """ln p(data | theta) with all errors in the covariance, which depends on theta.

    Force: N(y; f(theta), Sigma_mean + emulator + discretisation + travel zero).
    Field: N(u; u(theta), noise + discretisation + emulator). Given theta the two are independent.
    """

    forward: ForwardModel
    force: Array
    """(n_step,) measured mean force, N"""
    errors: ForceErrors
    field: FieldLikelihood | None = None

    def log_prob(self, theta: Array) -> Array:
        """(m,) log-likelihood at theta (m, 3); -inf where the forward model failed."""
        prediction = self.forward.predict(theta)
        force = np.ascontiguousarray(prediction.force.T)
        covariance = self.errors.covariance(force, prediction.force_covariance)
        value = log_density(covariance, self.force[:, None] - force)
        if self.field is not None:
            value = value + self._field(self.field).log_prob(prediction)
        return value

    def pointwise(self, theta: Array) -> Array:
        """(m, n_step) log density of each increment given all others, for leave-one-out scores.

        Increments are dependent, so the density of one alone would count shared errors as if
        they were independent evidence (Buerkner, Gabry, Vehtari 2021). With a field, an
        increment is its force and its field together.
        """
        prediction = self.forward.predict(theta)
        value = conditional_log_densities(
            self.force_covariance(prediction), self.force - prediction.force
        )
        if self.field is not None:
            value = value + self._field(self.field).pointwise(prediction)
        return value

    def force_covariance(self, prediction: Prediction) -> Array:
        """(m, n_step, n_step) covariance of the force residual, N^2."""
        force = np.ascontiguousarray(prediction.force.T)
        covariance = self.errors.covariance(force, prediction.force_covariance)
        return np.ascontiguousarray(covariance.transpose(2, 0, 1))

    def force_misfit(self, theta: Array) -> Array:
        """(m,) chi-square (y - f)^T Sigma^-1 (y - f) of the forces at theta (m, 3)."""
        prediction = self.forward.predict(theta)
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
    kernel: Kernel = "exponential",
) -> Likelihood:
    """Likelihood of `dataset` under `forward`; the field is used when the dataset has one.

    `force_discretisation` (n_step,) is the relative SD of the mesh error of the force,
    `field_floor` that of the field [mm], one for all or (n_step, 3).
    Raises ValueError when shapes disagree, the noise is impossible (see `noise`), or the
    forward model has no field where the data have one.
    """
    errors = force_errors(dataset, noise, force_discretisation)
    if dataset.field is None:
        return Likelihood(forward, dataset.force_mean, errors)
    covariance = field_covariance(
        dataset.field,
        kernel=kernel,
        floor=field_floor,
        patterns=travel_zero_pattern(dataset, noise.travel_zero_sd),
    )
    basis = forward.field_basis
    if basis is None:
        # A direct model shows the shape of its field with its first run only.
        basis = identity_basis(dataset.field.displacement.shape)
    field = FieldLikelihood(dataset.field.displacement, covariance, basis)
    return Likelihood(forward, dataset.force_mean, errors, field)


def travel_zero_pattern(dataset: Dataset, travel_zero_sd: float) -> Array:
    """(1 or 0, n_step, n_point, 3) shift of the field by one SD of the travel's zero, mm.

    From the measured field by the spline of `noise.slope_matrix`. That one error of zero moves
    force and field together is neglected: each has it in its own covariance.
    """
    if dataset.field is None or travel_zero_sd == 0:
        n_point = 0 if dataset.field is None else dataset.field.displacement.shape[1]
        return np.zeros((0, dataset.travel.size, n_point, 3))
    slope = np.tensordot(slope_matrix(dataset.travel), dataset.field.displacement, axes=1)
    return travel_zero_sd * slope[None]
