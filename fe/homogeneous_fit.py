"""Least squares of a law's constants to homogeneous tests of an incompressible material.

A law whose constants are stresses is linear in them: one linear least squares.  Ogden laws are
linear in mu_p for given exponents, so only the exponents are searched (variable projection: Golub
and Pereyra, SIAM J. Numer. Anal. 10, 1973), from several starts, as the sum has many minima.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from fe.closed_forms import nominal_stress
from fe.materials.law import Law

Array = npt.NDArray[np.float64]

START_EXPONENTS = (-4.0, -2.0, 1.0, 2.0, 4.0, 8.0)
"""each choice of as many as the law has terms is a start"""
LARGEST_EXPONENT = 30.0
SAME_VOLUME = 1e-6
"""of the product of the stretches, from 1"""


@dataclass(frozen=True)
class HomogeneousTests:
    """Stresses along axis 1 of tests with axis 3 free, of one or several kinds together.

    Raises ValueError when the shapes do not agree, for numbers that are not finite, a stretch that
    is not above 0 and three of them that change the volume.
    """

    stretches: Array
    """(n, 3) principal stretches, product 1"""
    stress: Array
    """(n,) nominal stress P11, MPa"""

    def __post_init__(self) -> None:
        if self.stretches.shape != (self.stress.size, 3) or self.stress.ndim != 1:
            raise ValueError(
                f"stretches: expected (n, 3) beside n = {self.stress.size} stresses, "
                f"found {self.stretches.shape}"
            )
        if not np.isfinite(self.stress).all():
            raise ValueError(f"stress: expected finite numbers, found {self.stress}")
        if not ((self.stretches > 0.0) & (self.stretches < np.inf)).all():
            raise ValueError(
                f"stretches: expected finite numbers above 0, found {self.stretches.min()}"
            )
        volume = np.prod(self.stretches, axis=1)
        if (np.abs(volume - 1.0) > SAME_VOLUME).any():
            worst = volume[np.abs(volume - 1.0).argmax()]
            raise ValueError(f"stretches: expected a product of 1 in each row, found {worst:g}")

    def predict(self, law: Law, constants: Array) -> Array:
        """(n,) nominal stress P11 of the law at these stretches, MPa."""
        return nominal_stress(law, constants, np.log(self.stretches), 0, 2)


@dataclass(frozen=True)
class Fit:
    """Constants that fit some tests, and how well."""

    law: Law
    constants: Array
    """MPa, exponents without unit"""
    rms: float
    """root of the mean squared misfit, MPa"""
    relative: float
    """norm of the misfit over that of the stress"""


def fit(law: Law, tests: HomogeneousTests) -> Fit:
    """The constants of least squared misfit to all the tests, each point with the same weight.

    Raises ValueError when there are fewer points than constants.
    """
    n_constant = len(law.constant_names)
    if tests.stress.size < n_constant:
        raise ValueError(
            f"tests: expected at least {n_constant} points for {law.name}, "
            f"found {tests.stress.size}"
        )
    stresslike = np.array(law.scales_stress)
    if stresslike.all():
        return judge(law, _linear_part(law, tests, np.zeros(n_constant)), tests)

    def constants_at(exponents: Array) -> Array:
        constants = np.zeros(n_constant)
        constants[~stresslike] = exponents
        return _linear_part(law, tests, constants)

    def misfit(exponents: Array) -> Array:
        return tests.predict(law, constants_at(exponents)) - tests.stress

    n_exponent = int((~stresslike).sum())
    bound = LARGEST_EXPONENT
    found = [
        least_squares(misfit, start, bounds=(-bound, bound), xtol=1e-12, ftol=1e-12, x_scale=2.0)
        for start in combinations(START_EXPONENTS, n_exponent)
    ]
    best = min(found, key=lambda result: float(result.cost))
    return judge(law, constants_at(best.x), tests)


def judge(law: Law, constants: Array, tests: HomogeneousTests) -> Fit:
    """How well given constants, (n_constant,) MPa, fit the tests."""
    misfit = tests.predict(law, constants) - tests.stress
    return Fit(
        law=law,
        constants=constants,
        rms=float(np.sqrt(np.mean(misfit**2))),
        relative=float(np.linalg.norm(misfit) / np.linalg.norm(tests.stress)),
    )


def _linear_part(law: Law, tests: HomogeneousTests, constants: Array) -> Array:
    """`constants` with those in which the stress is linear replaced by their least squares."""
    linear = np.flatnonzero(law.scales_stress)
    columns = []
    for i in linear:
        unit = constants.copy()
        unit[linear] = 0.0
        unit[i] = 1.0
        columns.append(tests.predict(law, unit))
    solved = constants.copy()
    solved[linear] = np.linalg.lstsq(np.stack(columns, axis=1), tests.stress)[0]
    return solved
