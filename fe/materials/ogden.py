"""Isochoric Ogden law as its bare derivatives in the logarithm of one principal stretch.

W = sum_i w(e_i), w(e) = sum_p mu_p / alpha_p (exp(alpha_p e) - 1), e_i = ln(J^(-1/3) lam_i)
(Ogden, Proc. R. Soc. A 326, 1972; this convention has 2 mu = sum_p mu_p alpha_p).
`constants` are (mu_1, alpha_1, mu_2, alpha_2, ...), mu_p in MPa.

The slope of the law along a change (dmu_p, dalpha_p) of its constants is again such a sum; it
gives sensitivities through the same chain rule.  Its constants are (mu_1, alpha_1, dmu_1,
dalpha_1, mu_2, ...).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel
from fe.materials.law_codes import OGDEN

Array = npt.NDArray[np.float64]


@kernel()
def sinhc(x: float) -> float:
    """sinh(x) / x, 1 at 0."""
    return math.sinh(x) / x if x != 0.0 else 1.0


@kernel()
def expm1c(x: float) -> float:
    """(exp(x) - 1) / x, 1 at 0."""
    return math.expm1(x) / x if x != 0.0 else 1.0


@kernel()
def derivatives(law: int, e: float, constants: Array) -> tuple[float, float, float]:
    """(w, dw/de, d2w/de2), MPa, of the law or of its slope at the logarithmic stretch e."""
    w, w1, w2 = 0.0, 0.0, 0.0
    if law == OGDEN:
        for p in range(0, constants.size, 2):
            mu, alpha = constants[p], constants[p + 1]
            power = math.exp(alpha * e)
            w += mu * e * expm1c(alpha * e)
            w1 += mu * power
            w2 += mu * alpha * power
        return w, w1, w2
    for p in range(0, constants.size, 4):
        mu, alpha, dmu, dalpha = constants[p], constants[p + 1], constants[p + 2], constants[p + 3]
        x = alpha * e
        power = math.exp(x)
        w += dmu * e * expm1c(x)
        w += mu * dalpha * e * e * ((power - expm1c(x)) / x if x != 0.0 else 0.5)
        w1 += (dmu + mu * dalpha * e) * power
        w2 += (dmu * alpha + mu * dalpha * (1.0 + alpha * e)) * power
    return w, w1, w2


@kernel()
def divided_difference(law: int, a: float, b: float, constants: Array) -> float:
    """(dw/de(a) - dw/de(b)) / (a - b), MPa, without cancellation; d2w/de2 where a = b."""
    middle, half = 0.5 * (a + b), 0.5 * (a - b)
    total = 0.0
    if law == OGDEN:
        for p in range(0, constants.size, 2):
            mu, alpha = constants[p], constants[p + 1]
            total += mu * alpha * math.exp(alpha * middle) * sinhc(alpha * half)
        return total
    for p in range(0, constants.size, 4):
        mu, alpha, dmu, dalpha = constants[p], constants[p + 1], constants[p + 2], constants[p + 3]
        ratio = alpha * sinhc(alpha * half)
        bracket = (dmu + mu * dalpha * middle) * ratio + mu * dalpha * math.cosh(alpha * half)
        total += math.exp(alpha * middle) * bracket
    return total
