"""Symmetric elimination of many small positive definite matrices at once, compiled.

The batch comes last and is worked on in groups of `LANES` neighbours, so that the innermost loops
run over vectors that stay in the cache: for n of 5 to 20 several times faster than a LAPACK call
for each matrix, and than whole-batch NumPy, whose temporary arrays leave the cache.
"""

from __future__ import annotations

import numpy as np

from fe.compiled import kernel
from fe.response import Array

LANES = 16


@kernel(error_model="numpy")
def eliminate(covariance: Array, vectors: Array, gram: Array, pivots: Array) -> None:
    """Fill v_i^T covariance^-1 v_j (k, k, m) and the pivots (n, m) of the matrices (n, n, m).

    Of vectors (k, n, m); lower triangles are used. A pivot that is not positive is NaN, and so is
    all that comes of it.
    """
    n, m = covariance.shape[1], covariance.shape[2]
    k = len(vectors)
    work, rest = np.empty((n, n, LANES)), np.empty((k, n, LANES))
    total, own = np.empty((k, k, LANES)), np.empty((n, LANES))
    for start in range(0, m, LANES):
        width = min(LANES, m - start)
        for i in range(n):
            for j in range(i + 1):
                for lane in range(width):
                    work[i, j, lane] = covariance[i, j, start + lane]
                for lane in range(width, LANES):
                    work[i, j, lane] = 1.0 if i == j else 0.0
        _take(rest, vectors, start, width)
        _factor(work, rest, total, own)
        _give(gram, pivots, total, own, start, width)


@kernel(error_model="numpy")
def eliminate_scaled(
    precision: Array, root: Array, vectors: Array, gram: Array, pivots: Array
) -> None:
    """As `eliminate` for the matrices I + R G R, with G (n, n) `precision` and R = diag `root`.

    `root` (n, m) and vectors (k, n, m).
    """
    n, m = root.shape
    k = len(vectors)
    work, rest = np.empty((n, n, LANES)), np.empty((k, n, LANES))
    total, own = np.empty((k, k, LANES)), np.empty((n, LANES))
    scale = np.zeros((n, LANES))
    for start in range(0, m, LANES):
        width = min(LANES, m - start)
        for i in range(n):
            for lane in range(width):
                scale[i, lane] = root[i, start + lane]
            for j in range(i + 1):
                one = 1.0 if i == j else 0.0
                for lane in range(LANES):
                    work[i, j, lane] = one + precision[i, j] * scale[i, lane] * scale[j, lane]
        _take(rest, vectors, start, width)
        _factor(work, rest, total, own)
        _give(gram, pivots, total, own, start, width)


@kernel(error_model="numpy")
def _take(rest: Array, vectors: Array, start: int, width: int) -> None:
    for u in range(rest.shape[0]):
        for i in range(rest.shape[1]):
            for lane in range(width):
                rest[u, i, lane] = vectors[u, i, start + lane]
            for lane in range(width, LANES):
                rest[u, i, lane] = 0.0


@kernel(error_model="numpy")
def _factor(work: Array, rest: Array, total: Array, pivots: Array) -> None:
    """L D L^T of the lower triangles, the vectors carried along."""
    n, k = work.shape[0], rest.shape[0]
    inverse, ratio = np.empty(LANES), np.empty(LANES)
    total[:] = 0.0
    for j in range(n):
        for lane in range(LANES):
            pivot = work[j, j, lane]
            pivots[j, lane] = pivot if pivot > 0.0 else np.nan
            inverse[lane] = 1.0 / pivots[j, lane]
        for u in range(k):
            for v in range(u + 1):
                for lane in range(LANES):
                    total[u, v, lane] += rest[u, j, lane] * rest[v, j, lane] * inverse[lane]
        for i in range(j + 1, n):
            for lane in range(LANES):
                ratio[lane] = work[i, j, lane] * inverse[lane]
            for q in range(j + 1, i + 1):
                for lane in range(LANES):
                    work[i, q, lane] -= ratio[lane] * work[q, j, lane]
            for u in range(k):
                for lane in range(LANES):
                    rest[u, i, lane] -= ratio[lane] * rest[u, j, lane]


@kernel(error_model="numpy")
def _give(gram: Array, pivots: Array, total: Array, own: Array, start: int, width: int) -> None:
    k, n = gram.shape[0], pivots.shape[0]
    for u in range(k):
        for v in range(u + 1):
            for lane in range(width):
                gram[u, v, start + lane] = total[u, v, lane]
                gram[v, u, start + lane] = total[u, v, lane]
    for i in range(n):
        for lane in range(width):
            pivots[i, start + lane] = own[i, lane]
