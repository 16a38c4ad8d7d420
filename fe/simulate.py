"""One door to all specimens: `simulate(specimen, material, theta)`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
import numpy.typing as npt

from fe.materials.law import LAWS, Law
from fe.materials.material import Material, material
from fe.materials.volumetric import Volumetric
from fe.positive_numbers import as_numbers, is_number
from fe.progress import Progress
from fe.response import Response

Array = npt.NDArray[np.float64]


class Specimen(Protocol):
    """A model that responds to any material, as all of `fe.specimens` do."""

    def respond(self, material: Material, progress: Progress | None = None) -> Response:
        """Response with gradients in the constants and the bulk modulus.

        `progress` is called after each step of the solver.
        """
        ...


def simulate(
    specimen: Specimen,
    law: Law | str,
    theta: Mapping[str, float] | npt.ArrayLike,
    volumetric: Volumetric = "quadratic",
    progress: Progress | None = None,
) -> Response:
    """Response of a specimen of one material; a solver failure is a status, not a raise.

    `theta` holds the constants of the law and its bulk modulus, by name ("C10", ..., "bulk") or in
    that order, MPa.  Gradients are in the same numbers.  `progress` is called with a `StepReport`
    after each step of the solver, asked for or not: `progress=print` shows them.  The logger "fe"
    has the same lines at level info.

    Raises ValueError for what is no model, for an unknown law, names or numbers that are not those
    of the law, and what `fe.materials.Material` refuses.
    """
    if isinstance(specimen, type) or not hasattr(specimen, "respond"):
        raise ValueError(
            f"specimen: found {specimen!r}, expected a model that is meshed and loaded, such as "
            "BlockPinModel(BlockPin(), ...)"
        )
    if progress is not None and not callable(progress):
        raise ValueError(f"progress: expected a function, such as print, found {progress!r}")
    name = law.name if isinstance(law, Law) else law
    return specimen.respond(_material(name, theta, volumetric), progress)


def _material(
    law: str, theta: Mapping[str, float] | npt.ArrayLike, volumetric: Volumetric
) -> Material:
    if isinstance(law, Material):
        raise ValueError(
            f"law: expected a name, such as {law.law.name!r}, whose constants are theta, found a "
            "whole Material, which specimen.respond(material) takes"
        )
    if not isinstance(law, str) or law not in LAWS:
        raise ValueError(f"law: expected one of {', '.join(LAWS)}, found {law!r}")
    names = (*LAWS[law].constant_names, "bulk")
    if isinstance(theta, Mapping):
        if set(theta) != set(names):
            found = ", ".join(map(str, theta))
            raise ValueError(f"theta: expected {', '.join(names)}, found {found}")
        values = [_number(n, theta[n]) for n in names]
    else:
        array = as_numbers(theta)
        if array is None:
            raise ValueError(
                f"theta: expected {len(names)} numbers ({', '.join(names)}), found {theta!r}"
            )
        if array.shape != (len(names),):
            raise ValueError(
                f"theta: expected {len(names)} numbers ({', '.join(names)}), "
                f"found shape {array.shape}"
            )
        values = array.tolist()
    return material(law, values[:-1], values[-1], volumetric)


def _number(name: str, value: object) -> float:
    if is_number(value):
        return float(value)
    raise ValueError(f"theta: expected a number of MPa for {name}, found {value!r}")
