"""Student-t noise of a field, approximately: how much each point is believed.

A Student-t of nu degrees of freedom is a normal whose variance is divided by a weight
w ~ Gamma(nu/2, nu/2) (Lange, Little & Taylor, J. Am. Stat. Assoc. 84 (1989) 881). What is
approximated: each point has one weight for all its increments and components; its mean given its
misfit takes the place of its distribution; the misfit is what it is off a smooth field through all
other points, given their correlated noise, and not a forward model; and what a weight below one
adds to the variance is an error of the point's own, as of one that image correlation has lost.
Scaling the correlated noise itself would have neighbours of other weights tell what they share. So
the weights are the same for all hypotheses, and stay as they are while these are inferred and
compared.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

from calib.data.dataset import FieldData
from fe.response import Array

SMOOTH = 1.5
"""mm, over which displacements are taken to be smooth: a part of the pin's width"""
SIZES = (1.0, 0.25, 0.0625)
"""of the variance of what is smooth, over that of the values"""
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
    whiten = np.linalg.inv(np.linalg.cholesky(step))
    white = np.einsum("ij,jpc->ipc", whiten, field.displacement) / field.noise_std
    white = white - white.mean(axis=1, keepdims=True)
    smooth = [
        _smooth(field.points, correlation, white[:, :, c], freedom) for c in range(n_component)
    ]
    weights = np.ones(n_point)
    for _ in range(ROUNDS):
        squared = np.zeros(n_point)
        for c in range(n_component):
            squared += _misfit(smooth[c] + correlation, weights, white[:, :, c])[0]
        new = (freedom + n_step * n_component) / (freedom + squared)
        change = np.abs(np.log(new / weights)).max()
        weights = new
        if change < SETTLED:
            break
    return weights


def own_errors(weights: Array) -> Array:
    """(n_point,) variance of the points' own errors by their weights, in units of the noise's."""
    own: Array = np.maximum(1.0 / weights - 1.0, 0.0)
    return own


def _misfit(known: Array, weights: Array, values: Array) -> tuple[Array, Array]:
    """Chi-square (n_point,) of each point's values (n_step, n_point), given those of all others.

    As if its own weight were one and theirs `weights`; and the variance (n_point,) of what is
    foretold of it. `known` (n_point, n_point) is the covariance of a smooth field and of normal
    noise, in units of the noise. So correlated noise is not taken for an outlier of what is smooth,
    nor the other way round.
    """
    factor = cho_factor(known + np.diag(own_errors(weights)), lower=True)
    inverse = cho_solve(factor, np.eye(len(weights)))
    solved, own = inverse @ values.T, np.diag(inverse)
    towards = known - np.diag(np.diag(known))  # covariance of a point with the others
    shared = np.einsum("pq,qp->p", towards, inverse)
    expected = towards @ solved - (shared / own)[:, None] * solved
    explained = np.einsum("pq,pq->p", towards @ inverse, towards) - shared**2 / own
    variance: Array = np.diag(known) - explained
    return np.sum((values.T - expected) ** 2, axis=1) / variance, variance


def _smooth(points: Array, correlation: Array, values: Array, freedom: float) -> Array:
    """(n_point, n_point) covariance of the smooth field that values (n_step, n_point) are of.

    About any plane; of three roughnesses (Matern with nu = 3/2, 5/2 and the squared exponential)
    and `SIZES` that under which points left out are most probable, by Student-t of `freedom`
    degrees: a field that bends at the pin's edge is rougher than one that does not.
    """
    off = (points - points.mean(axis=0)) / max(float(np.ptp(points)), 1e-12)
    plane = np.column_stack([np.ones(len(points)), off])
    size = (np.sqrt(np.mean(np.var(values, axis=1))) + 1.0) ** 2
    best, found = -np.inf, np.zeros_like(correlation)
    for kernel in _kernels(cdist(points, points) / SMOOTH):
        for share in SIZES:
            candidate = size * (share * kernel + 10.0 * plane @ plane.T)
            misfit, variance = _misfit(candidate + correlation, np.ones(len(points)), values)
            n = len(values)
            score = -0.5 * np.sum(n * np.log(variance) + (freedom + n) * np.log1p(misfit / freedom))
            if score > best:
                best, found = float(score), candidate
    return found


def _kernels(apart: Array) -> tuple[Array, Array, Array]:
    """Correlations of fields of three roughnesses at distances over their length."""
    rough, middle = np.sqrt(3.0) * apart, np.sqrt(5.0) * apart
    return (
        (1.0 + rough) * np.exp(-rough),
        (1.0 + middle + middle**2 / 3.0) * np.exp(-middle),
        np.exp(-0.5 * apart**2),
    )
