"""The condensed tangent of one element by three matrix products, one a column of blocks [i, k].

Notation of fe.weak_form: n_a nodes, n_q quadrature points, n_p pressure functions.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe.compiled import kernel

Array = npt.NDArray[np.float64]


@kernel()
def left_factors(n_a: int, n_row: int) -> tuple[Array, Array, Array]:
    """Work arrays for the blocks [i, k] of the tangent with k = 0, 1, 2 and i <= k beside."""
    return np.empty((n_row, n_a)), np.empty((n_row, 2 * n_a)), np.empty((n_row, 3 * n_a))


@kernel()
def weighted_tangent(
    left: tuple[Array, Array, Array], G: Array, q: int, w: float, A: Array
) -> None:
    """left[k][3 q + m, i n_a + a] = w A[i, j, k, m] G[3 q + j, a] for i <= k."""
    n_a = G.shape[1]
    for k in range(3):
        into = left[0] if k == 0 else (left[1] if k == 1 else left[2])
        for m in range(3):
            for i in range(k + 1):
                w0, w1, w2 = w * A[i, 0, k, m], w * A[i, 1, k, m], w * A[i, 2, k, m]
                row = into[3 * q + m, i * n_a : (i + 1) * n_a]
                for a in range(n_a):
                    row[a] = w0 * G[3 * q, a] + w1 * G[3 * q + 1, a] + w2 * G[3 * q + 2, a]


@kernel()
def element_tangent(
    left: tuple[Array, Array, Array],
    right: Array,
    coupling: Array,
    stiffness: Array,
    tangent: Array,
) -> None:
    """Fill tangent [a, i, k, b] (N/mm) with G' A G + g' S g, g = coupling (n_p, n_a, 3) mm2.

    S = `stiffness` (n_p, n_p) is that of the element's volume, MPa/mm3.  The last n_p rows of
    both factors take the volume's part; of the symmetric pairs of blocks one is multiplied.
    """
    n_p, n_a, _ = coupling.shape
    first = right.shape[0] - n_p
    for k in range(3):
        into = left[0] if k == 0 else (left[1] if k == 1 else left[2])
        for m in range(n_p):
            for a in range(n_a):
                right[first + m, a] = 0.0
                for n in range(n_p):
                    right[first + m, a] += stiffness[m, n] * coupling[n, a, k]
                for i in range(k + 1):
                    into[first + m, i * n_a + a] = coupling[m, a, i]
        blocks = np.dot(into.T, right)
        for i in range(k + 1):
            for a in range(n_a):
                for b in range(n_a):
                    value = blocks[i * n_a + a, b]
                    tangent[a, i, k, b] = value
                    if i < k:
                        tangent[b, k, i, a] = value
