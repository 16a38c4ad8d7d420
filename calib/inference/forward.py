"""Forward models of the inference: theta = (kappa, r, s, ...) -> forces and front-face field."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from calib.inference.mesh_correction import MeshCorrection
from fe.response import Array, Response
from surrogate.symmetry import ScaledEmulator

NEGLIGIBLE = 1e-6
"""share of the slopes of a mesh's correction that is left out where other modes say nearly all"""


@dataclass(frozen=True)
class FieldBasis:
    """Coordinates in which a forward model gives its field: u = offset + weights @ modes.

    `modes` None is the identity: the weights are the field's values themselves, flattened.
    """

    offset: Array
    """(n_step, n_point, 3) mm"""
    modes: Array | None
    """(k, n_step, n_point, 3) mm per unit weight, or None"""
    truncation: Array
    """(q, n_step, n_point, 3) factor of the covariance of what the modes leave out, mm"""

    def fields(self, weights: Array) -> Array:
        """(m, n_step, n_point, 3) displacement [mm] of weights (m, k)."""
        if self.modes is None:
            return self.offset + weights.reshape(-1, *self.offset.shape)
        fields: Array = self.offset + np.tensordot(weights, self.modes, axes=1)
        return fields


def identity_basis(shape: tuple[int, ...]) -> FieldBasis:
    """Basis of a model that gives its field (n_step, n_point, 3) value by value."""
    return FieldBasis(np.zeros(shape), None, np.zeros((0, *shape)))


@dataclass(frozen=True)
class Prediction:
    """What a forward model says at m parameter vectors; NaN where it failed."""

    force: Array
    """(m, n_step) mean force of the whole sample, N"""
    force_covariance: Array | None
    """(m, n_step, n_step) covariance of the model's own error, N^2; None is zero"""
    weights: Array | None = None
    """(m, k) mean weights of the field in the model's `field_basis`"""
    weight_variance: Array | None = None
    """(m, k) variance of the weights, independent of each other; None is zero"""
    field_factor: Array | None = None
    """(m, q, n_step, n_point, 3) factor of a further covariance of the field, mm; None is zero"""


@dataclass(frozen=True)
class Jacobian:
    """Derivatives of the means with respect to x = (ln kappa, r, s, ...)."""

    force: Array
    """(m, n_step, n) N"""
    weights: Array | None = None
    """(m, k, n)"""


class ForwardModel(Protocol):
    """Anything that predicts forces, and a field when it has a basis for it."""

    @property
    def field_basis(self) -> FieldBasis | None:
        """Basis of the predicted fields; None when the model gives forces only."""

    def predict(self, theta: Array) -> Prediction:
        """Prediction at theta (m, n)."""

    def jacobian(self, theta: Array) -> Jacobian:
        """Derivatives at theta (m, n)."""


