"""Predicted fields with a covariance of low rank: never a matrix of points by points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class FieldPrediction:
    """Fields at m parameter vectors, n_obs = n_step * n_point * 3 values each.

    The covariance of the i-th is modes @ diag(weight_variance[i]) @ modes.T
    + truncation @ truncation.T + diag(rest).
    """

    shape: tuple[int, int, int]
    """(n_step, n_point, 3) of the steps and points asked for"""
    mean: Array
    """(m, n_step, n_point, 3) mm"""
    modes: Array
    """(n_obs, k)"""
    weight_variance: Array
    """(m, k) mm^2"""
    truncation: Array
    """(n_obs, q) mm"""
    rest: Array
    """(n_obs,) mm^2"""

    @property
    def std(self) -> Array:
        """(m, n_step, n_point, 3) standard deviation, mm."""
        shared = np.sum(self.truncation**2, axis=1) + self.rest
        variance = self.weight_variance @ (self.modes**2).T + shared
        std: Array = np.sqrt(variance).reshape(-1, *self.shape)
        return std

    def factor(self, i: int) -> Array:
        """(n_obs, k + q) factor of the i-th covariance without its diagonal `rest`, mm."""
        return np.hstack([self.modes * np.sqrt(self.weight_variance[i]), self.truncation])


class Selection(NamedTuple):
    """Rows of a flattened field and the shape of what they hold."""

    rows: npt.NDArray[np.int64]
    shape: tuple[int, int, int]


def select(
    shape: tuple[int, int, int], steps: Sequence[int] | None, points: Sequence[int] | None
) -> Selection:
    """Rows of some steps and points of a field flattened in the order (step, point, component).

    Raises ValueError for a step or point that the field does not have.
    """
    chosen = []
    for name, wanted, size in (("steps", steps, shape[0]), ("points", points, shape[1])):
        index = np.arange(size) if wanted is None else np.asarray(wanted, dtype=np.int64)
        if index.ndim != 1 or not len(index) or index.min() < 0 or index.max() >= size:
            raise ValueError(f"{name}: expected some of 0 to {size - 1}, found {wanted}")
        chosen.append(index)
    rows = np.arange(np.prod(shape)).reshape(shape)[np.ix_(*chosen)]
    return Selection(rows.ravel(), (len(chosen[0]), len(chosen[1]), shape[2]))


def compress(factor: Array, rank: int) -> tuple[Array, Array]:
    """Leading part (n_obs, rank) of a covariance factor (n_obs, n) and the variance of the rest.

    The diagonal is kept exactly: factor @ factor.T = leading @ leading.T + diag(rest) there.
    """
    # In the small space of the columns: n_obs may be large.
    values, vectors = np.linalg.eigh(factor.T @ factor)
    leading = factor @ vectors[:, np.argsort(values)[::-1][:rank]]
    rest = np.sum(factor**2, axis=1) - np.sum(leading**2, axis=1)
    return leading, np.maximum(rest, 0.0)
