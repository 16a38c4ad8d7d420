"""The Newton direction of an indefinite matrix with its negative curvature flipped.

K^-1 b - 2 W (W' K W)^-1 W' b, where W spans as many directions as K has negative pivots and
W' K W is negative definite: then K is positive definite on the K-conjugate complement of W, and
the direction is that of the positive definite matrix that differs from K by the sign on W.  With
eigenvectors for W that is the saddle-free Newton method (Dauphin et al., NeurIPS 2014); but any
such W goes down, and one found early in a Lanczos process costs few solves.

Where there are many negative pivots, as in the midst of a snap of a block pressed flat, their
modes are not sought: a multiple of the diagonal's size is added that makes K positive definite
(Nocedal & Wright 2006, section 3.4).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fe.linear_solver import SymmetricSolver
from fe.singular_tangent import SingularTangentError

Array = npt.NDArray[np.float64]

MOST_SOLVES = 60
SHIFTS = tuple(0.04 * 25.0**k for k in range(5))
"""shares of the diagonal's median that are tried one after the other"""
SETTLED = 0.3
"""relative change of the negative Ritz values, from one solve to the next, that ends the search"""


def flip_negative(solver: SymmetricSolver, x: Array, b: Array, count: int) -> Array:
    """(n,) direction for the right side b from x = K^-1 b of the factorised K.

    `count` modes are flipped; it is x itself where the search finds fewer.
    """
    W, curvature = negative_directions(solver, x, count)
    return x if W.shape[1] < count else x - 2.0 * W @ ((W.T @ b) / curvature)


def shifted_direction(solver: SymmetricSolver, b: Array) -> Array:
    """(n,) (K + s 1)^-1 b with the first of `SHIFTS` that makes the factorised K positive definite.

    What is factorised then is no longer K.  Raises SingularTangentError where none of them does.
    """
    data = solver.data
    for shift in SHIFTS:
        try:
            if solver.factorise(solver.shifted(data, shift)) == 0:
                return solver.solve(b)
        except SingularTangentError:  # no pivoting met a zero: the next shift has none
            continue
    most = f"{SHIFTS[-1]:g} times the median of the diagonal"
    raise SingularTangentError(f"indefinite with {most} added")


def negative_directions(solver: SymmetricSolver, start: Array, count: int) -> tuple[Array, Array]:
    """W (n, m) and the diagonal (m,) of W' K W < 0, m <= `count`; W' K W is diagonal.

    Lanczos with K^-1 and full orthogonalisation from `start` (n,): where a Ritz value
    y' Q' K^-1 Q y is negative, so is w' K w of w = K^-1 Q y.
    """
    n = start.size
    most = min(n, MOST_SOLVES)
    Q, Z = np.empty((n, most)), np.empty((n, most))
    before = np.zeros(count)
    # a random part, so that no mode is missed by symmetry
    q = start / np.linalg.norm(start) + np.random.default_rng(0).standard_normal(n) / np.sqrt(n)
    for k in range(most):
        for _ in range(2):
            q = q - Q[:, :k] @ (Q[:, :k].T @ q)
        size = float(np.linalg.norm(q))
        if not size > 1e-12:  # so is NaN
            break
        Q[:, k] = q / size
        Z[:, k] = solver.solve(Q[:, k])
        if not np.isfinite(Z[:, k]).all():
            break
        T = Q[:, : k + 1].T @ Z[:, : k + 1]
        values, vectors = np.linalg.eigh((T + T.T) / 2.0)
        lowest = values[:count]
        if k + 1 >= count and lowest[-1] < 0.0:
            if (np.abs(lowest - before) <= SETTLED * np.abs(lowest)).all() or k + 1 == most:
                return Z[:, : k + 1] @ vectors[:, :count], lowest
            before = lowest
        q = Z[:, k] / float(np.linalg.norm(Z[:, k]))
    return np.zeros((n, 0)), np.zeros(0)
