"""Predicted fields with a covariance of low rank: never a matrix of points by points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Wanted = Sequence[int] | Sequence[bool] | npt.NDArray[np.integer | np.bool_]
"""places among steps or points, or a mask of all of them"""


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


def select(shape: tuple[int, int, int], steps: Wanted | None, points: Wanted | None) -> Selection:
    """Rows of some steps and points of a field flattened in the order (step, point, component).

    Steps and points by their places, or by a mask of all of them. Raises ValueError for one that
    the field does not have, for what is no place, and for a mask of another length.
    """
    chosen = [
        _places("steps", np.arange(shape[0]) if steps is None else steps, shape[0]),
        _places("points", np.arange(shape[1]) if points is None else points, shape[1]),
    ]
    rows = np.arange(np.prod(shape)).reshape(shape)[np.ix_(*chosen)]
    return Selection(rows.ravel(), (len(chosen[0]), len(chosen[1]), shape[2]))


def _places(name: str, wanted: Wanted, size: int) -> npt.NDArray[np.int64]:
    """Places among `size` steps or points; raises ValueError as `select` does."""
    found = np.asarray(wanted)
    if found.dtype == np.bool_ and found.shape == (size,):
        found = np.flatnonzero(found)
    is_place = found.ndim == 1 and found.size > 0 and found.dtype.kind in "iu"
    if not is_place or found.min() < 0 or found.max() >= size or np.unique(found).size < found.size:
        raise ValueError(
            f"{name}: expected some of 0 to {size - 1}, each once, or a mask of all {size}, "
            f"found {wanted}"
        )
    return found.astype(np.int64)


def compress(factor: Array, rank: int) -> tuple[Array, Array]:
    """Leading part (n_obs, rank) of a covariance factor (n_obs, n) and the variance of the rest.

    The diagonal is kept exactly: factor @ factor.T = leading @ leading.T + diag(rest) there.
    Raises ValueError for a rank that is not whole or negative.
    """
    if not (isinstance(rank, Integral) and rank >= 0):
        raise ValueError(f"rank: expected a whole number of 0 or more directions, found {rank!r}")
    # In the small space of the columns: n_obs may be large.
    values, vectors = np.linalg.eigh(factor.T @ factor)
    leading = factor @ vectors[:, np.argsort(values)[::-1][:rank]]
    rest = np.sum(factor**2, axis=1) - np.sum(leading**2, axis=1)
    return leading, np.maximum(rest, 0.0)
