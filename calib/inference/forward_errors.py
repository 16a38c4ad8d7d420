"""The direct model with the errors of the emulator, so that both have the same posterior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.inference.forward import DirectForward, FieldBasis, ForwardModel, Jacobian, Prediction
from fe.response import Array


class DirectWithErrors:
    """Means of the direct model, covariances that the emulator states at the same theta.

    The direct model has no emulator error. Its posterior would then be another one than the
    emulator's, narrower and without the covariance's own slope, and the difference of the two
    maxima would not be the emulator's error alone.
    """

    def __init__(self, direct: DirectForward, emulator: ForwardModel) -> None:
        self._direct = direct
        self._emulator = emulator
        self._basis: FieldBasis | None = None

    @property
    def field_basis(self) -> FieldBasis | None:
        """Identity basis with the emulator's truncation; None before the first run."""
        direct, emulator = self._direct.field_basis, self._emulator.field_basis
        if self._basis is None and direct is not None and emulator is not None:
            self._basis = replace(direct, truncation=emulator.truncation)
        return self._basis

    def predict(self, theta: Array) -> Prediction:
        """Direct means at theta (m, n) with the emulator's covariances there."""
        mean, stated = self._direct.predict(theta), self._emulator.predict(theta)
        factor, variance = None, stated.weight_variance
        basis = self._emulator.field_basis
        if variance is not None and basis is not None and basis.modes is not None:
            factor = np.sqrt(variance)[:, :, None, None, None] * basis.modes
        return replace(mean, force_covariance=stated.force_covariance, field_factor=factor)

    def jacobian(self, theta: Array) -> Jacobian:
        """Derivatives of the direct means."""
        return self._direct.jacobian(theta)
