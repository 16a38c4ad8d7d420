"""A hyperelastic material: isochoric law, its constants, bulk modulus and volumetric law."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from fe.materials.law import LAWS, MOONEY_RIVLIN_3, Law
from fe.materials.mooney_rivlin import from_ratios
from fe.materials.volumetric import VOLUMETRIC_CODES, Volumetric

Array = npt.NDArray[np.float64]


LARGEST = 1e100
"""MPa: squares of larger moduli, or of their inverse, are no numbers any more"""


class KernelMaterial(NamedTuple):
    """What the compiled kernels see of a material."""

    law: int
    """code of the isochoric law, see fe.materials.law_codes"""
    constants: Array
    """(n_constant,) MPa, exponents without unit"""
    bulk: float
    """MPa"""
    volumetric: int
    """code of the volumetric law, see fe.materials.volumetric"""


@dataclass(frozen=True)
class Material:
    """W(F) = isochoric law + K u(J); MPa.

    Raises ValueError for what is no law, a wrong number of constants, what is no finite number, a
    shear or bulk modulus that is not above 0, a modulus so large or small that its square is no
    number, an Ogden exponent of 0 or an unknown volumetric law.
    """

    law: Law
    constants: tuple[float, ...]
    """in the order of `law.constant_names`"""
    bulk: float = np.inf
    """bulk modulus K, MPa; inf is incompressible (closed forms only)"""
    volumetric: Volumetric = "quadratic"

    def __post_init__(self) -> None:
        if not isinstance(self.law, Law):
            raise ValueError(f"law: expected one of fe.materials, found {self.law!r}")
        names = self.law.constant_names
        given = _numbers(self.constants)
        if given is None or len(given) != len(names) or not np.isfinite(given).all():
            raise ValueError(
                f"constants: expected {len(names)} finite numbers ({', '.join(names)}) "
                f"for {self.law.name}, found {self.constants!r}"
            )
        object.__setattr__(self, "constants", given)
        pairs = list(zip(names, self.constants, self.law.scales_stress, strict=True))
        for name, value, scales_stress in pairs:
            if not scales_stress and value == 0.0:
                raise ValueError(f"{name}: expected an exponent other than 0, found {value}")
        if not self.shear_modulus > 0.0:
            raise ValueError(
                f"constants: expected a small-strain shear modulus above 0 MPa, found "
                f"{self.shear_modulus} from {self.constants} of {self.law.name}"
            )
        if not 1.0 / LARGEST < self.shear_modulus < LARGEST:
            raise ValueError(
                f"constants: expected a shear modulus between {1.0 / LARGEST:g} and {LARGEST:g} "
                f"MPa, found {self.shear_modulus}"
            )
        for name, value, scales_stress in pairs:
            if scales_stress and not abs(value) < LARGEST:
                raise ValueError(f"{name}: expected less than {LARGEST:g} MPa, found {value}")
        bulk = _numbers([self.bulk])
        if bulk is None or not bulk[0] > 0.0:
            raise ValueError(f"bulk: expected a modulus above 0 MPa, found {self.bulk!r}")
        object.__setattr__(self, "bulk", bulk[0])
        if LARGEST <= self.bulk < np.inf:
            raise ValueError(f"bulk: expected less than {LARGEST:g} MPa or inf, found {self.bulk}")
        if not isinstance(self.volumetric, str) or self.volumetric not in VOLUMETRIC_CODES:
            raise ValueError(
                f"volumetric: expected one of {', '.join(VOLUMETRIC_CODES)}, "
                f"found {self.volumetric!r}"
            )

    @property
    def shear_modulus(self) -> float:
        """Small-strain shear modulus mu, MPa."""
        return self.law.shear_modulus(np.array(self.constants))

    def kernel(self) -> KernelMaterial:
        """The material as the kernels take it."""
        return KernelMaterial(
            self.law.code,
            np.array(self.constants, dtype=np.float64),
            float(self.bulk),
            VOLUMETRIC_CODES[self.volumetric],
        )

    def slope(self, direction: Array) -> KernelMaterial:
        """The material dW/dh at constants + h `direction` (n_constant,), without its volume part.

        Bulk modulus 1 MPa and quadratic, for kernels that divide by it.
        """
        code, constants = self.law.slope(np.array(self.constants, dtype=np.float64), direction)
        return KernelMaterial(code, constants, 1.0, VOLUMETRIC_CODES["quadratic"])


def _numbers(values: object) -> tuple[float, ...] | None:
    """The values as floats, of whatever kind of number they are; None where they are none."""
    try:
        given = tuple(cast("Iterable[Any]", values))
        if any(isinstance(value, (bool, np.bool_, str, bytes)) for value in given):
            return None
        return tuple(float(value) for value in given)
    except (TypeError, ValueError, OverflowError):
        return None


def material(
    law: str,
    constants: Sequence[float],
    bulk: float = np.inf,
    volumetric: Volumetric = "quadratic",
) -> Material:
    """Material of the law of this name; constants and bulk modulus in MPa.

    Raises ValueError for an unknown law and what `Material` refuses.
    """
    if not isinstance(law, str) or law not in LAWS:
        raise ValueError(f"law: expected one of {', '.join(LAWS)}, found {law!r}")
    return Material(LAWS[law], cast("tuple[float, ...]", constants), bulk, volumetric)


def check_material(found: object) -> None:
    """Raise ValueError for what is no `Material`."""
    if not isinstance(found, Material):
        raise ValueError(f"material: expected fe.material(law, constants, bulk), found {found!r}")


def mooney_rivlin_of_ratios(ratios: Array, kappa: float, bulk: float) -> Material:
    """Three-constant Mooney-Rivlin at (r, s) = (C01, C11) / kappa, kappa = C10 + C01; MPa.

    Raises ValueError unless the ratios are two finite numbers.
    """
    given = ratios
    try:
        ratios = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        ratios = np.empty(0)
    if ratios.shape != (2,) or not np.isfinite(ratios).all():
        raise ValueError(f"ratios: expected two finite numbers (r, s), found {given!r}")
    constants = from_ratios(ratios, kappa)
    return Material(MOONEY_RIVLIN_3, tuple(float(c) for c in constants), bulk)


def bulk_modulus(shear_modulus: float, poisson: float) -> float:
    """Bulk modulus (MPa) of a small-strain shear modulus (MPa) and Poisson's ratio; inf at 0.5.

    Raises ValueError for a ratio outside (-1, 0.5] and a modulus that is none.
    """
    if not 0.0 < shear_modulus < np.inf:
        raise ValueError(
            f"shear_modulus: expected a finite modulus above 0 MPa, found {shear_modulus}"
        )
    if not -1.0 < poisson <= 0.5:
        raise ValueError(f"poisson: expected a ratio above -1 and up to 0.5, found {poisson}")
    if poisson == 0.5:
        return float(np.inf)
    return 2.0 * shear_modulus * (1.0 + poisson) / (3.0 * (1.0 - 2.0 * poisson))
