"""Whether the nodes of a quadrature may have missed some of a posterior: a narrow ridge or peak.

Nodes of the outer coordinates, (r, s), lie along the axes. A ridge of correlated coordinates may
run between them, or between the points of the scan that chose their box, and then two numbers of
nodes agree by chance only. So they may where the interval of ln kappa is many times its peak, as
under Student-t errors, whose tails do not fall.
"""

from __future__ import annotations

import numpy as np

from calib.inference.fisher import laplace_covariance
from calib.inference.minimise import minimise_in_box
from calib.inference.moments import Moments
from calib.inference.posterior import Posterior
from fe.response import Array

RIDGE = 0.92
"""correlation of outer coordinates beyond which it is asked whether the nodes resolve them; 30
nodes a coordinate know normal posteriors of less to 0.003 of the evidence"""
CUT = 1e-6
"""mass of the nodes next to a face of the box above which that cuts off some of the posterior"""
RISE = 5.0
"""climb of the log density from the heaviest node to the peak beyond which nodes may have missed
it; between nodes that resolve a posterior it is 4 at most"""
RESOLVED = 3e-3
"""relative error of the evidence up to which nodes resolve a ridge, or the peak of ln kappa"""
HEAVY = 1e-3
"""mass of the nodes at one outer point, over the largest, from which its peak matters"""
CONVERGED = 0.02
"""difference of ln evidence by two numbers of nodes up to which those of a ridge may be trusted"""
DISAGREE = 0.1
"""the same, beyond which no nodes are, whatever the shape: the tails of Student-t errors never fall
far enough for a box, and nodes over the whole prior are coarser than the peak"""


def may_miss(posterior: Posterior, found: Moments, box: Array, n: int, error: float) -> bool:
    """Whether n nodes a coordinate in a box (d, 2) of the outer ones may miss some of a posterior.

    `found` are the nodes with their posterior weights, `error` is how far fewer of them move the
    logarithm of the evidence.
    """
    if error > DISAGREE or inner_unresolved(found, n) > RESOLVED:
        return True
    if not len(box):
        return False
    if is_cut(found, box, posterior.prior.bounds[1:]):
        return True
    start = found.x[found.weights.argmax()]
    sd = np.maximum(found.sd, 1e-3 * np.ptp(found.x, axis=0))
    bounds = posterior.prior.bounds
    peak, top = minimise_in_box(posterior.log_prob, start, bounds, sd, bounds)
    if top - float(posterior.log_prob(start[None])[0]) > RISE:
        return True
    if not is_ridge(found):
        return False
    covariance = laplace_covariance(posterior, peak, sd)
    if covariance is None or error > CONVERGED:
        return True
    return unresolved(covariance[1:, 1:], np.ptp(box, axis=1) / n) > RESOLVED


def is_cut(found: Moments, box: Array, bounds: Array) -> bool:
    """Whether there is mass at a face of the box (d, 2) of the outer coordinates, no bound."""
    for outer, face, bound in zip(found.x[:, 1:].T, box, bounds, strict=True):
        for end, last in enumerate((outer.min(), outer.max())):
            if face[end] != bound[end] and found.weights[outer == last].sum() > CUT:
                return True
    return False


def is_ridge(found: Moments) -> bool:
    """Whether outer coordinates are correlated beyond `RIDGE`, or seem to be single points.

    Of two the smallest eigenvalue of the correlations is 1 - |correlation|; of more it is no larger
    than that of any two.
    """
    sd = found.sd[1:]
    if not sd.min() > 0.0:
        return True
    off = (found.x[:, 1:] - found.mean[1:]) / sd
    correlation = (found.weights[:, None] * off).T @ off
    return bool(np.linalg.eigvalsh(correlation)[0] < 1.0 - RIDGE)


def inner_unresolved(found: Moments, n: int) -> float:
    """Relative error of the sums over n nodes of ln kappa, in the mean over the outer points.

    Of normal peaks with the variances that the nodes find; a peak between nodes seems to have none.
    """
    weights, ln_kappa = found.weights.reshape(-1, n), found.x[:, 0].reshape(-1, n)
    mass = weights.sum(axis=1)
    kept = mass > HEAVY * mass.max()
    weights, ln_kappa, mass = weights[kept], ln_kappa[kept], mass[kept]
    mean = (weights * ln_kappa).sum(axis=1) / mass
    variance = (weights * (ln_kappa - mean[:, None]) ** 2).sum(axis=1) / mass
    share = np.ptp(np.polynomial.legendre.leggauss(n)[0]) / 2.0
    step = np.ptp(ln_kappa, axis=1) / share / n
    errors = [
        unresolved(np.array([[v]]), np.array([h])) for v, h in zip(variance, step, strict=True)
    ]
    return float(np.average(errors, weights=mass))


def unresolved(covariance: Array, step: Array) -> float:
    """Relative error of a sum over nodes of a normal density, covariance (d, d), at most.

    `step` (d,) is the mean distance of Gauss-Legendre nodes; amid their interval it is pi / 2 times
    that. The error is the sum of the density's Fourier transform over the reciprocal lattice.
    """
    d = len(step)
    whole = np.stack(np.meshgrid(*[np.arange(-2, 3)] * d, indexing="ij"), axis=-1).reshape(-1, d)
    waves = whole[np.any(whole != 0, axis=1)] / (0.5 * np.pi * step)
    exponent = np.einsum("ki,ij,kj->k", waves, covariance, waves)
    return float(np.exp(-2.0 * np.pi**2 * exponent).sum())
