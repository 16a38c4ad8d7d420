"""A population under a forward model that is linear in x: its posterior is known in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.stats import multivariate_normal

from calib.data import Dataset
from calib.data.dataset import SampleData
from calib.inference.condensed import CondensedSamples, condense
from calib.inference.forward import Jacobian, Prediction
from calib.inference.noise import NoiseSettings
from calib.inference.population import Population, ScatterPrior
from calib.inference.prior import Marginal, Prior
from calib.inference.sample_errors import SampleErrors
from fe.response import Array

TRAVEL = np.array([0.5, 0.75, 1.0])
BASE = np.array([10.0, 16.0, 24.0])
SLOPE = np.array([[1.0, 0.2], [1.6, -0.3], [2.4, -1.5]])
"""(3, 2) N per unit of ln(kappa / 0.01 MPa) and of r"""
NOISE = NoiseSettings(load_cell_sd=0.1, travel_zero_sd=0.0, gain_sd=0.0)
OWN = SampleErrors(travel_zero_sd=0.0)
MEAN, SD = 0.0, 1.0
"""of the normal prior of ln(kappa / 0.01 MPa)"""


@dataclass(frozen=True)
class LinearForward:
    """Forces BASE + SLOPE (ln(kappa / 0.01 MPa), r), N."""

    field_basis: None = None
    common_sd: float = 0.0
    """SD of an error of the model, the same at all increments, N"""

    def predict(self, theta: Array) -> Prediction:
        """Forces at theta (m, 2)."""
        x = np.column_stack([np.log(theta[:, 0] / 0.01), theta[:, 1]])
        covariance = None
        if self.common_sd:
            one = np.full((3, 3), self.common_sd**2)
            covariance = np.broadcast_to(one, (len(theta), 3, 3))
        return Prediction(BASE + x @ SLOPE.T, covariance)

    def jacobian(self, theta: Array) -> Jacobian:
        """The same slopes everywhere, at theta (m, 2)."""
        return Jacobian(np.broadcast_to(SLOPE, (len(theta), *SLOPE.shape)))


def prior(r: Marginal | None = None) -> Prior:
    """Ln kappa normal; r uniform over a box."""
    shift = np.log(0.01) + MEAN
    mean = float(np.exp(shift + 0.5 * SD**2))
    sd = mean * float(np.sqrt(np.expm1(SD**2)))
    kappa = Marginal("lognormal", 0.01 * np.exp(-7.0), 0.01 * np.exp(7.0), mean, sd)
    return Prior(kappa, r or Marginal("uniform", 0.0, 1.0), law="mooney-rivlin-2")


def population(size: float = 0.3, freedom: float | None = None) -> Population:
    """Samples differ in kappa; r is common."""
    return Population(prior(), {"kappa": ScatterPrior(size, freedom)})


def dataset(force: Array, names: tuple[str, ...] | None = None) -> Dataset:
    """Forces (n, 3) of samples, N, without a field."""
    n = len(force)
    names = names or tuple(f"S{i + 1}" for i in range(n))
    samples = SampleData(names, force, np.zeros((n, 3, 0, 3)))
    sd = np.maximum(force.std(axis=0, ddof=1), 1e-3)
    return Dataset("linear", True, TRAVEL, force.mean(axis=0), sd, n, samples=samples)


def condensed(data: Dataset, common_sd: float = 0.0) -> CondensedSamples:
    """The samples of a dataset under the linear forward model."""
    return condense(data, LinearForward(common_sd=common_sd), NOISE, OWN)


def forces(x: Array, rng: np.random.Generator, common_sd: float = 0.0) -> Array:
    """(n, 3) N of samples x (n, 2) with the errors that the model states."""
    common = common_sd * rng.standard_normal()
    noise = NOISE.load_cell_sd * rng.standard_normal((len(x), 3))
    return BASE + x @ SLOPE.T + common + noise


class Exact(NamedTuple):
    """Posterior means and SDs."""

    mean: Array
    sd: Array


def exact(force: Array, size: float, common_sd: float = 0.0) -> tuple[Exact, Exact, Exact]:
    """Of (ln kappa, r) of the population, of tau, and of ln kappa of the samples.

    tau and r on a grid; given both all is normal: ln kappa of the population and of samples, data.
    """
    n = len(force)
    taus = np.linspace(1e-4, 6.0 * size, 400)
    rs = (np.arange(160) + 0.5) / 160
    weights, moments = [], []
    by = SLOPE[:, 0]
    noise = NOISE.load_cell_sd**2 * np.eye(3 * n)
    noise += common_sd**2 * np.ones((3 * n, 3 * n))
    design = np.kron(np.eye(n), by[:, None])
    total = design @ np.ones(n)
    for tau in taus:
        covariance = noise + tau**2 * design @ design.T + SD**2 * np.outer(total, total)
        # x of samples and of the population with the data
        cross = np.vstack([tau**2 * design.T + SD**2 * np.outer(np.ones(n), total), SD**2 * total])
        gain = np.linalg.solve(covariance, cross.T).T
        left = np.full(n + 1, SD**2) + np.append(np.full(n, tau**2), 0.0)
        variance = left - np.einsum("ij,ij->i", gain, cross)
        residual = (force - BASE)[None] - rs[:, None, None] * SLOPE[:, 1] - MEAN * by
        flat = residual.reshape(len(rs), -1)
        density = multivariate_normal(np.zeros(3 * n), covariance).logpdf(flat)
        weights.append(density - 0.5 * (tau / size) ** 2)
        centre = MEAN + flat @ gain.T
        moments.append((centre, np.broadcast_to(variance, centre.shape)))
    w = np.exp(np.array(weights) - np.max(weights))
    w /= w.sum()
    centre, variance = (np.array([m[i] for m in moments]) for i in range(2))
    mean = np.einsum("tr,tri->i", w, centre)
    sd = np.sqrt(np.einsum("tr,tri->i", w, variance + centre**2) - mean**2)
    r_mean = np.sum(w.sum(axis=0) * rs)
    r_sd = np.sqrt(np.sum(w.sum(axis=0) * rs**2) - r_mean**2)
    by_tau = w.sum(axis=1)
    t_mean = np.sum(by_tau * taus)
    t_sd = np.sqrt(np.sum(by_tau * taus**2) - t_mean**2)
    return (
        Exact(np.array([mean[-1], r_mean]), np.array([sd[-1], r_sd])),
        Exact(np.array([t_mean]), np.array([t_sd])),
        Exact(mean[:-1], sd[:-1]),
    )
