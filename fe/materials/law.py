"""The laws that can be asked for: names, constants, small-strain shear modulus."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fe.materials import law_codes

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Law:
    """One isochoric law; its derivatives are in the module of its name."""

    name: str
    code: int
    """what the kernels know it by, see fe.materials.law_codes"""
    constant_names: tuple[str, ...]
    scales_stress: tuple[bool, ...]
    """whether a constant is a stress (MPa) in which W is linear; else it is a pure number"""
    shear_modulus: Callable[[Array], float]
    """small-strain shear modulus mu (MPa) of the constants"""

    def slope(self, constants: Array, direction: Array) -> tuple[int, Array]:
        """Code and constants of the law dW/dh at constants + h direction, both (n_constant,).

        A law that is linear in its constants gives itself.
        """
        if self.code != law_codes.OGDEN:
            return self.code, np.array(direction, dtype=np.float64)
        pairs = np.concatenate([constants.reshape(-1, 2), direction.reshape(-1, 2)], axis=1)
        return law_codes.OGDEN_SLOPE, pairs.astype(np.float64).ravel()


def _twice_first(constants: Array) -> float:
    return 2.0 * float(constants[0])


def _twice_first_two(constants: Array) -> float:
    return 2.0 * float(constants[0] + constants[1])


def _half_products(constants: Array) -> float:
    return 0.5 * float(constants[::2] @ constants[1::2])


def _ogden(n: int) -> Law:
    names = [(f"mu{p}", f"alpha{p}") for p in range(1, n + 1)]
    return Law(
        name=f"ogden-{n}",
        code=law_codes.OGDEN,
        constant_names=tuple(name for pair in names for name in pair),
        scales_stress=(True, False) * n,
        shear_modulus=_half_products,
    )


def _linear(
    name: str, code: int, constant_names: tuple[str, ...], shear_modulus: Callable[[Array], float]
) -> Law:
    return Law(name, code, constant_names, (True,) * len(constant_names), shear_modulus)


NEO_HOOKEAN = _linear("neo-hookean", law_codes.NEO_HOOKEAN, ("C10",), _twice_first)
MOONEY_RIVLIN_2 = _linear(
    "mooney-rivlin-2", law_codes.MOONEY_RIVLIN_2, ("C10", "C01"), _twice_first_two
)
MOONEY_RIVLIN_3 = _linear(
    "mooney-rivlin-3", law_codes.MOONEY_RIVLIN_3, ("C10", "C01", "C11"), _twice_first_two
)
MOONEY_RIVLIN_C20 = _linear(
    "mooney-rivlin-c20", law_codes.MOONEY_RIVLIN_C20, ("C10", "C01", "C20"), _twice_first_two
)
YEOH = _linear("yeoh", law_codes.YEOH, ("C10", "C20", "C30"), _twice_first)
OGDEN_1, OGDEN_2, OGDEN_3 = _ogden(1), _ogden(2), _ogden(3)

LAWS: dict[str, Law] = {
    law.name: law
    for law in (
        NEO_HOOKEAN,
        MOONEY_RIVLIN_2,
        MOONEY_RIVLIN_3,
        MOONEY_RIVLIN_C20,
        YEOH,
        OGDEN_1,
        OGDEN_2,
        OGDEN_3,
    )
}
