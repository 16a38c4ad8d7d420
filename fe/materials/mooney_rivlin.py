"""Mooney-Rivlin laws with two and three constants as their bare derivatives.

With a = I1bar - 3, b = I2bar - 3, the isochoric invariants I1bar = J^(-2/3) I1 and
I2bar = J^(-4/3) I2, and all constants in MPa (Rivlin, Phil. Trans. R. Soc. A 241, 1948):

- two constants: W = C10 a + C01 b
- three constants: W = C10 a + C01 b + C11 a b
- its C20 variant: W = C10 a + C01 b + C20 a^2
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel

Array = npt.NDArray[np.float64]


@kernel(inline="always")
def two_constants(
    i1: float, i2: float, constants: Array
) -> tuple[float, float, float, float, float, float]:
    """Energy and its derivatives (W, W1, W2, W11, W12, W22) in I1bar, I2bar, MPa."""
    energy = constants[0] * (i1 - 3.0) + constants[1] * (i2 - 3.0)
    return energy, constants[0], constants[1], 0.0, 0.0, 0.0


@kernel(inline="always")
def three_constants(
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


@kernel(inline="always")
def c20_variant(
    i1: float, i2: float, constants: Array
) -> tuple[float, float, float, float, float, float]:
    """Energy and its derivatives (W, W1, W2, W11, W12, W22) in I1bar, I2bar, MPa."""
    a = i1 - 3.0
    energy = constants[0] * a + constants[1] * (i2 - 3.0) + constants[2] * a * a
    return (
        energy,
        constants[0] + 2.0 * constants[2] * a,
        constants[1],
        2.0 * constants[2],
        0.0,
        0.0,
    )


def from_ratios(ratios: Array, kappa: float = 1.0) -> Array:
    """Constants (C10, C01, C11), MPa, from (r, s) = (C01, C11) / kappa and kappa = C10 + C01."""
    r, s = ratios
    return kappa * np.array([1.0 - r, r, s])


RATIO_DERIVATIVES = np.array([[-1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
"""(2, 3) derivative of (C10, C01, C11) / kappa with respect to r and s"""
