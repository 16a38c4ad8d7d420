"""Covariances of values at many new points with the runs, laid out for speed.

The same numbers as `surrogate.covariance.covariance` gives, for the one case that every prediction
needs: row by row over contiguous new points, so that loops and exponentials run on vectors.
"""

from __future__ import annotations

import numba as nb
import numpy as np
import numpy.typing as npt

from surrogate.covariance import Rows

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


def value_rows(family: int, length: Array, x: Array, other: Array, rows: Rows) -> Array:
    """(n_rows, m) covariance at unit amplitude of rows at other (n, d) and values at x (m, d)."""
    points = np.ascontiguousarray((x / length).T)
    runs = other / length
    squared = np.empty((len(other), len(x)))
    _distances(squared, points, runs)
    phi, first = _radial(family, squared)
    filled = np.empty((rows.n_rows, len(x)))
    _rows(filled, phi, first, length, points, runs, rows.of_point)
    return filled


def _radial(family: int, squared: Array) -> tuple[Array, Array]:
    """Values phi and phi' at scaled squared distances, see `surrogate.covariance`."""
    if family == 2:
        e = np.exp(-0.5 * squared)
        return e, -0.5 * e
    q = np.sqrt((5.0 if family == 1 else 3.0) * squared)
    e = np.exp(-q)
    if family == 1:
        slope = (1.0 + q) * e
        return slope + q * q / 3.0 * e, -5.0 / 6.0 * slope
    return (1.0 + q) * e, -1.5 * e


@nb.njit(cache=True)
def _distances(squared: Array, points: Array, runs: Array) -> None:
    n, d = runs.shape
    for q in range(n):
        for p in range(points.shape[1]):
            squared[q, p] = 0.0
        for i in range(d):
            own = runs[q, i]
            for p in range(points.shape[1]):
                a = points[i, p] - own
                squared[q, p] += a * a


@nb.njit(cache=True)
def _rows(
    filled: Array,
    phi: Array,
    first: Array,
    length: Array,
    points: Array,
    runs: Array,
    index: IntArray,
) -> None:
    n, d = runs.shape
    for q in range(n):
        value = index[q, 0]
        for p in range(points.shape[1]):
            filled[value, p] = phi[q, p]
        for i in range(d):
            row = index[q, 1 + i]
            if row < 0:
                continue
            own, factor = runs[q, i], -2.0 / length[i]
            for p in range(points.shape[1]):
                filled[row, p] = factor * first[q, p] * (points[i, p] - own)
