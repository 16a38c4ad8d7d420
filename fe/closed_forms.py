"""First Piola-Kirchhoff stress of homogeneous deformations, incompressible or compressible.

Principal stretches only, no finite element code: principal Kirchhoff stresses tau_i =
dW/d ln lam_i (Holzapfel, Nonlinear Solid Mechanics, 2000, sections 6.4 to 6.6) with the pressure
eliminated by the free surface.  With an infinite bulk modulus the transverse stretches follow from
J = 1, else from the free surface.  All stretches are dimensionless, all stresses MPa.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from fe.compiled import kernel
from fe.materials import ogden
from fe.materials.law import Law
from fe.materials.law_codes import invariant_derivatives, is_separable
from fe.materials.material import Material
from fe.materials.volumetric import VOLUMETRIC_CODES, pressure

Array = npt.NDArray[np.float64]
Stretches = tuple[float, float, float]
Logarithms = Callable[[float, float], Stretches]
"""(ln of the loaded stretch, unknown ln of the free one) to the three ln of the stretches"""

ROUNDING = 4.0 * float(np.finfo(np.float64).eps)
"""the least relative tolerance that brentq takes"""
LARGEST_BRACKET = 3.0
"""how far, in ln, the free stretch is sought from that of the incompressible material"""


def uniaxial(material: Material, stretch: npt.ArrayLike) -> Array:
    """Nominal stress P11 (n,) MPa of tension or compression with free sides at stretch (n,).

    Raises ValueError where a stretch is not above 0 or no transverse stretch frees the sides.
    """
    return _loaded(material, stretch, lambda a, b: (a, b, b), -0.5, "uniaxial")


def equibiaxial(material: Material, stretch: npt.ArrayLike) -> Array:
    """Nominal stress P11 = P22 (n,) MPa of a sheet drawn equally both ways; raises as uniaxial."""
    return _loaded(material, stretch, lambda a, b: (a, a, b), -2.0, "equibiaxial")


def pure_shear(material: Material, stretch: npt.ArrayLike) -> Array:
    """Nominal stress P11 (n,) MPa of planar tension, lam_2 = 1; raises as uniaxial."""
    return _loaded(material, stretch, lambda a, b: (a, 0.0, b), -1.0, "pure shear")


def simple_shear(material: Material, shear: npt.ArrayLike) -> Array:
    """Nominal shear stress P12 (n,) MPa at F = I + shear e1 e2', whose volume does not change.

    P12 = dW/dshear, and shear = lam - 1/lam for the largest principal stretch lam.
    """
    gamma = np.atleast_1d(np.asarray(shear, dtype=np.float64))
    e = np.arcsinh(gamma / 2.0)
    tau = _kirchhoff(material.law, material.constants, np.stack([e, 0.0 * e, -e], axis=1))
    slope: Array = (tau[:, 0] - tau[:, 2]) / (2.0 * np.cosh(e))
    return slope


def nominal_stress(
    law: Law, constants: npt.ArrayLike, logarithms: npt.ArrayLike, loaded: int, free: int
) -> Array:
    """P (n,) MPa along axis `loaded` where axis `free` carries no stress.

    `logarithms` (n, 3) are those of the principal stretches, whatever their sum.  The constants
    need not make a stable material: fits of linear laws ask for one constant at a time.
    """
    e = np.atleast_2d(np.asarray(logarithms, dtype=np.float64))
    tau = _kirchhoff(law, constants, e)
    P: Array = (tau[:, loaded] - tau[:, free]) * np.exp(-e[:, loaded])
    return P


def _loaded(
    material: Material, stretch: npt.ArrayLike, logarithms: Logarithms, power: float, name: str
) -> Array:
    """P11 at the stretch, where ln of the free stretch is `power` ln(stretch) at J = 1."""
    stretch = np.atleast_1d(np.asarray(stretch, dtype=np.float64))
    if not (stretch > 0.0).all():
        raise ValueError(f"stretch: expected numbers above 0, found {stretch.min()}")
    rows = []
    for a in np.log(stretch):
        free = power * a
        if np.isfinite(material.bulk):
            free = _free_stretch(material, partial(logarithms, a), free, name)
        rows.append(logarithms(a, free))
    return nominal_stress(material.law, material.constants, rows, 0, 2)


def _free_stretch(
    material: Material, logarithms: Callable[[float], Stretches], start: float, name: str
) -> float:
    """Ln of the free stretch at which axis 3 carries no stress, sought around `start`."""
    volumetric = VOLUMETRIC_CODES[material.volumetric]

    def stress(b: float) -> float:
        e = np.array([logarithms(b)])
        dilation = np.expm1(e.sum())
        tau = _kirchhoff(material.law, material.constants, e)[0, 2]
        return float(tau + material.bulk * (1.0 + dilation) * pressure(volumetric, dilation))

    at_start = stress(start)
    if at_start == 0.0:
        return start
    step = 1e-3 if at_start < 0.0 else -1e-3
    while abs(step) < LARGEST_BRACKET:
        if stress(start + step) * at_start <= 0.0:
            return brentq(stress, start, start + step, xtol=1e-16, rtol=ROUNDING)
        step *= 2.0
    raise ValueError(
        f"stretch: expected one at which {name} of {material.law.name} with a bulk modulus of "
        f"{material.bulk:g} MPa ({material.volumetric}) has an equilibrium near its "
        f"incompressible one, found ln(stretch) = {logarithms(start)[0]:g}"
    )


def _kirchhoff(law: Law, constants: npt.ArrayLike, logarithms: Array) -> Array:
    """(n, 3) isochoric principal Kirchhoff stresses (MPa) at logarithms (n, 3) of the stretches."""
    values = np.ascontiguousarray(constants, dtype=np.float64)
    e = logarithms - logarithms.mean(axis=1, keepdims=True)
    slopes: Array = _slopes(law.code, e, values)
    deviatoric: Array = slopes - slopes.mean(axis=1, keepdims=True)
    return deviatoric


@kernel()
def _slopes(law: int, e: Array, constants: Array) -> Array:
    """(n, 3) dW/de_i, MPa, at isochoric logarithms e (n, 3), up to a multiple of (1, 1, 1)."""
    slopes = np.empty(e.shape)
    for i in range(e.shape[0]):
        if is_separable(law):
            for a in range(3):
                slopes[i, a] = ogden.derivatives(law, e[i, a], constants)[1]
        else:
            square = np.exp(2.0 * e[i])
            i1 = square.sum()
            i2 = square[0] * square[1] + square[1] * square[2] + square[2] * square[0]
            _, W1, W2, _, _, _ = invariant_derivatives(law, i1, i2, constants)
            slopes[i] = 2.0 * (W1 * square + W2 * (i1 * square - square * square))
    return slopes
