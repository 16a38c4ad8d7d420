"""Three-parameter Mooney-Rivlin law as its bare derivatives.

W = C10 (I1bar - 3) + C01 (I2bar - 3) + C11 (I1bar - 3)(I2bar - 3), all constants in MPa,
with the isochoric invariants I1bar = J^(-2/3) I1 and I2bar = J^(-4/3) I2.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

Array = npt.NDArray[np.float64]


@njit(cache=True, inline="always")
def derivatives(
    i1: float, i2: float, constants: Array
) -> tuple[float, float, float, float, float, float]:
    """Energy and its derivatives (W, W1, W2, W11, W12, W22) in I1bar, I2bar, MPa."""
    a = i1 - 3.0
    b = i2 - 3.0
    energy = constants[0] * a + constants[1] * b + constants[2] * a * b
    return (
        energy,
        constants[0] + constants[2] * b,
        constants[1] + constants[2] * a,
        0.0,
        constants[2],
        0.0,
    )


def from_ratios(ratios: Array, kappa: float = 1.0) -> Array:
    """Constants (C10, C01, C11), MPa, from (r, s) = (C01, C11) / kappa and kappa = C10 + C01."""
    r, s = ratios
    return kappa * np.array([1.0 - r, r, s])


RATIO_DERIVATIVES = np.array([[-1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
"""(2, 3) derivative of (C10, C01, C11) / kappa with respect to r and s"""
