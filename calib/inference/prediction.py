"""Posterior predictive draws of the force."""

from __future__ import annotations

import numpy as np

from calib.inference.coordinates import theta_of
from calib.inference.likelihood import Likelihood
from fe.response import Array

BATCH = 8192


def predictive_forces(likelihood: Likelihood, x: Array, rng: np.random.Generator) -> Array:
    """(m, n_step) one replicate of the measured mean force for each posterior draw x (m, n), N.

    With every error of the likelihood: sampling error of the mean, emulator, discretisation,
    travel zero.
    """
    parts = []
    for start in range(0, len(x), BATCH):
        theta = theta_of(x[start : start + BATCH])
        prediction = likelihood.predict(theta)
        factor = np.linalg.cholesky(likelihood.force_covariance(prediction, theta))
        noise = rng.standard_normal(prediction.force.shape)
        parts.append(prediction.force + np.einsum("mij,mj->mi", factor, noise))
    return np.concatenate(parts)


def expected_forces(likelihood: Likelihood, x: Array) -> Array:
    """(m, n_step) force of the model at each draw x (m, n), without any error, N."""
    parts = [
        likelihood.predict(theta_of(x[start : start + BATCH])).force
        for start in range(0, len(x), BATCH)
    ]
    return np.concatenate(parts)
