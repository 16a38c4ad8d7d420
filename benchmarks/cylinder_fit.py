"""Posterior of the cylinders' constants under one law and one contact at the plates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import logsumexp

from benchmarks.cylinder_runs import FAMILIES, HALF, Family
from calib.inference.box_posterior import BoxSamples, sample_box
from calib.inference.repeats import Repeats, Scatter, log_density
from fe.materials.material import Material, material
from fe.response import Array
from surrogate import Emulator

Ends = Literal["slide", "friction", "bonded"]

LN_KAPPA = tuple(np.log([0.002, 0.05]))  # MPa
SCALES = np.log([[0.001, 0.1], [0.005, 0.3], [0.0005, 0.05], [0.001, 0.2]])
"""bounds of ln: SD of stiffness, of the zero (mm), of what else is a repeat's own, of the model's
discrepancy"""
N_PREDICTIVE = 400


@dataclass(frozen=True)
class Law:
    """A law as a part of a family of the emulators."""

    name: str
    family: str
    n_free: int
    """ratios that are free; the others are 0"""


LAWS = (
    Law("neo-Hookean", "mooney", 0),
    Law("Mooney-Rivlin 2", "mooney", 1),
    Law("Mooney-Rivlin 3", "mooney", 2),
    Law("Yeoh", "yeoh", 2),
)
ENDS: tuple[Ends, ...] = ("slide", "friction", "bonded")


@dataclass(frozen=True)
class Model:
    """Forces of one law between plates of one kind, by the emulator of its family."""

    law: Law
    ends: Ends
    emulator: Emulator

    @property
    def family(self) -> Family:
        """Of the law."""
        return FAMILIES[self.law.family]

    @property
    def bounds(self) -> Array:
        """(d, 2) box of x = (ln kappa, free ratios, m with friction, ln scales)."""
        rows = [LN_KAPPA, *self.family.bounds[: self.law.n_free]]
        if self.ends == "friction":
            rows.append((0.0, 1.0 / (1.0 + HALF)))
        return np.vstack([np.array(rows), SCALES])

    def ratios(self, x: Array) -> Array:
        """(m, 2) ratios of the family."""
        found = np.zeros((len(x), 2))
        found[:, : self.law.n_free] = x[:, 1 : 1 + self.law.n_free]
        return found

    def constants(self, x: Array) -> Array:
        """(m, 3) constants of the family's law, MPa."""
        scaled: Array = np.exp(x[:, :1]) * self.family.constants(self.ratios(x))
        return scaled

    def friction(self, x: Array) -> Array:
        """(m,) coefficients of friction; 0 and infinite where they are fixed."""
        if self.ends != "friction":
            return np.full(len(x), 0.0 if self.ends == "slide" else np.inf)
        m = x[:, 1 + self.law.n_free]
        return HALF * m / (1.0 - m)

    def materials(self, x: Array) -> list[Material]:
        """Incompressible materials, for closed forms."""
        return [material(self.family.law, list(each)) for each in self.constants(x)]

    def predict(self, x: Array) -> tuple[Array, Array]:
        """(m, n_step) ln of the force in N, and the emulator's covariance of it."""
        at = self.ratios(x)
        if self.ends == "friction":
            at = np.column_stack([at, x[:, 1 + self.law.n_free]])
        elif self.ends == "slide":
            at = np.column_stack([at, np.zeros(len(at))])
        force, covariance = self.emulator.unit_force(at)
        relative = covariance / (force[:, :, None] * force[:, None, :])
        with np.errstate(invalid="ignore"):
            return np.log(force) + x[:, :1], relative


def scatter_of(x: Array) -> Scatter:
    """The scales, which come last."""
    return Scatter(*np.exp(x[:, -len(SCALES) :]).T)


def fit(
    model: Model, repeats: Repeats, rng: np.random.Generator, n_steps: int = 1500
) -> BoxSamples:
    """Posterior of x under uniform priors on its box."""

    def likelihood(x: Array) -> Array:
        log_force, extra = model.predict(x)
        value = np.full(len(x), -np.inf)
        good = np.isfinite(log_force).all(axis=1)
        if good.any():
            value[good] = repeats.log_likelihood(log_force[good], scatter_of(x[good]), extra[good])
        return value

    return sample_box(likelihood, model.bounds, rng, n_walkers=32, n_steps=n_steps)


@dataclass(frozen=True)
class LeftOut:
    """One repeat predicted from the others."""

    log_density: float
    """ln predictive density of its curve, in ln F"""
    error: Array
    """(n_step,) predicted median over measured force minus one"""
    z: Array
    """(n_step,) error over predictive SD"""


def predict_left_out(
    model: Model, repeats: Repeats, index: int, rng: np.random.Generator, n_steps: int
) -> LeftOut:
    """Fit all repeats but one, predict that one."""
    others = repeats.without(index)
    draws = fit(model, others, rng, n_steps).draws
    x = draws[rng.choice(len(draws), N_PREDICTIVE, replace=False)]
    log_force, extra = model.predict(x)
    predictive = others.predictive(log_force, scatter_of(x), extra)
    new = np.log(repeats.force[index])
    mean = predictive.mean.mean(axis=0)
    variance = np.diagonal(predictive.covariance, axis1=1, axis2=2).mean(axis=0)
    sd = np.sqrt(variance + predictive.mean.var(axis=0))
    density = float(logsumexp(log_density(predictive, new)) - np.log(len(x)))
    return LeftOut(density, np.expm1(mean - new), (mean - new) / sd)
