"""Batched algebra of small Gaussian densities, vectorised over many parameter vectors."""

from __future__ import annotations

import numpy as np

from calib.inference.elimination import eliminate, eliminate_scaled
from calib.inference.shared_error import AlongError
from fe.response import Array

LOG_2PI = float(np.log(2.0 * np.pi))


def gram_and_logdet(covariance: Array, vectors: Array) -> tuple[Array, Array]:
    """v_i^T covariance^-1 v_j of a few vectors, and ln |covariance|, for a batch.

    `covariance` (n, n, m) and `vectors` (k, n, m) have the batch last. Returns (k, k, m) and (m,);
    where a matrix is not positive definite both are NaN. Neither argument is changed.
    """
    gram, pivots = _empty(vectors)
    eliminate(covariance, vectors, gram, pivots)
    return gram, np.log(pivots).sum(axis=0)


def scaled_gram_and_logdet(precision: Array, root: Array, vectors: Array) -> tuple[Array, Array]:
    """As `gram_and_logdet` for I + diag(root) precision diag(root).

    `precision` (n, n), `root` (n, m), `vectors` (k, n, m).
    """
    gram, pivots = _empty(vectors)
    eliminate_scaled(precision, root, vectors, gram, pivots)
    return gram, np.log(pivots).sum(axis=0)


def _empty(vectors: Array) -> tuple[Array, Array]:
    k, n, m = vectors.shape
    return np.empty((k, k, m)), np.empty((n, m))


def log_density_along(covariance: Array, residual: Array, errors: Array) -> AlongError:
    """Log normal density of residuals (n, m) when z times `errors` (q, n, m) is taken off them.

    Covariances (n, n, m), without these errors. Not finite where a solve failed or a covariance is
    not positive definite.
    """
    return density_and_misfit(covariance, residual, errors)[0]


def density_and_misfit(
    covariance: Array, residual: Array, errors: Array
) -> tuple[AlongError, Array]:
    """What `log_density_along` gives, and (m,) residual^T covariance^-1 residual."""
    gram, logdet = gram_and_logdet(covariance, np.concatenate([residual[None], errors]))
    value = -0.5 * (gram[0, 0] + logdet + residual.shape[0] * LOG_2PI)
    return AlongError(value, gram[0, 1:], gram[1:, 1:]), gram[0, 0]


def conditional_log_densities(covariance: Array, residual: Array) -> Array:
    """(m, n) log density of each value given all others under the joint normal.

    `covariance` (m, n, n), `residual` (m, n). Buerkner, Gabry, Vehtari, Comput. Stat. 36 (2021)
    1243, Eqs. 8-9: with P = covariance^-1 the conditional variance is 1/P_ii and the residual
    from the conditional mean (P residual)_i / P_ii.
    """
    precision = np.linalg.inv(covariance)
    diagonal = np.diagonal(precision, axis1=1, axis2=2)
    weighted = np.einsum("mij,mj->mi", precision, residual)
    value: Array = -0.5 * (LOG_2PI - np.log(diagonal) + weighted**2 / diagonal)
    return value
