"""Stationary covariances of a function and of its derivatives, and their slopes by the lengths.

A covariance is phi(s) of the scaled squared distance s = sum_i (x_i - x'_i)^2 / l_i^2. With
a_i = (x_i - x'_i) / l_i that of the derivatives is (Rasmussen & Williams 2006, section 9.4)

    cov(f(x), f(x'))            = phi
    cov(f(x), d_j f(x'))        = -2 phi' a_j / l_j
    cov(d_i f(x), d_j f(x'))    = (-4 phi'' a_i a_j - 2 phi' delta_ij) / (l_i l_j)

A row of a covariance matrix is a value or a derivative of one point; `Rows` says which.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

FAMILIES = ("matern32", "matern52", "rbf")
"""Matern covariances of smoothness 3/2 and 5/2, and the squared exponential"""


class Rows(NamedTuple):
    """Values and derivatives of n points as rows of a matrix: first all values."""

    of_point: IntArray
    """(n, 1 + d) row of the value, then of the derivative by each input; -1 where there is none"""
    n_rows: int

    @property
    def is_slope(self) -> npt.NDArray[np.bool_]:
        """(n_rows,) whether a row is a derivative."""
        return np.arange(self.n_rows) >= len(self.of_point)


def rows_of(usable: npt.NDArray[np.bool_]) -> Rows:
    """Rows of n values and of the derivatives that `usable` (n, d) marks, run by run."""
    n, d = usable.shape
    index = np.full((n, 1 + d), -1, dtype=np.int64)
    index[:, 0] = np.arange(n)
    index[:, 1:][usable] = n + np.arange(np.count_nonzero(usable))
    return Rows(index, n + int(np.count_nonzero(usable)))


def values_only(n: int, d: int) -> Rows:
    """Rows of n values without derivatives."""
    return rows_of(np.zeros((n, d), dtype=np.bool_))


def prior_variance(family: int, length: Array, rows: Rows) -> Array:
    """(n_rows,) variance of each row at unit amplitude: 1 for values, -2 phi'(0) / l^2 else."""
    slope = -2.0 * _derivatives(0.0, family)[1] / length**2
    each = np.concatenate([[1.0], slope])
    variance = np.empty(rows.n_rows)
    point, column = np.nonzero(rows.of_point >= 0)
    variance[rows.of_point[point, column]] = each[column]
    return variance


def covariance(
    family: int, length: Array, x: Array, x_rows: Rows, other: Array, other_rows: Rows
) -> Array:
    """(n_rows, m_rows) covariance at unit amplitude of rows at x (n, d) and at other (m, d)."""
    filled = np.empty((x_rows.n_rows, other_rows.n_rows))
    _fill(filled, family, length, x, x_rows.of_point, other, other_rows.of_point)
    return filled


def slopes_by_length(family: int, length: Array, x: Array, rows: Rows, weight: Array) -> Array:
    """(d,) sum of weight * dC / d ln l_m over the entries of C, the covariance of rows at x.

    `weight` (n_rows, n_rows) must be symmetric, as C is.
    """
    slopes: Array = _slopes_by_length(family, length, x, rows.of_point, weight)
    return slopes


def mean_gradient(
    family: int, length: Array, x: Array, other: Array, rows: Rows, weights: Array
) -> Array:
    """(n, d, k) derivative by x (n, d) of covariance(x, other) @ weights (m_rows, k)."""
    gradient: Array = _mean_gradient(family, length, x, other, rows.of_point, weights)
    return gradient


@nb.njit(cache=True)
def _derivatives(s: float, family: int) -> tuple[float, float, float, float]:
    """phi(s) and its first three derivatives; what is singular at s = 0 only meets zeros there."""
    if family == 2:
        e = np.exp(-0.5 * s)
        return e, -0.5 * e, 0.25 * e, -0.125 * e
    if family == 1:
        q = np.sqrt(5.0 * s)
        e = np.exp(-q)
        third = -125.0 / 24.0 * e / q if q > 0.0 else 0.0
        return (1.0 + q + q * q / 3.0) * e, -5.0 / 6.0 * (1.0 + q) * e, 25.0 / 12.0 * e, third
    q = np.sqrt(3.0 * s)
    e = np.exp(-q)
    if q == 0.0:
        return 1.0, -1.5, 0.0, 0.0
    return (1.0 + q) * e, -1.5 * e, 2.25 * e / q, -27.0 / 8.0 * (1.0 + q) * e / q**3


