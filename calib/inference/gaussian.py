"""Batched algebra of small Gaussian densities, vectorised over many parameter vectors."""

from __future__ import annotations

import numpy as np

from fe.response import Array

LOG_2PI = float(np.log(2.0 * np.pi))


def quadratic_and_logdet(covariance: Array, residual: Array) -> tuple[Array, Array]:
    """residual^T covariance^-1 residual and ln |covariance|, for a batch.

    `covariance` (n, n, m) and `residual` (n, m) have the batch last, so that the n elimination
    steps run over contiguous vectors: for n of 5 to 20 several times faster than a LAPACK call
    for each of m matrices. Where a matrix is not positive definite both results are NaN.
    Neither argument is changed.
    """
    work = np.array(covariance, dtype=np.float64, order="C")
    rest = np.array(residual, dtype=np.float64, order="C")
    n, m = rest.shape
    quadratic = np.zeros(m)
    pivots = np.empty((n, m))
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        for j in range(n):
            pivot = work[j, j]
            pivots[j] = np.where(pivot > 0, pivot, np.nan)
            quadratic += rest[j] ** 2 / pivots[j]
            column = work[j + 1 :, j]
            ratio = column / pivot
            rest[j + 1 :] -= ratio * rest[j]
            work[j + 1 :, j + 1 :] -= ratio[:, None] * column[None, :]
        logdet = np.log(pivots).sum(axis=0)
    return quadratic, logdet


def log_density(covariance: Array, residual: Array) -> Array:
    """(m,) log normal density of residuals (n, m) with covariances (n, n, m); -inf if not finite.

    Not finite are predictions of a failed solve and covariances that are not positive definite.
    """
    quadratic, logdet = quadratic_and_logdet(covariance, residual)
    value = -0.5 * (quadratic + logdet + residual.shape[0] * LOG_2PI)
    finite: Array = np.where(np.isfinite(value), value, -np.inf)
    return finite


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
