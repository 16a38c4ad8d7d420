"""Neo-Hookean law as its bare derivatives: W = C10 (I1bar - 3), C10 in MPa (Treloar 1943)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel

Array = npt.NDArray[np.float64]


@kernel(inline="always")
def derivatives(i1: float, constants: Array) -> tuple[float, float, float, float, float, float]:
    """Energy and its derivatives (W, W1, W2, W11, W12, W22) in I1bar, I2bar, MPa."""
    return constants[0] * (i1 - 3.0), constants[0], 0.0, 0.0, 0.0, 0.0
