"""Gaussian log-likelihood of measured forces and field, vectorised over theta."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from calib.data.dataset import Dataset
from calib.inference.field_likelihood import FieldLikelihood
from calib.inference.field_noise import Kernel, field_covariance
from calib.inference.field_scales import (
    FieldScales,
    FieldSizes,
    discrepancy_patterns,
    rigid_patterns,
)
from calib.inference.force_factor import on_log_scale
from calib.inference.forward import ForwardModel, Prediction, identity_basis
from calib.inference.gaussian import conditional_log_densities, density_and_misfit
from calib.inference.noise import (
    ForceErrors,
    ForceSizes,
    NoiseSettings,
    force_errors,
    smooth_over,
)
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
FORCE_DISCREPANCY, FIELD_DISCREPANCY = "force_discrepancy", "field_discrepancy"
SIZES = (FORCE_NOISE, FIELD_NOISE, FORCE_DISCREPANCY, FIELD_DISCREPANCY)
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
        if self.errors.freedom is not None and FORCE_DISCREPANCY in self.unknown:
            raise ValueError(
                f"unknown: found {FORCE_DISCREPANCY} with Student-t forces, expected one of the two"
            )

    def log_prob(self, theta: Array) -> Array:
        """(m,) log-likelihood at theta (m, n); -inf where the forward model failed."""
        return self.log_prob_of(theta, self.predict(theta))

    def log_prob_of(self, theta: Array, prediction: Prediction) -> Array:
        """(m,) log-likelihood where a prediction in the forward model's basis is given."""
        return self._joint(*self._parts(theta, prediction))

    def shared_posterior(self, theta: Array) -> SharedPosterior:
        """Posterior of the nuisances of the test given theta (m, n), in their prior SDs."""
        force, others = self._parts(theta, self.predict(theta))
        if self.errors.freedom is not None:
            return student_shared_posterior(force, others, self.errors.freedom)
        return shared_posterior([force.along, *others])

    def _parts(self, theta: Array, prediction: Prediction) -> tuple[ForceDensity, list[AlongError]]:
        """The forces, and the field where there is one."""
        steps = np.arange(self.force.size)
        force = self._force_along(prediction, steps, self._force_sizes(theta))
        if self.field is None:
            return force, []
        sizes = self.field_sizes(theta)
        return force, [self._field(self.field).along(prediction, None, sizes)]

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
        return ForceSizes(self.size(theta, FORCE_NOISE), self.size(theta, FORCE_DISCREPANCY))

    def field_sizes(self, theta: Array) -> FieldSizes | None:
        """Unknown sizes of the field's errors at theta (m, n); None where they are known."""
        if not {FIELD_NOISE, FIELD_DISCREPANCY} & set(self.unknown):
            return None
        return FieldSizes(self.size(theta, FIELD_NOISE), self.size(theta, FIELD_DISCREPANCY))

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
        if self.field is None and self.errors.freedom is None:
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
        A factor by which the model errs counts to first order.
        """
        force = np.ascontiguousarray(prediction.force.T)
        sizes = None if theta is None else self._force_sizes(theta)
        covariance = self.errors.covariance(force, prediction.force_covariance, sizes)
        for shift in self.errors.shifts(force):
            covariance += shift[:, None] * shift[None, :]
        if self.errors.factor is not None:
            covariance += force[:, None] * force[None, :] * self.errors.factor[:, :, None]
        return np.ascontiguousarray(covariance.transpose(2, 0, 1))

    def _force_along(
        self, prediction: Prediction, steps: npt.NDArray[np.intp], sizes: ForceSizes | None
    ) -> ForceDensity:
        """Log normal density of the forces at `steps` along the nuisances of the test."""
        force = np.ascontiguousarray(prediction.force.T)
        covariance = self.errors.covariance(force, prediction.force_covariance, sizes)
        residual, shifts = self.force[:, None] - force, self.errors.shifts(force)
        factor = self.errors.factor
        if factor is not None:
            own = self.errors.measured(sizes)
            covariance, residual, shifts = on_log_scale(
                self.force, force, own, covariance - own, shifts, factor
            )
        along, misfit = density_and_misfit(
            covariance[np.ix_(steps, steps)], residual[steps], shifts[:, steps]
        )
        return ForceDensity(along, misfit, len(steps))

    def force_discrepancy(self, theta: Array) -> Array:
        """(m, n_step) mean of the discrepancy of the force given theta (m, n), N.

        D Sigma^-1 (y - f), with D its part of the covariance Sigma; zeros where there is none.
        """
        prediction, amplitude = self.predict(theta), self.size(theta, FORCE_DISCREPANCY)
        if amplitude is None or self.errors.smoothness is None:
            return np.zeros_like(prediction.force)
        residual = (self.force - prediction.force)[:, :, None]
        solved = np.linalg.solve(self.force_covariance(prediction, theta), residual)[:, :, 0]
        own = amplitude[:, None] * prediction.force
        mean: Array = own * ((own * solved) @ self.errors.smoothness)
        return mean

    def force_misfit(self, theta: Array) -> Array:
        """(m,) chi-square (y - f)^T Sigma^-1 (y - f) of the forces at theta (m, n)."""
        prediction = self.predict(theta)
        residual = self.force - prediction.force
        covariance = self.force_covariance(prediction, theta)
        solved = np.linalg.solve(covariance, residual[:, :, None])
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
    unknown: Mapping[str, tuple[float, float]] | None = None,
) -> Likelihood:
    """Likelihood of `dataset` under `forward`; the field is used when the dataset has one.

    `force_discretisation` (n_step,) is the relative SD of the mesh error of the force,
    `field_floor` that of the field [mm], one for all or (n_step, 3), and `field_patterns`
    (q, n_step, n_point, 3) its parts of known shape [mm], each of one SD. `unknown` are sizes of
    the errors that theta ends with, in order: name, one of `SIZES`, and its bounds.
    Raises ValueError when shapes disagree, the noise is impossible (see `noise`), or the
    forward model has no field where the data have one.
    """
    errors = force_errors(dataset, noise, force_discretisation)
    names = tuple(unknown or {})
    if dataset.field is None:
        return Likelihood(forward, dataset.force_mean, errors, unknown=names)
    covariance = field_covariance(
        dataset.field,
        kernel=kernel,
        floor=field_floor,
        patterns=field_patterns,
        freedom=noise.field_freedom,
    )
    basis = forward.field_basis
    if basis is None:
        # A direct model shows the shape of its field with its first run only.
        basis = identity_basis(dataset.field.displacement.shape)
    rigid = rigid_patterns(
        dataset.field.points, dataset.travel.size, noise.translation_sd, noise.rotation_sd
    )
    covariance = covariance.with_patterns(rigid)
    shifts = np.stack([error.field for error in errors.shared])
    scales = _field_scales(dataset, noise, unknown or {})
    field = FieldLikelihood(dataset.field.displacement, covariance, basis, shifts, scales)
    return Likelihood(forward, dataset.force_mean, errors, field, names)


def _field_scales(
    dataset: Dataset, noise: NoiseSettings, unknown: Mapping[str, tuple[float, float]]
) -> FieldScales | None:
    """Ranges of the unknown sizes of the field's errors, and the shapes of its discrepancy."""
    ranges = unknown.get(FIELD_NOISE), unknown.get(FIELD_DISCREPANCY)
    if dataset.field is None or ranges == (None, None):
        return None
    patterns = np.zeros((0, *dataset.field.displacement.shape))
    if ranges[1] is not None:
        over_travel = smooth_over(dataset.travel, noise.force_discrepancy_length)
        length = noise.field_discrepancy_length
        patterns = discrepancy_patterns(dataset.field.points, over_travel, length)
    return FieldScales(ranges[0], ranges[1], patterns)
