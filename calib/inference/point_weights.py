"""Student-t noise of a field, approximately: how much each point is believed.

A Student-t of nu degrees of freedom is a normal whose variance is divided by a weight
w ~ Gamma(nu/2, nu/2) (Lange, Little & Taylor, J. Am. Stat. Assoc. 84 (1989) 881). What is
approximated: each point has one weight for all its increments and components; its value of largest
density (EM) takes the place of its distribution; errors of a point count by their variances, as if
not correlated with those beside it; and what a point is held against is a smooth field through all
points, not a forward model. So the weights are the same for all hypotheses, and stay as they are
while these are inferred and compared.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

from calib.data.dataset import FieldData
from fe.response import Array

SMOOTH = 1.5
"""mm, over which displacements are taken to be smooth: a part of the pin's width"""
ROUNDS = 30
SETTLED = 1e-3
"""change of ln w below which the rounds end"""


def point_weights(field: FieldData, correlation: Array, step: Array, freedom: float) -> Array:
    """(n_point,) weights of the points of a field under noise of `freedom` degrees.

    `correlation` (n_point, n_point) and `step` (n_step, n_step) are those of normal noise over
    points and increments. A point that agrees with the others has a weight near or above 1, an
    outlier one near 0.
    Raises ValueError for degrees of freedom that are not above 0.
    """
    if not freedom > 0:
        raise ValueError(f"freedom: expected degrees of freedom above 0, got {freedom}")
    n_step, n_point, n_component = field.displacement.shape
    smooth = _smooth(field.points)
    whiten = np.linalg.inv(np.linalg.cholesky(step))
    white = np.einsum("ij,jpc->ipc", whiten, field.displacement)
    # To a unit: the variance of what is smooth, in units of the noise.
    size = np.sqrt(np.mean(np.var(white, axis=1), axis=0)) / field.noise_std + 1.0
    weights = np.ones(n_point)
    for _ in range(ROUNDS):
        scale = weights**-0.5
        noise = scale[:, None] * correlation * scale
        squared = np.zeros(n_point)
        for c in range(n_component):
            factor = cho_factor(size[c] ** 2 * smooth + noise, lower=True)
            # What the noise is expected to be, and what is left unknown of it.
            error = noise @ cho_solve(factor, white[:, :, c].T) / field.noise_std[c]
            left = np.diag(noise) - np.einsum("pq,qp->p", noise, cho_solve(factor, noise))
            squared += np.sum(error**2, axis=1) + n_step * left
        new = (freedom + n_step * n_component) / (freedom + squared)
        change = np.abs(np.log(new / weights)).max()
        weights = new
        if change < SETTLED:
            break
    return weights


def _smooth(points: Array) -> Array:
    """(n_point, n_point) covariance of a smooth field of unit variance about any plane."""
    kernel = np.exp(-0.5 * (cdist(points, points) / SMOOTH) ** 2)
    off = (points - points.mean(axis=0)) / max(float(np.ptp(points)), 1e-12)
    plane = np.column_stack([np.ones(len(points)), off])
    smooth: Array = kernel + 10.0 * plane @ plane.T
    return smooth
