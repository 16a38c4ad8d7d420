"""A field's model errors that would be mistaken for other parameters."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from calib.data.dataset import FieldData
from calib.inference.field_noise import spatial_correlation, step_correlation
from fe.response import Array

TRAVEL_LENGTH = 0.8
"""mm of travel over which errors of a mesh are correlated"""
SINGULAR = 1e-10
"""share of the largest eigenvalue below which a combination of parameters is not seen at all"""


def tangent_errors(field: FieldData, travel: Array, tangents: Array, difference: Array) -> Array:
    """(n_step, n_step, n_point, 3) errors with the size of a `difference` in the parameters, mm.

    The difference (n_step, n_point, 3) [mm] of each increment alone is fitted, by least squares in
    the noise of `field`, by the changes of the whole field with the parameters, `tangents`
    (d, n_step, n_point, 3): the d shifts of the parameters that it would be mistaken for. Each
    row is the change of the field with such a shift. Shifts by different increments are taken as
    correlated over `TRAVEL_LENGTH` of the `travel` (n_step,), so that they add up where they agree
    and do not cancel altogether where they do not: with normal factors of SD one, rows times theirs
    have the parameters' covariance sum_ij rho_ij shift_i shift_j^T. This is the grid convergence
    index of what is asked for, the parameters (Roache 1994; Eca and Hoekstra 2014), in place of
    that of displacements.
    """
    n_step, d = len(travel), len(tangents)
    weighed = _by_precision(field, tangents)
    gram = np.einsum("aipx,bipx->ab", weighed, tangents)
    pull = np.einsum("aipx,ipx->ai", weighed, difference)
    scale = np.sqrt(np.diag(gram))
    scale = np.where(scale > 0.0, scale, 1.0)
    shifts = np.linalg.lstsq(gram / np.outer(scale, scale), pull / scale[:, None], rcond=SINGULAR)[
        0
    ]
    shifts = shifts.reshape(d, n_step) / scale[:, None]
    apart = np.abs(np.subtract.outer(travel, travel)) / TRAVEL_LENGTH
    root = np.linalg.cholesky(np.exp(-apart))
    found: Array = np.einsum("aq,aipx->qipx", shifts @ root, tangents)
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
