"""What a forward model may err by beyond its mesh: another law, another contact.

Kennedy & O'Hagan, J. R. Stat. Soc. B 63 (2001) 425: a Gaussian error of the model, smooth over the
increments and the front face, apart from the parameters. Its size is relative, one number for
forces and field: the field, of many values, tells by its misfit how wrong the model is, and the
forces, which carry the stiffness, are believed that much less. Were the two sizes free of each
other, a wrong model that fits five forces by a wrong stiffness would be taken for right.

The force is the slope of an energy that is quadratic in the strains, to first order: displacements
wrong by a share make it wrong by twice the share, at all travels alike, and by a factor, since it
stays positive. Such a common factor is the stiffness itself to five forces; it cannot be told from
it, and the stiffness is known no better than that. Beside it an error of the share itself changes
over the travel.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.distance import cdist

from calib.inference.likelihood import Likelihood
from calib.inference.noise import smooth_over
from fe.response import Array

LENGTH = 1.5
"""mm over the front face, over which a model's error is correlated: parts of the pin's width"""
TRAVEL_LENGTH = 0.8
"""mm of travel, likewise: the range of the increments"""
KEPT = 0.99
"""share of the variance over the front face that the patterns hold"""
COMMON = 2.0
"""SD of the logarithm of the force's factor common to all travels, over the share"""
TYPICAL = 0.1
"""share that a model is as likely to exceed as not, before any data"""


def log_prior_of_share(share: Array) -> Array:
    """Log density of ln share: half-Cauchy of the median `TYPICAL`, which cuts nothing off.

    Gelman, Bayesian Anal. 1 (2006) 515.
    """
    scaled = share / TYPICAL
    density: Array = np.log(2.0 / np.pi * scaled / (1.0 + scaled**2))
    return density


def factor_covariance(travel: Array, share: float, common: float = COMMON) -> Array:
    """(n_step, n_step) covariance of the logarithm of the force's factor at travels (n_step,)."""
    covariance: Array = share**2 * (common**2 + smooth_over(travel, TRAVEL_LENGTH))
    return covariance


def field_discrepancy(points: Array, travel: Array, size: Array, length: float = LENGTH) -> Array:
    """(q, n_step, n_point, 3) patterns of a field's error, each of one SD, mm.

    `size` (n_step, 3) is the SD of each component at each increment, mm. Squared exponential over
    the points (n_point, 2) and the travels (n_step,) mm, each component by itself; patterns are the
    products of the leading directions over points and all over travels.
    """
    space = np.exp(-0.5 * (cdist(points, points) / length) ** 2)
    values, vectors = np.linalg.eigh(space)
    values, vectors = values[::-1], vectors[:, ::-1]
    n = int(np.searchsorted(np.cumsum(values) / values.sum(), KEPT)) + 1
    over_points = vectors[:, :n] * np.sqrt(values[:n])
    over_travel = _root(smooth_over(travel, TRAVEL_LENGTH))
    parts = np.einsum("it,pn,ic,cd->tncipd", over_travel, over_points, size, np.eye(3))
    patterns: Array = parts.reshape(-1, len(travel), len(points), 3)
    return patterns


def _root(matrix: Array) -> Array:
    """Symmetric square root: of a smooth correlation a Cholesky factor may not exist."""
    values, vectors = np.linalg.eigh(matrix)
    root: Array = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return root


def with_discrepancy(
    likelihood: Likelihood, travel: Array, points: Array, share: float, *, common: float = COMMON
) -> Likelihood:
    """The likelihood of a model that errs by a relative SD of `share`, forces by `common` times it.

    In the field it is that share of the root mean square over the points of the predicted
    displacement's offset, at each increment; the larger of the components counts for all, since a
    wrong contact moves material sideways where the model has it move down.
    Raises ValueError for a share that is not positive.
    """
    if not share > 0:
        raise ValueError(f"share: expected a positive relative SD, got {share}")
    errors = replace(likelihood.errors, factor=factor_covariance(travel, share, common))
    field = likelihood.field
    if field is None:
        return replace(likelihood, errors=errors)
    rms = np.sqrt(np.mean(field.basis.offset**2, axis=1))
    size = share * np.repeat(rms.max(axis=1)[:, None], 3, axis=1)
    patterns = field_discrepancy(points, travel, size)
    covariance = field.covariance.with_patterns(patterns)
    return replace(likelihood, errors=errors, field=replace(field, covariance=covariance))
