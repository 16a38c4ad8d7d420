"""Posterior predictive draws of the force and of the field."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calib.inference.coordinates import theta_of
from calib.inference.forward import Prediction
from calib.inference.likelihood import Likelihood
from calib.inference.student_force import student_weights
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
        error = _force_errors(likelihood, prediction, theta, rng)
        parts.append(prediction.force * _factors(likelihood, theta, rng) + error)
    return np.concatenate(parts)


def _force_errors(
    likelihood: Likelihood, prediction: Prediction, theta: Array, rng: np.random.Generator
) -> Array:
    """(m, n_step) draws of the errors of the forces, N."""
    covariance = likelihood.force_covariance(prediction, theta)
    freedom, m = likelihood.errors.freedom, len(theta)
    if freedom is not None:
        # Student-t are all errors but the shared ones, which `force_covariance` has too.
        shifts = likelihood.errors.shifts(np.ascontiguousarray(prediction.force.T))
        covariance = covariance - np.einsum("qim,qjm->mij", shifts, shifts)
    factor = np.linalg.cholesky(covariance)
    noise = rng.standard_normal(prediction.force.shape)
    drawn: Array = np.einsum("mij,mj->mi", factor, noise)
    if freedom is None:
        return drawn
    shared: Array = np.einsum("qim,qm->mi", shifts, rng.standard_normal((len(shifts), m)))
    own: Array = drawn / np.sqrt(student_weights(freedom, m, rng))[:, None]
    return own + shared


def _factors(likelihood: Likelihood, theta: Array, rng: np.random.Generator) -> Array:
    """(m, n_step) draws of the factor by which the model errs; (1, 1) of 1 where it does not."""
    covariance = likelihood.factor_covariance(theta)
    if covariance is None:
        return np.ones((1, 1))
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    normal = rng.standard_normal((len(theta), covariance.shape[-1]))
    drawn: Array = np.exp(np.einsum("mij,mj->mi", root, normal))
    return drawn


def expected_forces(likelihood: Likelihood, x: Array) -> Array:
    """(m, n_step) force of the model at each draw x (m, n), without any error, N."""
    parts = [
        likelihood.predict(theta_of(x[start : start + BATCH])).force
        for start in range(0, len(x), BATCH)
    ]
    return np.concatenate(parts)


class PredictedFields(NamedTuple):
    """Fields at posterior draws, mm."""

    model: Array
    """(m, n_step, n_point, 3) of the model, without any error"""
    replicate: Array
    """(m, n_step, n_point, 3) as they would be measured again"""


def predictive_fields(
    likelihood: Likelihood, x: Array, rng: np.random.Generator
) -> PredictedFields:
    """A replicate of the measured mean field for each posterior draw x (m, n).

    With every error of the likelihood: noise, discretisation, emulator, and those shared with the
    forces.
    Raises ValueError when the likelihood has no field.
    """
    field = likelihood.field
    if field is None:
        raise ValueError("likelihood: holds no field, expected one to predict fields")
    theta = theta_of(x)
    prediction = likelihood.predict(theta)
    basis = likelihood.forward.field_basis
    if basis is None or prediction.weights is None:
        raise ValueError("likelihood: its forward model gives no field")
    model = basis.fields(prediction.weights)
    weights = prediction.weights
    if prediction.weight_variance is not None:
        weights = weights + np.sqrt(prediction.weight_variance) * rng.standard_normal(weights.shape)
    own = rng.standard_normal((len(field.shifts), len(x)))
    replicate = basis.fields(weights) + np.einsum("qm,qmipc->mipc", own, field.shared(model))
    if prediction.field_factor is not None:
        factor = prediction.field_factor
        own = rng.standard_normal(factor.shape[:2])
        replicate += np.einsum("mq,mqipc->mipc", own, factor)
    replicate += likelihood.field_errors(theta, rng)
    return PredictedFields(model, replicate)
