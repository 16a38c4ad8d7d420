"""Integers by which compiled kernels know a law, and the choice among laws of the invariants."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.materials import mooney_rivlin, neo_hookean, yeoh

Array = npt.NDArray[np.float64]

NEO_HOOKEAN = 0
MOONEY_RIVLIN_2 = 1
MOONEY_RIVLIN_3 = 2
MOONEY_RIVLIN_C20 = 3
YEOH = 4
# from here on sums over principal stretches
OGDEN = 5
OGDEN_SLOPE = 6
"""directional derivative of an Ogden law in its constants, see fe.materials.ogden"""

_neo_hookean = neo_hookean.derivatives
_mooney_rivlin_2 = mooney_rivlin.two_constants
_mooney_rivlin_3 = mooney_rivlin.three_constants
_mooney_rivlin_c20 = mooney_rivlin.c20_variant
_yeoh = yeoh.derivatives


@kernel(inline="always")
def invariant_derivatives(
    law: int, i1: float, i2: float, constants: Array
) -> tuple[float, float, float, float, float, float]:
    """(W, W1, W2, W11, W12, W22) of the law with this code at I1bar, I2bar; constants in MPa."""
    if law == MOONEY_RIVLIN_3:
        return _mooney_rivlin_3(i1, i2, constants)
    if law == MOONEY_RIVLIN_2:
        return _mooney_rivlin_2(i1, i2, constants)
    if law == MOONEY_RIVLIN_C20:
        return _mooney_rivlin_c20(i1, i2, constants)
    if law == YEOH:
        return _yeoh(i1, constants)
    return _neo_hookean(i1, constants)


@kernel(inline="always")
def is_separable(law: int) -> bool:
    """Whether the law is a sum over principal stretches instead of a function of I1bar, I2bar."""
    return law >= OGDEN
