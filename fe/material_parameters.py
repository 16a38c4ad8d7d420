"""What sensitivities of a march are taken in: directions in the space of a material's constants."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.materials.material import Material, check_material
from fe.materials.mooney_rivlin import RATIO_DERIVATIVES

Array = npt.NDArray[np.float64]


class MaterialParameters(NamedTuple):
    """Parameters of a material, each as the change of everything that it changes."""

    names: tuple[str, ...]
    constants: Array
    """(n_p, n_constant) change of the constants, MPa (exponents: 1) per unit of the parameter"""
    bulk: Array
    """(n_p,) change of the bulk modulus, MPa per unit"""
    stiffness: Array
    """(n_p,) relative change of the contact stiffness, which goes with the shear modulus"""


def ratio_parameters(material: Material) -> MaterialParameters:
    """(r, s) of a Mooney-Rivlin material with three constants and, last, bulk modulus over mu.

    kappa = mu / 2 is held, and with (r, s) the bulk modulus.
    """
    kappa = material.constants[0] + material.constants[1]
    constants = np.vstack([kappa * RATIO_DERIVATIVES, np.zeros(3)])
    bulk = np.array([0.0, 0.0, 2.0 * kappa])
    return MaterialParameters(("r", "s", "bulk_ratio"), constants, bulk, np.zeros(3))


def all_parameters(material: Material) -> MaterialParameters:
    """Every constant of the law and, last, the bulk modulus.

    The contact stiffness goes with the shear modulus, which is affine in each single constant:
    its central difference is exact.  Raises ValueError for what is no material.
    """
    check_material(material)
    law, theta = material.law, np.array(material.constants, dtype=np.float64)
    n = theta.size
    slopes = [
        law.shear_modulus(theta + step) - law.shear_modulus(theta - step)
        for step in np.diag(np.where(theta == 0.0, 1.0, np.abs(theta)))
    ]
    size = np.where(theta == 0.0, 1.0, np.abs(theta))
    stiffness = np.array(slopes) / (2.0 * size) / material.shear_modulus
    return MaterialParameters(
        names=(*law.constant_names, "bulk"),
        constants=np.vstack([np.eye(n), np.zeros(n)]),
        bulk=np.append(np.zeros(n), 1.0),
        stiffness=np.append(stiffness, 0.0),
    )
