"""One door to all specimens: `simulate(specimen, material, theta)`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from fe.materials.law import LAWS, MOONEY_RIVLIN_2, MOONEY_RIVLIN_3, NEO_HOOKEAN, Law
from fe.materials.material import Material, material
from fe.materials.volumetric import Volumetric
from fe.response import Response
from fe.specimens.block_pin import BlockPinModel

Array = npt.NDArray[np.float64]


class Specimen(Protocol):
    """A model that responds to any material, as those of tensile, uniaxial and cylinder do."""

    def respond(self, material: Material) -> Response:
        """Response with gradients in the constants and the bulk modulus."""
        ...


def simulate(
    specimen: Specimen | BlockPinModel,
    law: Law | str,
    theta: Mapping[str, float] | npt.ArrayLike,
    volumetric: Volumetric = "quadratic",
) -> Response:
    """Response of a specimen of one material; a solver failure is a status, not a raise.

    `theta` holds the constants of the law and its bulk modulus, by name ("C10", ..., "bulk") or in
    that order, MPa.  Gradients are in the same numbers; those of a block under a pin, which knows
    Mooney-Rivlin laws without C20 only, are in (r, s) at fixed kappa and bulk ratio.

    Raises ValueError for an unknown law, names or numbers that are not those of the law, what
    `fe.materials.Material` refuses and a law that the specimen does not know.
    """
    name = law if isinstance(law, str) else law.name
    made = _material(name, theta, volumetric)
    if isinstance(specimen, BlockPinModel):
        return _block_pin(specimen, made)
    return specimen.respond(made)


def _material(
    law: str, theta: Mapping[str, float] | npt.ArrayLike, volumetric: Volumetric
) -> Material:
    if law not in LAWS:
        raise ValueError(f"law: expected one of {', '.join(LAWS)}, found {law!r}")
    names = (*LAWS[law].constant_names, "bulk")
    if isinstance(theta, Mapping):
        if set(theta) != set(names):
            raise ValueError(f"theta: expected {', '.join(names)}, found {', '.join(theta)}")
        values = [float(theta[n]) for n in names]
    else:
        array = np.asarray(theta, dtype=np.float64)
        if array.shape != (len(names),):
            raise ValueError(
                f"theta: expected {len(names)} numbers ({', '.join(names)}), "
                f"found shape {array.shape}"
            )
        values = array.tolist()
    return material(law, values[:-1], values[-1], volumetric)


def _block_pin(model: BlockPinModel, made: Material) -> Response:
    """The block's own response at kappa = 1 MPa, scaled (fields do not depend on kappa)."""
    known = (NEO_HOOKEAN, MOONEY_RIVLIN_2, MOONEY_RIVLIN_3)
    if made.law not in known or made.volumetric != "quadratic":
        raise ValueError(
            f"law: expected one of {', '.join(law.name for law in known)} with the quadratic "
            f"volumetric law for a block under a pin, found {made.law.name} ({made.volumetric})"
        )
    C10, C01, C11 = (*made.constants, 0.0, 0.0)[:3]
    kappa = C10 + C01
    at_bulk = replace(model, bulk_ratio=made.bulk / (2.0 * kappa))
    unit = at_bulk(np.array([C01, C11]) / kappa)
    return replace(
        unit,
        force=kappa * unit.force,
        force_gradient=kappa * unit.force_gradient,
        points=model.points(),
    )
