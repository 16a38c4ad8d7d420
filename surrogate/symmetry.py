"""Scale symmetry: forces are proportional to kappa, fields do not depend on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surrogate.emulator import Emulator
from surrogate.gp import Array


@dataclass(frozen=True)
class ScaledEmulator:
    """Emulator over theta = (kappa, r, s), exact in kappa [MPa].

    With prescribed displacements, a law linear in its stress-like constants and contact without
    a stress scale of its own, force = kappa F1(r, s) and the field depends on (r, s) only. So the
    force has mean kappa E F1 and covariance kappa^2 cov F1.
    """

    emulator: Emulator

    def force(self, theta: Array) -> tuple[Array, Array]:
        """Mean (m, n_step) N and covariance (m, n_step, n_step) N^2 of the whole sample's force.

        `theta` (m, 1 + d): kappa in MPa > 0, then the ratios. Raises ValueError otherwise.
        """
        kappa, ratios = self._split(theta)
        mean, covariance = self.emulator.unit_force(ratios)
        return kappa * mean, (kappa**2)[:, :, None] * covariance

    def force_jacobian(self, theta: Array) -> Array:
        """(m, n_step, 1 + d) derivative of the mean force by theta: N/MPa, then N."""
        kappa, ratios = self._split(theta)
        at_unit, _ = self.emulator.unit_force(ratios)
        by_ratios = kappa[:, :, None] * self.emulator.unit_force_gradient(ratios)
        return np.concatenate([at_unit[:, :, None], by_ratios], axis=2)

    def field_weights(self, theta: Array) -> tuple[Array, Array]:
        """Mean (m, k) mm and variance (m, k) mm^2 of the field's weights."""
        return self.emulator.field_weights(self._split(theta)[1])

    def field_weights_jacobian(self, theta: Array) -> Array:
        """(m, k, 1 + d) derivative of the mean weights by theta; zero by kappa."""
        gradient = self.emulator.field_weights_gradient(self._split(theta)[1])
        return np.concatenate([np.zeros_like(gradient[:, :, :1]), gradient], axis=2)

    def _split(self, theta: Array) -> tuple[Array, Array]:
        theta = np.asarray(theta, dtype=np.float64)
        n = 1 + len(self.emulator.force.processes.low)
        if theta.ndim != 2 or theta.shape[1] != n:
            raise ValueError(f"theta: expected shape (m, {n}), got {theta.shape}")
        wrong = ~((theta[:, 0] > 0.0) & np.isfinite(theta[:, 0]))
        if wrong.any():
            raise ValueError(
                f"theta: kappa must be positive and finite (MPa), got {theta[wrong, 0][0]:.6g}"
            )
        return theta[:, :1], theta[:, 1:]
