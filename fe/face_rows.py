"""Sums over the points of a face as products of matrices, which are faster than loops.

Rows of the points that touch are gathered first, then multiplied by their shape functions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel

Array = npt.NDArray[np.float64]

FORCE, BY_TRAVEL, PIN_FORCE_BY_U = 0, 3, 6
"""columns of `FaceRows.vectors`, three each"""


class FaceRows(NamedTuple):
    """Work arrays of one face, a row for each point or part of a point that pushes back."""

    shape: Array
    """(n_row, n_a) shape functions at the point"""
    vectors: Array
    """(n_row, 9) force, N, its derivative in the travel and that of the pin's force in the
    displacement, N/mm"""
    pairs: Array
    """(n_row, n_a (n_a + 1) / 2) products of shape functions a <= b"""
    matrices: Array
    """(n_row, 6 or 15) derivative of the force in the displacement, N/mm: entries i <= k of a
    symmetric part, row by row, then all of another part"""


N_SYMMETRIC = 6
"""columns of the symmetric part"""


@kernel()
def empty_rows(n_row: int, n_a: int, n_column: int) -> FaceRows:
    """Work arrays, not filled, with 6 or 15 columns of `matrices`."""
    return FaceRows(
        np.empty((n_row, n_a)),
        np.empty((n_row, 9)),
        np.empty((n_row, n_a * (n_a + 1) // 2)),
        np.empty((n_row, n_column)),
    )


@kernel()
def none_filled() -> int:
    """0, of which the compiler knows the type alone: for a literal it would compile sums twice."""
    return 0


@kernel()
def add_vectors(
    rows: FaceRows, n: int, force: Array, by_travel: Array, pin_force_by_u: Array
) -> None:
    """Add the first n rows' vectors, to the nodes (n_a, 3) of the face."""
    total = np.dot(rows.shape[:n].T, rows.vectors[:n])
    for a in range(total.shape[0]):
        for i in range(3):
            force[a, i] += total[a, FORCE + i]
            by_travel[a, i] += total[a, BY_TRAVEL + i]
            pin_force_by_u[a, i] += total[a, PIN_FORCE_BY_U + i]


@kernel(inline="always")
def put_shape(rows: FaceRows, n: int, shape: Array) -> None:
    """Put a point's shape functions (n_a,) and their products into row n."""
    pair = 0
    for a in range(shape.size):
        rows.shape[n, a] = shape[a]
        for b in range(a, shape.size):
            rows.pairs[n, pair] = shape[a] * shape[b]
            pair += 1


@kernel()
def sum_matrices(rows: FaceRows, n: int) -> Array:
    """(n_pair, n_column) sums of pairs[q, ab] matrices[q] over the first n rows."""
    total: Array = np.dot(rows.pairs[:n].T, rows.matrices[:n])
    return total


@kernel()
def add_symmetric(total: Array, block: Array) -> None:
    """Add the symmetric part of what `sum_matrices` found to block (n_a, 3, 3, n_a)."""
    n_a = block.shape[0]
    pair = 0
    for a in range(n_a):
        for b in range(a, n_a):
            column = 0
            for i in range(3):
                for k in range(i, 3):
                    value = total[pair, column]
                    column += 1
                    block[a, i, k, b] += value
                    if i < k:
                        block[a, k, i, b] += value
                    if a < b:
                        block[b, i, k, a] += value
                        if i < k:
                            block[b, k, i, a] += value
            pair += 1


@kernel()
def add_other(total: Array, block: Array) -> None:
    """Add the other part to block (n_a, 3, 3, n_a)."""
    n_a = block.shape[0]
    pair = 0
    for a in range(n_a):
        for b in range(a, n_a):
            for i in range(3):
                for k in range(3):
                    value = total[pair, N_SYMMETRIC + 3 * i + k]
                    block[a, i, k, b] += value
                    if a < b:
                        block[b, i, k, a] += value
            pair += 1


@kernel()
def positions(u: Array, nodes: npt.NDArray[np.int64], shape: Array, points: Array) -> Array:
    """(n_q, 3) deformed positions of a face's points, mm.

    u (n_node, 3) mm; of the face: nodes (n_a,), shape functions (n_q, n_a), points (n_q, 3) mm.
    """
    own = np.empty((nodes.size, 3))
    for a in range(nodes.size):
        for i in range(3):
            own[a, i] = u[nodes[a], i]
    moved: Array = points + np.dot(shape, own)
    return moved


@kernel()
def motions(u_gradient: Array, nodes: npt.NDArray[np.int64], shape: Array, points: Array) -> Array:
    """(n_q, 3, n_p) derivatives of `positions`, mm.

    Those of the displacement (n_node, 3, n_p) and of the face's points (n_q, 3, n_p), mm.
    """
    moved = points.copy()
    n_p = moved.shape[2]
    if n_p == 0:  # BLAS takes no empty matrix
        return moved
    own = np.empty((nodes.size, 3 * n_p))
    for a in range(nodes.size):
        own[a] = u_gradient[nodes[a]].reshape(3 * n_p)
    moved += np.dot(shape, own).reshape(moved.shape)
    return moved
