"""How probable each force is given all the others: what a fit that follows an outlier hides.

A predictive p-value of the data that were fitted asks whether the fit is far from them. With about
as many constants as forces a single wrong force draws the fit to itself, and nothing is far. Left
out, it is held against what the others say.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from calib.inference.coordinates import theta_of
from calib.inference.leave_out import increment_blocks, without_block
from calib.inference.likelihood import Likelihood
from calib.inference.posterior import Posterior
from fe.response import Array


def left_out_p_values(posterior: Posterior, travel: Array) -> Array | None:
    """(n_step,) two-sided probability of a force as far off, given the others, at travels mm.

    Of two forces or more, alone and with normal errors, each by the posterior without it,
    integrated anew; None for other data, whose forces say of one constant only (with a field) or
    allow for outliers. NaN where that posterior cannot be integrated.
    """
    likelihood = posterior.likelihood
    errors = likelihood.errors
    allowing = errors.freedom is not None or errors.discrepancy is not None
    if likelihood.field is not None or allowing or travel.size < 2:
        return None
    below = np.full(travel.size, np.nan)
    for index, block in enumerate(increment_blocks(travel)):
        try:
            left = without_block(posterior, block)
        except ValueError:  # no draws reach it: a remark less, and no reason to end a study
            continue
        kept = left.weights > 0.0
        deviation = _deviation(likelihood, theta_of(left.x[kept]), index)
        below[index] = left.weights[kept] @ ndtr(deviation)
    p_values: Array = 2.0 * np.minimum(below, 1.0 - below)
    return p_values


def _deviation(likelihood: Likelihood, theta: Array, index: int) -> Array:
    """(m,) SDs by which a force lies above its mean given theta (m, n) and the other forces.

    Buerkner, Gabry, Vehtari, Comput. Stat. 36 (2021) 1243, Eqs. 8-9.
    """
    prediction = likelihood.predict(theta)
    precision = np.linalg.inv(likelihood.force_covariance(prediction, theta))[:, index]
    weighted = np.sum(precision * (likelihood.force - prediction.force), axis=1)
    deviation: Array = weighted / np.sqrt(precision[:, index])
    return deviation
