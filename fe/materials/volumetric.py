"""Volumetric laws U(J) = K u(J) as their bare derivatives in the dilation J - 1.

- quadratic: u = (J - 1)^2 / 2
- logarithmic: u = (ln J)^2 / 2; u'' < 0 beyond J = e, where it loses stability
- simo-miehe: u = (J^2 - 1 - 2 ln J) / 4 (Simo and Miehe, CMAME 98, 1992)

All have u'' = 1 at J = 1, so K is the bulk modulus at small strain.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel

Array = npt.NDArray[np.float64]
Volumetric = Literal["quadratic", "logarithmic", "simo-miehe"]

QUADRATIC = 0
LOGARITHMIC = 1
SIMO_MIEHE = 2
VOLUMETRIC_CODES: dict[Volumetric, int] = {
    "quadratic": QUADRATIC,
    "logarithmic": LOGARITHMIC,
    "simo-miehe": SIMO_MIEHE,
}


@kernel()
def deviation(volumetric: int, dilation: float) -> tuple[float, float, float]:
    """(v, v', v'') of v = u - (J - 1)^2 / 2 at the dilation J - 1; inf where J <= 0.

    The mixed element is condensed with the quadratic law; what another law adds to it is small.
    """
    if volumetric == QUADRATIC:
        return 0.0, 0.0, 0.0
    J = 1.0 + dilation
    if not J > 0.0:
        return math.inf, math.inf, math.inf
    log = math.log1p(dilation)
    square = 0.5 * dilation * dilation
    if volumetric == LOGARITHMIC:
        return 0.5 * log * log - square, log / J - dilation, (1.0 - log) / (J * J) - 1.0
    return (
        0.5 * (dilation - square - log),
        -square / J,
        -0.5 * dilation * (2.0 + dilation) / (J * J),
    )


@kernel()
def deviation_slopes(volumetric: int, dilation: Array) -> Array:
    """Derivatives v' (n, m) of the deviation at dilations (n, m)."""
    slopes = np.empty(dilation.shape)
    for i in range(dilation.shape[0]):
        for j in range(dilation.shape[1]):
            slopes[i, j] = deviation(volumetric, dilation[i, j])[1]
    return slopes


@kernel()
def pressure(volumetric: int, dilation: float) -> float:
    """du/dJ at the dilation J - 1: pressure (positive in tension) over the bulk modulus."""
    return dilation + deviation(volumetric, dilation)[1]
