"""The emulator corrected to value and gradient of the direct model at one point."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.inference.coordinates import theta_of, x_of
from calib.inference.forward import (
    DirectForward,
    FieldBasis,
    ForwardModel,
    Jacobian,
    Prediction,
)
from fe.response import Array


@dataclass(frozen=True)
class CorrectedForward:
    """Emulator mean plus a first-order correction about `centre`, with the emulator's errors.

    The correction adds to ln force, so that forces stay positive and stay proportional to kappa,
    and to the displacement.
    """

    emulator: ForwardModel
    centre: Array
    """(n,) x at which value and gradient agree with the direct model"""
    log_offset: Array
    """(n_step,) ln(direct / emulator) at the centre"""
    log_slope: Array
    """(n_step, n) its derivative by x"""
    basis: FieldBasis | None
    """the emulator's modes and the correction's n + 1 fields"""

    @property
    def field_basis(self) -> FieldBasis | None:
        """Modes of the emulator, then the correction at the centre and its slopes by x."""
        return self.basis

    def predict(self, theta: Array) -> Prediction:
        """Corrected means at theta (m, n)."""
        mean = self.emulator.predict(theta)
        off = x_of(theta) - self.centre
        factor = np.exp(self.log_offset + off @ self.log_slope.T)
        if self.basis is None or mean.weights is None:
            return Prediction(mean.force * factor, mean.force_covariance)
        weights = np.column_stack([mean.weights, np.ones(len(off)), off])
        variance = mean.weight_variance
        if variance is not None:
            # The fields of the correction are known.
            known = np.zeros((len(off), 1 + off.shape[1]))
            variance = np.column_stack([variance, known])
        return Prediction(mean.force * factor, mean.force_covariance, weights, variance)

    def jacobian(self, theta: Array) -> Jacobian:
        """Derivatives of the corrected means by x."""
        mean, slope = self.emulator.predict(theta), self.emulator.jacobian(theta)
        factor = np.exp(self.log_offset + (x_of(theta) - self.centre) @ self.log_slope.T)
        force = factor[:, :, None] * (slope.force + mean.force[:, :, None] * self.log_slope)
        if self.basis is None or slope.weights is None:
            return Jacobian(force)
        n = theta.shape[1]
        extra = np.vstack([np.zeros((1, n)), np.eye(n)])
        extra = np.broadcast_to(extra, (len(theta), n + 1, n))
        return Jacobian(force, np.concatenate([slope.weights, extra], axis=1))


def correct(emulator: ForwardModel, direct: DirectForward, x: Array) -> CorrectedForward:
    """Correct `emulator` to `direct` at x (n,), where the direct model must have been solved.

    To its values alone where it does not know its slopes.

    Raises ValueError where either predicts a force that is not positive: its logarithm is
    corrected, and nothing in an emulator of forces keeps them positive.
    """
    theta = theta_of(x)[None]
    mean, slope = emulator.predict(theta), emulator.jacobian(theta)
    exact, exact_slope = direct.predict(theta), direct.jacobian(theta)
    _check_positive("emulator", mean.force, x, "train it with more runs around there")
    _check_positive("direct", exact.force, x, "the pin must press on the block")
    log_slope = exact_slope.force / exact.force[:, :, None] - slope.force / mean.force[:, :, None]
    known = has_slope(exact_slope)
    if not known:
        log_slope = np.zeros_like(log_slope)
    return CorrectedForward(
        emulator=emulator,
        centre=x,
        log_offset=np.log(exact.force[0] / mean.force[0]),
        log_slope=log_slope[0],
        basis=_basis(emulator.field_basis, mean, slope, exact, exact_slope if known else None),
    )


def has_slope(slope: Jacobian) -> bool:
    """Whether the direct model knows its derivatives: with friction its solver may miss them."""
    known = np.isfinite(slope.force).all()
    return bool(known and (slope.weights is None or np.isfinite(slope.weights).all()))


def without_slope(corrected: CorrectedForward) -> CorrectedForward:
    """The correction of the forces' values alone: the slopes are the emulator's again."""
    return replace(corrected, log_slope=np.zeros_like(corrected.log_slope))


def with_secant(
    corrected: CorrectedForward, force: Array, x: Array, scale: Array
) -> CorrectedForward:
    """The correction whose slopes are changed least so that it meets `force` (n_step,) N at x (n,).

    Broyden's update in coordinates of `scale` (n,), e.g. posterior SDs. FE forces are rough on a
    small scale (contact points come and go), so a slope taken at one point may mislead over a step.
    """
    predicted = corrected.predict(theta_of(x)[None]).force[0]
    step = x - corrected.centre
    direction = step / scale**2
    if not step @ direction > 0.0:  # at the centre a value says nothing of slopes
        return corrected
    change = np.outer(np.log(force / predicted), direction / (step @ direction))
    return replace(corrected, log_slope=corrected.log_slope + change)


def _check_positive(name: str, force: Array, x: Array, remedy: str) -> None:
    if not (force > 0.0).all():
        raise ValueError(
            f"{name}: forces must be positive to be corrected, got {np.min(force):.6g} N at "
            f"x = {x}; {remedy}"
        )


def _basis(
    basis: FieldBasis | None,
    mean: Prediction,
    slope: Jacobian,
    exact: Prediction,
    exact_slope: Jacobian | None,
) -> FieldBasis | None:
    """Emulator's modes with the difference of the fields and of their slopes as further modes."""
    if basis is None or exact.weights is None:
        return None
    if basis.modes is None or mean.weights is None or slope.weights is None:
        raise ValueError("emulator: must give its field in modes to be corrected")
    shape = basis.offset.shape
    value = exact.weights.reshape(1, *shape) - basis.fields(mean.weights)
    n = slope.force.shape[-1]
    difference = np.zeros((n, *shape))
    if exact_slope is not None and exact_slope.weights is not None:
        by_x = exact_slope.weights[0].T.reshape(n, *shape)
        difference = by_x - np.tensordot(slope.weights[0].T, basis.modes, axes=1)
    modes = np.concatenate([basis.modes, value, difference])
    return FieldBasis(basis.offset, modes, basis.truncation)
