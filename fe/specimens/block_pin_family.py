"""A block under a pin at any row of a campaign's design: material, contact and geometry vary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from fe.campaign_parameters import RATIOS, Parameter, checked_theta
from fe.fingerprint import NO_PHYSICS
from fe.response import Response
from fe.specimens.block_pin import BlockPinModel
from fe.specimens.block_pin_geometry import Interface

Array = npt.NDArray[np.float64]

FAMILY = {
    parameter.name: parameter
    for parameter in (
        *RATIOS,
        Parameter("bulk", "1", "material"),
        Parameter("friction", "1", "contact"),
        Parameter("height", "mm", "geometry"),
        Parameter("fillet", "mm", "geometry"),
        Parameter("pin", "1", "factor", ("bar", "round")),
        Parameter("contact", "1", "factor", ("stick", "slide")),
    )
}
"""All that may vary.

r, s: C01 and C11 over kappa. bulk: bulk modulus over the shear modulus 2 kappa. friction:
coefficient on pin and base, where they do not stick. contact: whether both stick or both slide,
with `friction` where it is a parameter too and without friction else.
"""

_SOURCES = {
    "r": ("r",),
    "s": ("s",),
    "bulk": ("bulk_ratio",),
    "friction": ("friction_pin", "friction_base"),
    "height": ("height",),
    "fillet": ("pin_fillet",),
}
"""what of the model goes with a continuous parameter, one to one"""
_PINS: dict[str, Literal["bar", "round"]] = {"bar": "bar", "round": "round"}


@dataclass(frozen=True)
class BlockPinFamily:
    """Simulation of block and pin as a function of named parameters; picklable, one thread.

    What is no parameter is as in `template`; r and s are then 0. A parameter may have fewer levels
    than in `FAMILY`, or in another order. Field points given by their numbers are at the same
    shares of width and height of every block, so that they move with its height; those given in mm
    stay where they are, and no block may be lower than the highest.

    Raises ValueError for parameters that are not in `FAMILY`, and for `friction` where the template
    sticks to pin and base and `contact` is no parameter.
    """

    template: BlockPinModel
    parameters: tuple[Parameter, ...] = field(default=RATIOS, metadata=NO_PHYSICS)
    """columns of a design; a campaign knows a run by those of its row, so that other levels or
    another order of them runs no point anew"""

    def __post_init__(self) -> None:
        for parameter in self.parameters:
            known = FAMILY.get(parameter.name)
            if known is None:
                raise ValueError(
                    f"parameters: expected {', '.join(FAMILY)}, found {parameter.name!r}"
                )
            fits = set(parameter.levels) <= set(known.levels)
            if (
                parameter.unit != known.unit
                or not fits
                or bool(parameter.levels) != bool(known.levels)
            ):
                raise ValueError(
                    f"parameters: expected {known.name} in {known.unit!r} with the levels "
                    f"{known.levels}, found {parameter.unit!r} with {parameter.levels}"
                )
        names = [parameter.name for parameter in self.parameters]
        contact = self.template.contact
        if (
            "friction" in names
            and "contact" not in names
            and contact.pin == contact.base == "stick"
        ):
            raise ValueError(
                "parameters: found friction of a block that sticks to pin and base, expected a "
                "template that slides somewhere, or the parameter contact"
            )

    @property
    def force(self) -> tuple[float, ...]:
        """Asked of every block, N; a campaign takes none, as its runs share travels."""
        return self.template.force

    def __call__(self, theta: Array) -> Response:
        """Response at kappa = 1 MPa for a row (d,) of a design, as of `BlockPinModel`.

        Gradients are in the continuous parameters, those of them that the model of the row has
        sensitivities in, or else in what the template asks for. A solver failure is a status, not a
        raise. Raises ValueError for a row that is no block, pin or material.
        """
        values = self._values(theta)
        ratios = np.array([values.get("r", 0.0), values.get("s", 0.0)])
        model = self.model(theta)
        return self._named(model, model(ratios))

    def check_rows(self, theta: Array) -> None:
        """Raise ValueError, naming the row, for one of theta (n, d) that is no block or pin."""
        for row, values in enumerate(theta):
            try:
                self.model(values)
            except ValueError as error:
                raise ValueError(f"theta: row {row}: {error}") from error

    def model(self, theta: Array) -> BlockPinModel:
        """The simulation of one row (d,) of a design; raises as `__call__` does."""
        values = self._values(theta)
        levels = {p.name: p.level(values[p.name]) for p in self.parameters if p.levels}
        template, specimen = self.template, self.template.specimen
        model = replace(
            template,
            specimen=replace(
                specimen,
                height=values.get("height", specimen.height),
                pin_fillet=values.get("fillet", specimen.pin_fillet),
                pin=_PINS[levels["pin"]] if "pin" in levels else specimen.pin,
            ),
            contact=replace(
                template.contact,
                pin=_interface(template.contact.pin, values, levels),
                base=_interface(template.contact.base, values, levels),
            ),
            bulk_ratio=values.get("bulk", template.bulk_ratio),
        )
        if template.sensitivities is not None:
            return model
        known = model.parameter_names()
        asked = [n for p in self.parameters for n in _SOURCES.get(p.name, ()) if n in known]
        return replace(model, sensitivities=tuple(asked))

    def _named(self, model: BlockPinModel, response: Response) -> Response:
        """The response with gradients by the names of the parameters, by the chain rule."""
        found = list(response.parameters)
        known = model.parameter_names()
        columns: dict[str, list[int]] = {}
        for parameter in self.parameters:
            sources = [name for name in _SOURCES.get(parameter.name, ()) if name in known]
            if sources and set(sources) <= set(found):
                columns[parameter.name] = [found.index(name) for name in sources]
        used = {index for indices in columns.values() for index in indices}
        columns |= {name: [i] for i, name in enumerate(found) if i not in used}

        def chained(gradient: Array) -> Array:
            parts = [gradient[..., indices].sum(axis=-1) for indices in columns.values()]
            return np.stack(parts, axis=-1) if parts else gradient

        return replace(
            response,
            force_gradient=chained(response.force_gradient),
            displacement_gradient=chained(response.displacement_gradient),
            parameters=tuple(columns),
        )

    def _values(self, theta: Array) -> dict[str, float]:
        [row] = checked_theta(np.asarray(theta, dtype=np.float64)[None], self.parameters)
        return dict(zip((p.name for p in self.parameters), row.tolist(), strict=True))


def _interface(
    given: Interface, values: Mapping[str, float], levels: Mapping[str, str]
) -> Interface:
    """What pin or base does to the surface, in a template where it does as `given`."""
    contact = levels.get("contact")
    sticks = given == "stick" if contact is None else contact == "stick"
    if sticks:
        return "stick"
    if "friction" in values:
        return values["friction"]
    return "slide" if contact == "slide" else given
