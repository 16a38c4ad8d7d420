"""Direction-finding of the method of feasible directions, as a non-negative least-squares problem.

Zoutendijk (Methods of Feasible Directions, 1960) and Vanderplaats (Numerical Optimization
Techniques for Engineering Design, 1984, ch. 6): find d that leads down and away from the active
constraints,

    min over d, t of  t + d^T B d / 2   subject to   grad f d <= t,  grad g_j d <= theta_j t,
                                                     and a d <= 0 for active bounds a,

with push-off factors theta_j. Its dual is the point of least norm |L^-1 A^T lambda|, B = L L^T,
over lambda >= 0 with theta^T lambda = 1, which is, up to a factor, the solution of the non-negative
least-squares problem |[L^-1 A^T; theta^T] lambda - [0; 1]| (both are homogeneous in lambda).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import nnls

from calib.optimize.problem import Array


class Direction(NamedTuple):
    """A feasible direction and the multipliers that prove how far it leads."""

    d: Array
    """(n,)"""
    multipliers: Array
    """(k,) of the rows, summing to one with the push-off factors as weights"""
    slope: float
    """d^T B d >= 0: the decrease promised per unit step; zero at a Fritz-John point"""


def find_direction(rows: Array, push: Array, metric: Array) -> Direction:
    """Direction for rows (k, n), gradients that must not grow, and push-off factors (k,).

    `metric` (n, n) is positive definite. At least one push-off factor must be positive.
    """
    lower = np.linalg.cholesky(metric)
    scale = max(float(np.linalg.norm(rows[0])), 1e-300)
    reduced = solve_triangular(lower, rows.T, lower=True) / scale
    matrix = np.vstack([reduced, push])
    target = np.zeros(len(matrix))
    target[-1] = 1.0
    found, _ = nnls(matrix, target)
    total = float(push @ found)
    if total <= 0.0:  # in rounding only: the target always pulls a row with push-off in
        return Direction(np.zeros(rows.shape[1]), np.zeros(len(rows)), 0.0)
    multipliers: Array = np.asarray(found / total, dtype=np.float64)
    d: Array = -np.linalg.solve(metric, rows.T @ multipliers).astype(np.float64)
    return Direction(d, multipliers, float(d @ metric @ d))
