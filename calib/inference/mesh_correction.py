"""Takes the predictions of one mesh to those of a finer one, as measured where both ran."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fe.response import Array, Response


@dataclass(frozen=True)
class CorrectionSlopes:
    """How the correction of a field changes with the inputs of the model."""

    place: Array
    """(d,) inputs at which it was measured"""
    reach: Array
    """(d,) how far from there its derivatives are followed, beyond which it stays as it is"""
    field: Array
    """(n_step, n_point, 3, d) derivatives of what is added to the displacement, mm"""


@dataclass(frozen=True)
class MeshCorrection:
    """Takes the predictions of one mesh to those of a finer one, as measured where both ran.

    The field to first order in the inputs, up to a reach, where the derivatives of both are known.
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

    def away(self, inputs: Array) -> tuple[Array, Array]:
        """(m, d) how far inputs (m, d) are away, and derivatives of each by its own input.

        reach tanh(distance / reach): derivatives say nothing of what is far. d = 0 without slopes.
        """
        if self.slopes is None:
            return np.zeros((len(inputs), 0)), np.zeros((len(inputs), 0))
        reach = self.slopes.reach
        share = np.tanh((inputs[:, : reach.size] - self.slopes.place) / reach)
        return reach * share, 1.0 - share**2

    def response(self, response: Response, inputs: Array) -> Response:
        """A run on the coarser mesh at inputs (d,), corrected."""
        away, slope = (each[0] for each in self.away(inputs[None]))
        slopes = self.field_slopes
        gradient = response.displacement_gradient
        if len(slopes):
            gradient = gradient + np.moveaxis(slopes, 0, -1) * slope
        return replace(
            response,
            force=response.force * self.force,
            force_gradient=response.force_gradient * self.force[:, None],
            displacement=response.displacement + self.field + np.tensordot(away, slopes, 1),
            displacement_gradient=gradient,
        )