@nb.njit(cache=True)
def _fill(
    filled: Array,
    family: int,
    length: Array,
    x: Array,
    x_index: IntArray,
    other: Array,
    other_index: IntArray,
) -> None:
    d = len(length)
    a = np.empty(d)
    for p in range(len(x)):
        for q in range(len(other)):
            s = 0.0
            for i in range(d):
                a[i] = (x[p, i] - other[q, i]) / length[i]
                s += a[i] * a[i]
            phi, first, second, _ = _derivatives(s, family)
            if x_index[p, 0] >= 0 and other_index[q, 0] >= 0:
                filled[x_index[p, 0], other_index[q, 0]] = phi
            for i in range(d):
                cross = 2.0 * first * a[i] / length[i]
                row, column = x_index[p, 1 + i], other_index[q, 1 + i]
                if row >= 0 and other_index[q, 0] >= 0:
                    filled[row, other_index[q, 0]] = cross
                if column >= 0 and x_index[p, 0] >= 0:
                    filled[x_index[p, 0], column] = -cross
                if row < 0:
                    continue
                for j in range(d):
                    column = other_index[q, 1 + j]
                    if column >= 0:
                        both = -4.0 * second * a[i] * a[j]
                        if i == j:
                            both -= 2.0 * first
                        filled[row, column] = both / (length[i] * length[j])


@nb.njit(cache=True)
def _slopes_by_length(
    family: int, length: Array, x: Array, index: IntArray, weight: Array
) -> Array:
    """Each pair of points once; those off the diagonal of the matrix count twice."""
    n, d = x.shape
    total, own, a = np.zeros(d), np.empty(d), np.empty(d)
    for p in range(n):
        for q in range(p + 1):
            s = 0.0
            for i in range(d):
                a[i] = (x[p, i] - x[q, i]) / length[i]
                s += a[i] * a[i]
            _, first, second, third = _derivatives(s, family)
            own[:] = 0.0
            # The part by s, which depends on all lengths: ds / d ln l_m = -2 a_m^2.
            by_s = weight[index[p, 0], index[q, 0]] * first
            for j in range(d):
                row = index[p, 1 + j]
                cross = 0.0
                if index[q, 1 + j] >= 0:
                    cross -= weight[index[p, 0], index[q, 1 + j]]
                if row >= 0:
                    cross += weight[row, index[q, 0]]
                cross *= 2.0 * a[j] / length[j]
                by_s += cross * second
                own[j] -= 2.0 * cross * first  # a_j / l_j falls as l_j^-2
                if row < 0:
                    continue
                for i in range(d):
                    column = index[q, 1 + i]
                    if column < 0:
                        continue
                    both = weight[row, column] / (length[i] * length[j])
                    by_s -= 4.0 * both * third * a[i] * a[j]
                    own[i] += 8.0 * both * second * a[i] * a[j]
                    own[j] += 8.0 * both * second * a[i] * a[j]
                    if i == j:
                        by_s -= 2.0 * both * second
                        own[j] += 4.0 * both * first
            times = 1.0 if p == q else 2.0
            for m in range(d):
                total[m] += times * (own[m] - 2.0 * a[m] * a[m] * by_s)
    return total


@nb.njit(cache=True)
def _mean_gradient(
    family: int, length: Array, x: Array, other: Array, index: IntArray, weights: Array
) -> Array:
    n, d = x.shape
    k = weights.shape[1]
    gradient = np.zeros((n, d, k))
    a = np.empty(d)
    for p in range(n):
        for q in range(len(other)):
            s = 0.0
            for i in range(d):
                a[i] = (x[p, i] - other[q, i]) / length[i]
                s += a[i] * a[i]
            _, first, second, _ = _derivatives(s, family)
            for i in range(d):
                value = 2.0 * first * a[i] / length[i]
                for c in range(k):
                    gradient[p, i, c] += value * weights[index[q, 0], c]
                for j in range(d):
                    row = index[q, 1 + j]
                    if row < 0:
                        continue
                    both = -4.0 * second * a[i] * a[j]
                    if i == j:
                        both -= 2.0 * first
                    both /= length[i] * length[j]
                    for c in range(k):
                        gradient[p, i, c] += both * weights[row, c]
    return gradient
