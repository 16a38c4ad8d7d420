"""Isochoric energy, stress and tangent of any law at a deformation gradient."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.materials.invariant import invariant_energy, invariant_stress
from fe.materials.law_codes import is_separable
from fe.materials.stretch import separable_energy, separable_stress

Array = npt.NDArray[np.float64]


@kernel(inline="always")
def isochoric_energy(law: int, F: Array, J: float, constants: Array) -> float:
    """Isochoric energy W (MPa) of the law with this code at F (3, 3) with J = det F > 0."""
    if is_separable(law):
        return separable_energy(law, F, J, constants)
    return invariant_energy(law, F, J, constants)


@kernel(inline="always")
def isochoric_stress(
    law: int,
    F: Array,
    cof: Array,
    J: float,
    constants: Array,
    P: Array,
    A: Array,
    with_tangent: bool,
) -> float:
    """Fill P (3, 3) and, if asked, A (3, 3, 3, 3) of the isochoric energy; return W (all MPa).

    `cof` is dJ/dF and `J` = det F > 0 at `F`.
    """
    if is_separable(law):
        return separable_stress(law, F, J, constants, P, A, with_tangent)
    return invariant_stress(law, F, cof, J, constants, P, A, with_tangent)
