"""Proper orthogonal decomposition of snapshots, and the covariance of what it leaves out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from surrogate.array_checks import check_arrays

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Pod:
    """Snapshots y_i = offset + modes @ weights_i + what is left out, in the unit of y."""

    offset: Array
    """(n_obs,) mean of the snapshots"""
    modes: Array
    """(n_obs, k) modes in the unit of y, strongest first; orthonormal once divided by the scale"""
    scale: Array
    """(n_obs,) what a value is divided by before it is compared with others; 1 by default"""
    truncation: Array
    """(n, n_obs) what the modes of the other runs leave out of each run"""
    weight: Array
    """(n,) share of each run in the truncation covariance, sums to 1"""

    def __post_init__(self) -> None:
        n_obs, n = self.offset.size, self.weight.size
        k = self.modes.shape[1] if self.modes.ndim == 2 else 0
        shapes = {
            "offset": (n_obs,),
            "modes": (n_obs, k),
            "scale": (n_obs,),
            "truncation": (n, n_obs),
            "weight": (n,),
        }
        check_arrays(self, shapes)

    @property
    def truncation_factor(self) -> Array:
        """(n_obs, n) factor L of the truncation covariance L @ L.T."""
        factor: Array = self.truncation.T * np.sqrt(self.weight)
        return factor

    @property
    def truncation_variance(self) -> Array:
        """(n_obs,) diagonal of the truncation covariance."""
        variance: Array = self.weight @ self.truncation**2
        return variance

    @property
    def left_out_variance(self) -> Array:
        """(n_obs,) mean over all runs of what is left out of them, squared."""
        variance: Array = np.mean(self.truncation**2, axis=0)
        return variance

    def weights(self, snapshots: Array) -> Array:
        """(m, k) coordinates of snapshots (m, n_obs) in the modes: least squares over the scale."""
        projected: Array = (snapshots - self.offset) @ self.dual
        return projected

    @property
    def dual(self) -> Array:
        """(n_obs, k) with dual.T @ modes = 1: weights are its products with deviations."""
        dual: Array = self.modes / self.scale[:, None] ** 2
        return dual

    def reconstruct(self, weights: Array) -> Array:
        """(m, n_obs) snapshots of weights (m, k)."""
        snapshots: Array = self.offset + weights @ self.modes.T
        return snapshots


def fit_pod(
    snapshots: Array,
    *,
    tolerance: float,
    max_modes: int,
    weight: Array | None = None,
    scale: Array | None = None,
) -> Pod:
    """Decompose snapshots (n, n_obs), n >= 2, by a thin singular value decomposition.

    Keeps the fewest modes that leave out less than the share `tolerance` of the root mean square
    of the snapshots about their mean, at most `max_modes`; tolerance 0 keeps every mode. The
    signs are fixed by the largest entry of each mode. The truncation is measured run by run on
    modes fitted without that run (Sirovich 1987 for the decomposition; leaving a run out because
    the residual of a fitted run flatters the basis); `weight` (n,) says how much each run counts in
    its covariance, by default as much as any other. Values are divided by `scale` (n_obs,) first,
    so that those known better count more. Raises ValueError for fewer than 2 snapshots or snapshots
    that are all the same.
    """
    n = len(snapshots)
    if n < 2:
        raise ValueError(f"snapshots: need at least 2 runs, got {n}")
    offset = snapshots.mean(axis=0)
    if not np.ptp(snapshots, axis=0).any():
        raise ValueError(f"snapshots: must vary, got {n} times the same")
    scale = np.ones(snapshots.shape[1]) if scale is None else scale
    left, values, right = np.linalg.svd((snapshots - offset) / scale, full_matrices=False)
    rank = int(np.count_nonzero(values > values[0] * max(snapshots.shape) * np.finfo(float).eps))
    k = min(_count(values[:rank], tolerance), max_modes)
    largest = np.argmax(np.abs(right[:k]), axis=1)
    sign = np.sign(right[np.arange(k), largest])
    coordinates = left[:, :rank] * values[:rank]
    if k == snapshots.shape[1]:
        truncation = np.zeros_like(snapshots)
    else:
        truncation = _left_out(coordinates, k) @ (right[:rank] * scale)
    counts = np.ones(n) if weight is None else weight
    modes = (right[:k] * sign[:, None] * scale).T
    return Pod(offset, modes, scale, truncation, counts / counts.sum())


def _count(values: Array, tolerance: float) -> int:
    """Fewest leading singular values whose rest is below the tolerance, in root sum of squares."""
    energy = values**2
    rest = np.append(np.cumsum(energy[::-1])[::-1][1:], 0.0)
    enough = rest <= tolerance**2 * energy.sum()
    return int(np.argmax(enough)) + 1


def _left_out(coordinates: Array, k: int) -> Array:
    """(n, rank) residual of each row after projection on the first k modes of the other rows.

    In the coordinates of the full decomposition, where the n decompositions are small and exact.
    """
    residual = np.empty_like(coordinates)
    k = min(k, len(coordinates) - 2)  # the others about their mean span no more
    for run in range(len(coordinates)):
        others = np.delete(coordinates, run, axis=0)
        mean = others.mean(axis=0)
        modes = np.linalg.svd(others - mean, full_matrices=False)[2][:k]
        deviation = coordinates[run] - mean
        residual[run] = deviation - (deviation @ modes.T) @ modes
    return residual
