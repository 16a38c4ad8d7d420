"""Yeoh law as its bare derivatives (Yeoh, Rubber Chemistry and Technology 66, 1993).

W = C10 a + C20 a^2 + C30 a^3 with a = I1bar - 3, all constants in MPa.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel

Array = npt.NDArray[np.float64]


@kernel(inline="always")
def derivatives(i1: float, constants: Array) -> tuple[float, float, float, float, float, float]:
    """Energy and its derivatives (W, W1, W2, W11, W12, W22) in I1bar, I2bar, MPa."""
    a = i1 - 3.0
    c1, c2, c3 = constants[0], constants[1], constants[2]
    return (
        a * (c1 + a * (c2 + a * c3)),
        c1 + a * (2.0 * c2 + 3.0 * a * c3),
        0.0,
        2.0 * c2 + 6.0 * a * c3,
        0.0,
        0.0,
    )
