"""Coordinates of the inference: theta = (kappa, ...), x = (ln kappa, ...), and the constants.

Behind kappa come the ratios of the law, then further unknowns of the forward model, then those of
the errors. Of a parameter that is positive by nature both x and theta hold the logarithm; kappa
alone stands in theta as itself, since the force is proportional to it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from calib.inference.laws import LawCoordinates
from fe.response import Array

PARAMETERS = ("kappa", "r", "s")
CONSTANTS = ("C10", "C01", "C11", "mu")


def theta_of(x: Array) -> Array:
    """(..., n) theta = (kappa [MPa], r, s, ...) from x = (ln kappa, r, s, ...)."""
    theta = np.array(x, dtype=np.float64)
    theta[..., 0] = np.exp(theta[..., 0])
    return theta


def x_of(theta: Array) -> Array:
    """(..., n) x = (ln kappa, ...) from theta = (kappa [MPa], ...); kappa must be positive."""
    x = np.array(theta, dtype=np.float64)
    if not np.all(x[..., 0] > 0):
        raise ValueError(f"theta: kappa must be positive (MPa), got {x[..., 0].min():g}")
    x[..., 0] = np.log(x[..., 0])
    return x


def constants_of(theta: Array) -> Array:
    """(..., 4) constants (C10, C01, C11, mu) in MPa; mu = 2 (C10 + C01) is the shear modulus."""
    kappa, r, s = np.moveaxis(np.asarray(theta)[..., :3], -1, 0)
    return np.stack([(1.0 - r) * kappa, r * kappa, s * kappa, 2.0 * kappa], axis=-1)


def theta_of_constants(c10: float, c01: float, c11: float) -> Array:
    """(3,) theta from Mooney-Rivlin constants in MPa; C10 + C01 must be positive."""
    kappa = c10 + c01
    if not kappa > 0:
        raise ValueError(f"C10 + C01: expected a positive sum in MPa, got {kappa:g}")
    return np.array([kappa, c01 / kappa, c11 / kappa])


@dataclass(frozen=True)
class Unknown:
    """One coordinate of x."""

    name: str
    unit: str
    """of the parameter itself; "1" for a number without unit"""
    meaning: str
    log: bool = False
    """whether x holds the parameter's natural logarithm"""

    @property
    def x_name(self) -> str:
        """Name of the coordinate."""
        return f"ln {self.name}" if self.log else self.name

    @property
    def x_unit(self) -> str:
        """Unit of the coordinate, of which a logarithm is taken: ln MPa; "1" where it has none."""
        return f"ln {self.unit}" if self.log and self.unit != "1" else self.unit

    @property
    def label(self) -> str:
        """Name and unit of the parameter for readers."""
        return f"{self.name} [{'-' if self.unit == '1' else self.unit}]"

    def value(self, x: Array) -> Array:
        """The parameter itself from its coordinate."""
        return np.exp(x) if self.log else x


KAPPA = Unknown("kappa", "MPa", "half the small-strain shear modulus", log=True)


@dataclass(frozen=True)
class Space:
    """What is unknown: kappa, the ratios of the law, then the others in order."""

    law: LawCoordinates = field(default_factory=LawCoordinates)
    inputs: tuple[Unknown, ...] = ()
    """further unknowns of the forward model"""
    errors: tuple[Unknown, ...] = ()
    """unknowns of the errors; no forward model depends on them"""

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """All coordinates of x in order."""
        ratios = (Unknown(ratio.name, "1", ratio.meaning) for ratio in self.law.ratios)
        return (KAPPA, *ratios, *self.inputs, *self.errors)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters in order."""
        return tuple(unknown.name for unknown in self.unknowns)

    @property
    def x_names(self) -> tuple[str, ...]:
        """Names of the coordinates in order, with the unit of kappa."""
        return ("ln kappa [MPa]", *(unknown.x_name for unknown in self.unknowns[1:]))

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.unknowns)

    @property
    def n_forward(self) -> int:
        """Leading columns of theta that the forward model takes."""
        return self.size - len(self.errors)

    def natural(self, x: Array) -> Array:
        """(..., n) parameters themselves, in their units, from x (..., n)."""
        columns = [u.value(x[..., i]) for i, u in enumerate(self.unknowns)]
        return np.stack(columns, axis=-1)

    def constants(self, theta: Array) -> Array:
        """(..., n_constant + 1) constants of the law and mu from theta (..., n)."""
        return self.law.constants_of(np.asarray(theta))