class EmulatorForward:
    """The emulator with its own uncertainty: covariance of the forces, variance of the weights.

    With a `correction` it predicts for the finer mesh.
    """

    def __init__(
        self,
        scaled: ScaledEmulator,
        *,
        with_field: bool = False,
        correction: MeshCorrection | None = None,
    ) -> None:
        self._scaled = scaled
        self._basis = _emulator_basis(scaled) if with_field else None
        self._correction = correction
        self._by_away: Array | None = None
        if self._basis is not None and correction is not None:
            self._basis, self._by_away = _corrected(self._basis, correction)

    @property
    def field_basis(self) -> FieldBasis | None:
        """POD modes of the emulator with their truncation; None for forces only."""
        return self._basis

    @property
    def bounds(self) -> Array:
        """(d, 2) box of the inputs but kappa, within which the emulator was trained."""
        return self._scaled.emulator.bounds

    def predict(self, theta: Array) -> Prediction:
        """Prediction at theta (m, n)."""
        force, covariance = self._scaled.force(theta)
        if self._correction is not None:
            force = force * self._correction.force
            covariance = covariance * np.outer(self._correction.force, self._correction.force)
        if self._basis is None:
            return Prediction(force, covariance)
        weights, variance = self._scaled.field_weights(theta)
        further = self._n_modes - weights.shape[1]
        if further:  # modes of the correction, of weights that are known
            variance = np.pad(variance, ((0, 0), (0, further)))
        return Prediction(force, covariance, self._with_correction(theta, weights), variance)

    def stated(self, theta: Array, unit_force: Array, weights: Array | None) -> Prediction:
        """The prediction, mesh correction included, of an emulator without error that says these.

        `unit_force` (m, n_step) N at kappa = 1 MPa and `weights` (m, k) of the field, if any, at
        theta (m, n).
        """
        force = theta[:, :1] * unit_force
        if self._correction is not None:
            force = force * self._correction.force
        if self._basis is None or weights is None:
            return Prediction(force, None)
        return Prediction(force, None, self._with_correction(theta, weights))

    def jacobian(self, theta: Array) -> Jacobian:
        """Derivatives of the means by x; d/d ln kappa = kappa d/d kappa."""
        by_x = np.ones((len(theta), 1, theta.shape[1]))
        by_x[:, 0, 0] = theta[:, 0]
        force = self._scaled.force_jacobian(theta) * by_x
        if self._correction is not None:
            force = force * self._correction.force[:, None]
        if self._basis is None:
            return Jacobian(force)
        weights = self._scaled.field_weights_jacobian(theta) * by_x
        if self._by_away is None or self._correction is None:
            return Jacobian(force, weights)
        slope = self._correction.away(theta[:, 1:])[1]
        weights = np.pad(weights, ((0, 0), (0, self._n_modes - weights.shape[1]), (0, 0)))
        weights[:, :, 1 : 1 + slope.shape[1]] += slope[:, None, :] * self._by_away.T
        return Jacobian(force, weights)

    @property
    def _n_modes(self) -> int:
        assert self._basis is not None and self._basis.modes is not None
        return len(self._basis.modes)

    def _with_correction(self, theta: Array, weights: Array) -> Array:
        """(m, k) weights of all modes, of the emulator's own (m, k')."""
        if self._by_away is None or self._correction is None:
            return weights
        away, _ = self._correction.away(theta[:, 1:])
        found: Array = np.pad(weights, ((0, 0), (0, self._n_modes - weights.shape[1])))
        return found + away @ self._by_away


@dataclass(frozen=True)
class GivenInputs:
    """A forward model whose unknowns beyond the first few are known: theta is the others alone."""

    forward: ForwardModel
    values: Array
    """(k,) coordinates of the last unknowns"""

    @property
    def field_basis(self) -> FieldBasis | None:
        """That of the model."""
        return self.forward.field_basis

    def predict(self, theta: Array) -> Prediction:
        """Prediction at theta (m, n - k)."""
        return self.forward.predict(self._whole(theta))

    def jacobian(self, theta: Array) -> Jacobian:
        """Derivatives at theta (m, n - k) by its own columns."""
        slope = self.forward.jacobian(self._whole(theta))
        n = theta.shape[1]
        weights = None if slope.weights is None else slope.weights[..., :n]
        return Jacobian(slope.force[..., :n], weights)

    def _whole(self, theta: Array) -> Array:
        return np.column_stack(
            [theta, np.broadcast_to(self.values, (len(theta), self.values.size))]
        )


def _corrected(basis: FieldBasis, correction: MeshCorrection) -> tuple[FieldBasis, Array | None]:
    """The basis with a correction, and (d, k) weights by how far the inputs are from its place.

    What the slopes of the correction have in common with the modes goes into the weights of these;
    the rest are modes of their own, so that no mode is zero or a sum of others.
    """
    assert basis.modes is not None
    offset = basis.offset + correction.field
    if correction.slopes is None:
        return replace(basis, offset=offset), None
    slopes = correction.field_slopes.reshape(len(correction.field_slopes), -1)
    flat = basis.modes.reshape(len(basis.modes), -1)
    within = np.asarray(np.linalg.lstsq(flat.T, slopes.T, rcond=None)[0].T, dtype=np.float64)
    left, size, rest = np.linalg.svd(slopes - within @ flat, full_matrices=False)
    kept = size > NEGLIGIBLE * np.linalg.norm(slopes)
    own = rest[kept].reshape(-1, *offset.shape)
    by_away = np.hstack([within, left[:, kept] * size[kept]])
    return replace(basis, offset=offset, modes=np.concatenate([basis.modes, own])), by_away


