"""A block in uniaxial compression, solved in closed form: a stand-in for the FE model in tests.

It takes milliseconds, has exact sensitivities and a known mesh error, and answers in the same form
as the FE model, so that a study can be run end to end in seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.study.config import Study
from calib.study.sections import Cells, Hypothesis
from fe.response import Array, Response, Status


@dataclass(frozen=True)
class AnalyticBlock:
    """Uniform compression of a Mooney-Rivlin block; `stiffening` stands in for friction."""

    area: float
    """mm^2"""
    height: float
    """mm"""
    stiffening: float
    """force is multiplied by 1 + stiffening * (travel / height)^2"""
    cells: Cells
    travel: tuple[float, ...]
    stops_above: float = np.inf
    """ratio s above which the run stops before the last travel"""

    @property
    def mesh_factor(self) -> float:
        """The stand-in's mesh makes forces this much too large."""
        return 1.0 + 0.1 / min(self.cells) ** 2

    def points(self) -> Array:
        """(12, 2) reference points, mm."""
        x, y = np.meshgrid(np.linspace(0.5, 4.5, 4), np.linspace(0.5, 2.0, 3), indexing="ij")
        return np.stack([x.ravel(), y.ravel()], axis=1)

    def __call__(self, ratios: Array) -> Response:
        r, s = (float(value) for value in ratios)
        travel = np.asarray(self.travel)
        first, second, third = self._stress_terms(1.0 - travel / self.height)
        factor = self.area * self.mesh_factor * (1 + self.stiffening * (travel / self.height) ** 2)
        force = factor * ((1 - r) * first + r * second + s * third)
        gradient = factor[:, None] * np.stack([second - first, third], axis=1)
        shape = self._field_shape(travel)
        slopes = np.array([0.2, 0.1])
        reached = s <= self.stops_above
        response = Response(
            travel=travel,
            force=force,
            displacement=shape * (1 + slopes @ (r, s)) * self.mesh_factor**0.1,
            force_gradient=gradient,
            displacement_gradient=shape[..., None] * slopes * self.mesh_factor**0.1,
            reached=float(travel[-1] if reached else travel[0]),
            status=Status.CONVERGED if reached else Status.STOPPED,
            message="closed form" if reached else "made to stop",
            negative_pivots=np.zeros(travel.size, dtype=np.int64),
            n_factorisations=0,
            seconds=0.0,
        )
        if not reached:
            response.force[1:] = np.nan
            response.displacement[1:] = np.nan
        return response

    def _stress_terms(self, stretch: Array) -> tuple[Array, Array, Array]:
        """Compressive engineering stress per unit C10, C01 and C11 (each (n_step,))."""
        first, second = stretch**2 + 2 / stretch, 2 * stretch + stretch**-2.0
        by_first, by_second = 2 * stretch - 2 * stretch**-2.0, 2 - 2 * stretch**-3.0
        mixed = (first - 3) * by_second + (second - 3) * by_first
        return -by_first, -by_second, -mixed

    def _field_shape(self, travel: Array) -> Array:
        """(n_step, n_point, 3) mm."""
        x, y = self.points().T
        unit = np.stack([0.1 * x, -0.4 * y, 0.3 * y * (2.5 - y)], axis=1)
        return travel[:, None, None] * unit * (1 + 0.1 * travel[:, None, None])


def analytic_block(study: Study, hypothesis: Hypothesis, cells: Cells) -> AnalyticBlock:
    """The stand-in for one hypothesis of a study; a `simulate_factory` for `run_study`."""
    sticks = (hypothesis.pin == "stick") + (hypothesis.base == "stick")
    # Height and factors with which both hypotheses follow the forces of the thesis to some 3 %.
    return AnalyticBlock(
        area=study.geometry.depth * study.geometry.pin_width,
        height=1.08 * study.height(hypothesis),
        stiffening=-0.8 + 0.15 * sticks,
        cells=cells,
        travel=study.increments,
    )
