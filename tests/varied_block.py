"""A block in uniaxial compression of any law, with further unknowns, for tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.inference.laws import LawCoordinates
from calib.study.config import Study
from calib.study.sections import Cells, Hypothesis
from calib.study.unknowns import inputs_of, law_of, parameters_of
from fe.response import Array, Response, Status

STEP = 1e-5


@dataclass(frozen=True)
class VariedStandIn:
    """Uniform compression; friction stiffens, a low bulk modulus softens. Gradients by differences.

    A row holds ratios of the law and then coordinates of the inputs.
    """

    law: str
    columns: tuple[str, ...]
    inputs: tuple[str, ...]
    height: float
    friction: float
    bulk_ratio: float
    cells: Cells
    travel: tuple[float, ...]

    def points(self) -> Array:
        """(12, 2) mm."""
        x, y = np.meshgrid(np.linspace(0.5, 4.5, 4), np.linspace(0.5, 2.0, 3), indexing="ij")
        return np.stack([x.ravel(), y.ravel()], axis=1)

    def __call__(self, ratios: Array) -> Response:
        row = np.asarray(ratios, dtype=np.float64)
        force, field = self._seen(row)
        sides = [
            [self._seen(row + sign * STEP * unit) for sign in (1.0, -1.0)]
            for unit in np.eye(row.size)
        ]
        slopes = [[(up[i] - down[i]) / (2.0 * STEP) for up, down in sides] for i in (0, 1)]
        travel = np.array(self.travel)
        return Response(
            travel=travel,
            force=force,
            displacement=field,
            force_gradient=np.stack(slopes[0], axis=-1),
            displacement_gradient=np.stack(slopes[1], axis=-1),
            reached=float(travel[-1]),
            status=Status.CONVERGED,
            message="closed form",
            negative_pivots=np.zeros(travel.size, dtype=np.int64),
            n_factorisations=0,
            seconds=0.0,
            parameters=self.columns,
        )

    def _seen(self, row: Array) -> tuple[Array, Array]:
        coordinates = LawCoordinates(self.law)
        n = len(coordinates.ratios)
        constants = [float(value) for value in coordinates.at_unit(row[:n])]
        values = dict(zip(self.inputs, row[n:].tolist(), strict=True))
        height = values.get("height", self.height)
        friction = values.get("friction", self.friction)
        bulk = np.exp(values.get("bulk_ratio", np.log(self.bulk_ratio)))
        travel = np.array(self.travel)
        depth = travel / (1.08 * height)
        factor = 40.0 * (1.0 + 0.1 / min(self.cells) ** 2) * (1.0 - 5.0 / bulk)
        force = factor * (1.0 + (friction - 0.8) * depth**2) * self._stress(1.0 - depth, constants)
        # Not linear in the ratios, as no force of the FE model is.
        force = force * (1.0 + 0.02 * np.sin(3.0 * row[:n].sum() + travel))
        x, y = self.points().T
        unit = np.stack([0.1 * x, -0.4 * y, 0.3 * y * (2.5 - y)], axis=1)
        shape = travel[:, None, None] * unit * (1.0 + 0.1 * travel[:, None, None])
        second = shape * np.array([1.0, -0.3, 0.5]) * np.cos(x)[:, None]
        sides = 1.0 + 0.2 * row[0] * (n > 0) - 0.3 * friction
        return force, shape * sides + 0.1 * (height / 2.5 - 1.0) * second

    def _stress(self, stretch: Array, constants: list[float]) -> Array:
        """Compressive engineering stress."""
        h = 1e-6

        def energy(lam: Array) -> Array:
            side = lam**-0.5
            if self.law.startswith("ogden"):
                pairs = zip(constants[::2], constants[1::2], strict=True)
                return sum(m / a * (lam**a + 2 * side**a - 3.0) for m, a in pairs)
            first, second = lam**2 + 2 / lam - 3, 2 * lam + lam**-2.0 - 3
            if self.law == "yeoh":
                return sum(c * first ** (i + 1) for i, c in enumerate(constants))
            c10, c01, c11 = (*constants, 0.0, 0.0)[:3]
            return c10 * first + c01 * second + c11 * first * second

        return -(energy(stretch + h) - energy(stretch - h)) / (2 * h)


def varied_stand_in(study: Study, hypothesis: Hypothesis, cells: Cells) -> VariedStandIn:
    """The stand-in for one hypothesis of a study; a `simulate_factory` for `run_study`."""
    return VariedStandIn(
        law=law_of(study, hypothesis).name,
        columns=tuple(parameter.name for parameter in parameters_of(study, hypothesis)),
        inputs=inputs_of(study, hypothesis),
        height=study.height(hypothesis),
        friction=0.0 if isinstance(hypothesis.pin, str) else hypothesis.pin,
        bulk_ratio=study.material.bulk_ratio,
        cells=cells,
        travel=study.increments,
    )
