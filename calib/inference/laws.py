"""Coordinates of the laws: kappa = mu / 2 in MPa and dimensionless ratios of the constants.

In these every law obeys the scale symmetry exactly: the field depends on the ratios alone, and the
force is kappa times a function of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fe.materials.law import LAWS, Law
from fe.response import Array

MOONEY_RIVLIN_3 = "mooney-rivlin-3"
DEFAULT_LAW = MOONEY_RIVLIN_3


@dataclass(frozen=True)
class Ratio:
    """A dimensionless ratio of a law's constants, and what is possible of it."""

    name: str
    meaning: str
    low: float = -np.inf
    """least value at which no constant is negative (an Ogden term: no mu alpha)"""
    high: float = np.inf
    """largest such value"""
    nonzero: bool = False
    """whether an interval may not hold 0"""


_R = Ratio("r", "C01 / kappa", 0.0, 1.0)
_S = Ratio("s", "C11 / kappa", 0.0)


def _ogden_ratios(n: int) -> tuple[Ratio, ...]:
    """Exponents and, from the second term on, shares of the shear modulus."""
    ratios = [Ratio("alpha1", "exponent of the first term", nonzero=True)]
    for p in range(2, n + 1):
        ratios.append(Ratio(f"alpha{p}", f"exponent of term {p}", nonzero=True))
        meaning = f"share mu{p} alpha{p} / (4 kappa) of the shear modulus"
        ratios.append(Ratio(f"share{p}", meaning, 0.0, 1.0))
    return tuple(ratios)


RATIOS: dict[str, tuple[Ratio, ...]] = {
    "neo-hookean": (),
    "mooney-rivlin-2": (_R,),
    MOONEY_RIVLIN_3: (_R, _S),
    "yeoh": (Ratio("c20", "C20 / kappa", 0.0), Ratio("c30", "C30 / kappa", 0.0)),
    "ogden-1": _ogden_ratios(1),
    "ogden-2": _ogden_ratios(2),
    "ogden-3": _ogden_ratios(3),
}
"""law -> its ratios, in the order of the coordinates"""


@dataclass(frozen=True)
class LawCoordinates:
    """A law by kappa and ratios; raises ValueError for an unknown one."""

    name: str = DEFAULT_LAW

    def __post_init__(self) -> None:
        if self.name not in RATIOS:
            raise ValueError(f"law: expected one of {', '.join(RATIOS)}, found {self.name!r}")

    @property
    def law(self) -> Law:
        """The law as the FE model knows it."""
        return LAWS[self.name]

    @property
    def ratios(self) -> tuple[Ratio, ...]:
        """What the coordinates are beside kappa."""
        return RATIOS[self.name]

    @property
    def constants(self) -> tuple[str, ...]:
        """Names of the constants and, last, of the shear modulus mu."""
        return (*self.law.constant_names, "mu")

    @property
    def units(self) -> tuple[str, ...]:
        """Units of `constants`."""
        return (*("MPa" if stress else "1" for stress in self.law.scales_stress), "MPa")

    def constants_of(self, theta: Array) -> Array:
        """(..., n_constant + 1) constants and mu of theta = (kappa [MPa], ratios, ...)."""
        kappa = theta[..., 0]
        at_unit = self.at_unit(np.asarray(theta)[..., 1 : 1 + len(self.ratios)])
        values = [
            at_unit[i] * kappa if stress else at_unit[i]
            for i, stress in enumerate(self.law.scales_stress)
        ]
        return np.stack([*values, 2.0 * kappa], axis=-1)

    def at_unit(self, ratios: Array) -> list[Array]:
        """Each constant (...) at kappa = 1 MPa of ratios (..., n_ratio)."""
        q = np.moveaxis(np.asarray(ratios, dtype=np.float64), -1, 0)
        one = np.ones(np.shape(ratios)[:-1])
        if self.name.startswith("ogden"):
            return _ogden_constants(q, one)
        if self.name == "yeoh":
            return [one, q[0], q[1]]
        return [one if not len(q) else 1.0 - q[0], *q]

    def slopes(self, ratios: Array) -> Array:
        """(n_ratio, n_constant) derivatives of the constants at kappa = 1 MPa by the ratios (n,).

        Of an Ogden law mu_p = 4 w_p / alpha_p, with w_1 = 1 - sum of the other shares.
        """
        n = len(self.law.constant_names)
        slopes = np.zeros((len(self.ratios), n))
        for row, ratio in enumerate(self.ratios):
            if self.name.startswith("ogden"):
                _ogden_slope(slopes[row], ratio.name, self.at_unit(ratios))
            elif ratio.name == "r":
                slopes[row, :2] = -1.0, 1.0
            else:  # C11, C20 and C30 are ratios times kappa
                slopes[row, row + 1] = 1.0
        return slopes


def _ogden_constants(q: Array, one: Array) -> list[Array]:
    """mu1, alpha1, mu2, ... from alpha1, alpha2, share2, ..."""
    alphas = [q[0], *q[1::2]]
    shares = [one - sum(q[2::2], start=0.0 * one), *q[2::2]]
    pairs = zip(alphas, shares, strict=True)
    return [value for alpha, share in pairs for value in (4.0 * share / alpha, alpha)]


def _ogden_slope(row: Array, name: str, constants: list[Array]) -> None:
    term = int(name[-1]) - 1
    mu, alpha = float(constants[2 * term]), float(constants[2 * term + 1])
    if name.startswith("alpha"):
        row[2 * term], row[2 * term + 1] = -mu / alpha, 1.0
    else:
        row[2 * term] = 4.0 / alpha
        row[0] = -4.0 / float(constants[1])
