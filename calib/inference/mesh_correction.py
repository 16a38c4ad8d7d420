"""Takes the predictions of one mesh to those of a finer one, as measured where both ran."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fe.response import Array, Response


@dataclass(frozen=True)
class CorrectionSlopes:
    """How a correction changes with the inputs of the model: kappa, which is exact, is none."""

    place: Array
    """(d,) inputs at which the correction was measured"""
    log_force: Array
    """(n_step, d) derivatives of the logarithm of the force's factor"""
    field: Array
    """(n_step, n_point, 3, d) derivatives of what is added to the displacement, mm"""


@dataclass(frozen=True)
class MeshCorrection:
    """Takes the predictions of one mesh to those of a finer one, as measured where both ran.

    To first order in the inputs where the derivatives of both are known, else the same everywhere.
    """

    force: Array
    """(n_step,) factor of the force"""
    field: Array
    """(n_step, n_point, 3) added to the displacement, mm"""
    slopes: CorrectionSlopes | None = None

    @property
    def field_slopes(self) -> Array:
        """(d, n_step, n_point, 3) derivatives of what is added to the field, mm; d = 0 for none."""
        if self.slopes is None:
            return np.zeros((0, *self.field.shape))
        return np.ascontiguousarray(np.moveaxis(self.slopes.field, -1, 0))

    def away(self, inputs: Array) -> Array:
        """(m, d) inputs (m, d) minus those at which it was measured; d = 0 without slopes."""
        if self.slopes is None:
            return np.zeros((len(inputs), 0))
        return inputs[:, : self.slopes.place.size] - self.slopes.place

    def factor(self, inputs: Array) -> Array:
        """(m, n_step) factor of the force at inputs (m, d)."""
        if self.slopes is None:
            return np.broadcast_to(self.force, (len(inputs), self.force.size))
        found: Array = self.force * np.exp(self.away(inputs) @ self.slopes.log_force.T)
        return found

    def force_slope(self, inputs: Array, force: Array, gradient: Array) -> Array:
        """(m, n_step, d) derivatives of corrected forces, of forces (m, n_step) and theirs."""
        if self.slopes is not None:
            gradient = gradient + force[:, :, None] * self.slopes.log_force
        return self.factor(inputs)[:, :, None] * gradient

    def response(self, response: Response, inputs: Array) -> Response:
        """A run on the coarser mesh at inputs (d,), corrected."""
        at = inputs[None]
        force, gradient = response.force[None], response.force_gradient[None]
        away, slopes = self.away(at)[0], self.field_slopes
        return replace(
            response,
            force=response.force * self.factor(at)[0],
            force_gradient=self.force_slope(at, force, gradient)[0],
            displacement=response.displacement + self.field + np.tensordot(away, slopes, 1),
            displacement_gradient=response.displacement_gradient + np.moveaxis(slopes, 0, -1)
            if len(slopes)
            else response.displacement_gradient,
        )