def _emulator_basis(scaled: ScaledEmulator) -> FieldBasis:
    emulator = scaled.emulator
    shape = emulator.field_shape
    if shape is None:
        raise ValueError("with_field: the emulator was trained on forces only; train with fields")
    return FieldBasis(
        offset=emulator.field_offset.reshape(shape),
        modes=np.ascontiguousarray(emulator.field_modes.T).reshape(-1, *shape),
        truncation=np.ascontiguousarray(emulator.field_truncation_factor.T).reshape(-1, *shape),
    )


class DirectForward:
    """The FE model itself: exact up to its mesh, no covariance of its own; `correction` as above.

    `simulate` maps ratios (d,), and further unknowns of the model, to the `Response` at kappa =
    1 MPa with its gradients in the same. Runs are remembered by
    ratios: the force is kappa times that at 1 MPa and the field does not depend on kappa, so
    one run serves every kappa. A run that did not reach every travel predicts NaN.
    """

    def __init__(
        self,
        simulate: Callable[[Array], Response],
        *,
        with_field: bool = False,
        correction: MeshCorrection | None = None,
    ) -> None:
        self._simulate = simulate
        self._correction = correction
        self._with_field = with_field
        self._runs: dict[bytes, Response] = {}
        self._basis: FieldBasis | None = None

    @property
    def n_solves(self) -> int:
        """Number of simulations run so far."""
        return len(self._runs)

    @property
    def solved(self) -> Array:
        """(k, d) inputs of the simulations that reached every travel, in the order of solving."""
        good = [key for key, run in self._runs.items() if np.isfinite(run.force).all()]
        rows: Array = np.array([np.frombuffer(key) for key in good])
        return rows

    @property
    def field_basis(self) -> FieldBasis | None:
        """Identity basis once a run has shown the field's shape; None for forces only."""
        return self._basis

    def response(self, ratios: Array) -> Response:
        """The run at ratios (d,), from memory when it was made before."""
        key = np.ascontiguousarray(ratios, dtype=np.float64).tobytes()
        if key not in self._runs:
            run = self._simulate(np.array(ratios, dtype=np.float64))
            at = np.asarray(ratios, dtype=np.float64)
            correction = self._correction
            self._runs[key] = run if correction is None else correction.response(run, at)
        response = self._runs[key]
        if self._with_field and self._basis is None:
            shape = response.displacement.shape
            self._basis = identity_basis(shape)
        return response

    def predict(self, theta: Array) -> Prediction:
        """Forces and, if asked for, fields at theta (m, n); one simulation for all new ratios."""
        runs = [self.response(ratios) for ratios in theta[:, 1:]]
        force = theta[:, :1] * np.array([run.force for run in runs])
        if not self._with_field:
            return Prediction(force, None)
        return Prediction(force, None, np.array([run.displacement.ravel() for run in runs]))

    def jacobian(self, theta: Array) -> Jacobian:
        """Exact sensitivities of the simulation, converted to x = (ln kappa, ...)."""
        runs = [self.response(ratios) for ratios in theta[:, 1:]]
        kappa = theta[:, 0, None]
        force = np.array([run.force for run in runs])
        gradient = np.array([run.force_gradient for run in runs])
        by_x = np.concatenate([force[:, :, None], gradient], axis=2) * kappa[:, :, None]
        if not self._with_field:
            return Jacobian(by_x)
        slopes = np.array(
            [run.displacement_gradient.reshape(-1, theta.shape[1] - 1) for run in runs]
        )
        return Jacobian(by_x, np.concatenate([np.zeros_like(slopes[:, :, :1]), slopes], axis=2))
