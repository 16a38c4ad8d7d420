"""A field's model errors that would be mistaken for other parameters."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from calib.data.dataset import FieldData
from calib.inference.field_noise import spatial_correlation, step_correlation
from calib.inference.forward import ForwardModel
from fe.response import Array

TRAVEL_LENGTH = 0.8
"""mm of travel over which errors of a mesh are correlated"""
SINGULAR = 1e-10
"""share of the largest eigenvalue below which a combination of parameters is not seen at all"""


def mistaken(field: FieldData, travel: Array, tangents: Array, differences: Array) -> Array:
    """(d, n n_step) changes of d parameters that `differences` of fields would be mistaken for.

    Each difference (n, n_step, n_point, 3) [mm] at each increment alone is fitted, by least squares
    in the noise of `field`, by the changes of the whole field with the parameters, `tangents`
    (d, n_step, n_point, 3). Changes by different increments are taken as correlated over
    `TRAVEL_LENGTH` of the `travel` (n_step,), so that they add up where they agree and do not
    cancel altogether where they do not: columns times normal factors of SD one have the covariance
    sum_ij rho_ij shift_i shift_j^T. This is the grid convergence index of what is asked for, the
    parameters, in place of that of displacements (Roache 1994; Eca and Hoekstra 2014).
    """
    weighed = _by_precision(field, tangents)
    gram = np.einsum("aipx,bipx->ab", weighed, tangents)
    pull = np.einsum("aipx,nipx->ani", weighed, differences)
    scale = np.sqrt(np.diag(gram))
    scale = np.where(scale > 0.0, scale, 1.0)[:, None]
    flat = pull.reshape(len(tangents), -1) / scale
    shifts, *_ = np.linalg.lstsq(gram / (scale * scale.T), flat, rcond=SINGULAR)
    apart = np.abs(np.subtract.outer(travel, travel)) / TRAVEL_LENGTH
    root = np.linalg.cholesky(np.exp(-apart))
    found: Array = ((shifts / scale).reshape(pull.shape) @ root).reshape(len(tangents), -1)
    return found


def tangents_at(forward: ForwardModel, theta: Array) -> Array:
    """(d, n_step, n_point, 3) changes of a model's field with its inputs at theta (1 + d,), mm.

    Of all but kappa, which no field depends on. The model must have a field and modes.
    """
    slopes, basis = forward.jacobian(theta[None]).weights, forward.field_basis
    assert slopes is not None and basis is not None and basis.modes is not None
    found: Array = np.tensordot(slopes[0][:, 1:].T, basis.modes, axes=1)
    return found


def tangent_errors(shifts: Array, tangents: Array) -> Array:
    """(q, n_step, n_point, 3) changes of a field with shifts (d, q) of its parameters, mm."""
    found: Array = np.einsum("aq,aipx->qipx", shifts, tangents)
    return found


def _by_precision(field: FieldData, fields: Array) -> Array:
    """Fields (d, n_step, n_point, 3) times the inverse of the covariance of the noise."""
    correlation = spatial_correlation(
        field.points, field.correlation_length, field.smoothing, field.nugget
    )
    step = step_correlation(fields.shape[1], field.reference_share)
    d, n_step, n_point, _ = fields.shape
    flat = np.moveaxis(fields, 2, 0).reshape(n_point, -1)
    by_point = cho_solve(cho_factor(correlation, lower=True), flat)
    solved = np.moveaxis(by_point.reshape(n_point, d, n_step, 3), 0, 2)
    found: Array = np.einsum("ij,djpx->dipx", np.linalg.inv(step), solved)
    return found / field.noise_std**2
