"""Block and pin as a function of everything that a study leaves unknown of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.inference.laws import LawCoordinates
from calib.study.unknowns import FRICTION, INPUTS
from fe.materials import material
from fe.response import Array, Response
from fe.specimens.block_pin import BlockPinModel

_DIMENSIONS = {"height": "height", "fillet": "pin_fillet", "pin_width": "pin_width"}
"""inputs that are lengths of the specimen"""


@dataclass(frozen=True)
class VariedBlock:
    """The FE model at kappa = 1 MPa over ratios of a law and further unknowns.

    It takes coordinates: the ratios, then the `inputs` (of the bulk ratio its logarithm). What
    is no input is as in `template`. Picklable, one thread.
    """

    template: BlockPinModel
    law: str
    inputs: tuple[str, ...] = ()

    def points(self) -> Array:
        """(n_point, 2) reference x, y of the field points, mm."""
        return self.template.points()

    def __call__(self, ratios: Array) -> Response:
        """Response with gradients by the coordinates, named as the columns of the design.

        Where the FE model has no derivative, as in a friction of 0, the column is NaN. A solver
        failure is a status, not a raise.
        """
        coordinates = LawCoordinates(self.law)
        n = len(coordinates.ratios)
        own = np.asarray(ratios[:n], dtype=np.float64)
        model = self._model(self._values(ratios[n:]))
        constants = [float(value) for value in coordinates.at_unit(own)]
        of = material(self.law, constants, 2.0 * model.bulk_ratio)
        known = model.parameter_names(of)
        columns = {
            name: {source: slope for source, slope in terms.items() if source in known}
            for name, terms in self._columns(coordinates, own, model)
        }
        sources = tuple(dict.fromkeys(source for terms in columns.values() for source in terms))
        found = replace(model, sensitivities=sources).respond(of)
        slopes = np.array(
            [[terms.get(source, 0.0) for source in sources] for terms in columns.values()]
        )
        without = [not terms for terms in columns.values()]

        def by_coordinates(gradient: Array) -> Array:
            by_columns: Array = gradient @ slopes.T
            by_columns[..., without] = np.nan
            return by_columns

        return replace(
            found,
            force_gradient=by_coordinates(found.force_gradient),
            displacement_gradient=by_coordinates(found.displacement_gradient),
            parameters=tuple(columns),
        )

    def _values(self, row: Array) -> dict[str, float]:
        pairs = zip(self.inputs, row, strict=True)
        return {name: float(INPUTS[name][0].value(np.asarray(x))) for name, x in pairs}

    def _model(self, values: dict[str, float]) -> BlockPinModel:
        """The template with these values of the inputs."""
        template = self.template
        specimen = template.specimen
        specimen = replace(
            specimen,
            height=values.get("height", specimen.height),
            pin_fillet=values.get("fillet", specimen.pin_fillet),
            pin_width=values.get("pin_width", specimen.pin_width),
            pin_shift=(values.get("pin_shift", specimen.pin_shift[0]), specimen.pin_shift[1]),
        )
        contact = template.contact
        for name, sides in FRICTION.items():
            for side in sides:
                if name in values and not isinstance(getattr(contact, side), str):
                    contact = replace(contact, **{side: values[name]})
        return replace(
            template,
            specimen=specimen,
            contact=contact,
            bulk_ratio=values.get("bulk_ratio", template.bulk_ratio),
        )

    def _columns(
        self, coordinates: LawCoordinates, ratios: Array, model: BlockPinModel
    ) -> Iterator[tuple[str, dict[str, float]]]:
        """Each coordinate with the FE model's own parameters that it changes, and how fast."""
        names = coordinates.law.constant_names
        for ratio, slope in zip(coordinates.ratios, coordinates.slopes(ratios), strict=True):
            terms = zip(names, slope.tolist(), strict=True)
            yield ratio.name, {name: value for name, value in terms if value != 0.0}
        for name in self.inputs:
            yield INPUTS[name][0].x_name, self._terms(name, model)

    def _terms(self, name: str, model: BlockPinModel) -> dict[str, float]:
        if name == "bulk_ratio":  # bulk = 2 kappa bulk_ratio, by its logarithm
            return {"bulk": 2.0 * model.bulk_ratio}
        if name == "pin_shift":
            return {"pin_shift_x": 1.0}
        if name in FRICTION:
            return {f"friction_{side}": 1.0 for side in FRICTION[name]}
        return {_DIMENSIONS[name]: 1.0}
