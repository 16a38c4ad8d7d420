"""Errors of the force: spread between samples, load cell, discretisation and travel zero."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from calib.data.dataset import Dataset
from fe.response import Array

LOAD_CELL_SD = 0.25 / 12**0.5
"""SD of the load-cell noise, N: 0.25 N (thesis section 5.1) read as peak to peak, uniform."""


@dataclass(frozen=True)
class NoiseSettings:
    """Assumptions on the errors of the measured forces; docs/inference.md gives the reasons.

    Raises ValueError when a value is impossible.
    """

    load_cell_sd: float = LOAD_CELL_SD
    """SD of the load cell's noise in one reading, N"""
    sample_correlation: float = 0.9
    """correlation rho of one sample's deviation between neighbouring increments, (-1, 1)"""
    travel_zero_sd: float = 0.02
    """SD of the error in the zero of the pin travel, common to all increments, mm"""

    def __post_init__(self) -> None:
        for name in ("load_cell_sd", "travel_zero_sd"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"{name}: expected zero or a positive number, got {value}")
        if not -1 < self.sample_correlation < 1:
            raise ValueError(
                f"sample_correlation: expected in (-1, 1), got {self.sample_correlation}"
            )


def between_sample_covariance(force_sd: Array, load_cell_sd: float, correlation: float) -> Array:
    """(n_step, n_step) covariance of one sample's measured forces, N^2.

    D R D + sigma_n^2 I with R_ij = rho^|i-j| and D_i^2 = s_i^2 - sigma_n^2: the load cell's noise
    sigma_n is part of the SD s_i between samples, independent from reading to reading, and what
    is left of s_i belongs to the sample and is correlated over the increments.
    Raises ValueError when sigma_n is not below every s_i.
    """
    if not load_cell_sd < force_sd.min():
        raise ValueError(
            f"load_cell_sd: must be below the smallest SD between samples, {force_sd.min():.4g} N, "
            f"which contains it, got {load_cell_sd:.4g} N; a peak-to-peak value is not an SD"
        )
    own = np.sqrt(force_sd**2 - load_cell_sd**2)
    step = np.arange(force_sd.size)
    lag = np.abs(step[:, None] - step[None, :])
    covariance: Array = own[:, None] * own[None, :] * np.power(correlation, lag)
    return covariance + load_cell_sd**2 * np.eye(force_sd.size)


def mean_covariance(dataset: Dataset, settings: NoiseSettings) -> Array:
    """(n_step, n_step) covariance of the mean force of `n_samples` samples, N^2.

    As measured between the samples where the dataset has it, else by the settings.
    """
    if dataset.force_covariance is not None:
        return dataset.force_covariance / dataset.n_samples
    covariance = between_sample_covariance(
        dataset.force_sd, settings.load_cell_sd, settings.sample_correlation
    )
    return covariance / dataset.n_samples


def slope_matrix(travel: Array) -> Array:
    """(n_step, n_step) matrix G [1/mm] with dF/dtravel = G F at the given travels [mm].

    Derivative of the cubic spline (not-a-knot) through the origin and the forces: the force is
    zero before the pin touches, and the derivative is linear in the forces.
    """
    knots = np.concatenate([[0.0], travel])
    unit = np.vstack([np.zeros(travel.size), np.eye(travel.size)])
    slope: Array = CubicSpline(knots, unit, axis=0)(travel, 1)
    return slope


@dataclass(frozen=True)
class ForceErrors:
    """Everything in the covariance of the force residual but the emulator's own part."""

    mean: Array
    """(n_step, n_step) covariance of the measured mean, N^2"""
    discretisation: Array
    """(n_step,) relative SD of the discretisation error of the force"""
    travel_zero_sd: float
    """SD of the zero of the travel, mm"""
    slope: Array
    """(n_step, n_step) derivative matrix of `slope_matrix`, 1/mm"""

    def __post_init__(self) -> None:
        n = self.mean.shape[0]
        if self.discretisation.shape != (n,) or not np.all(self.discretisation >= 0):
            raise ValueError(
                f"discretisation: expected {n} relative SDs >= 0, got {self.discretisation}"
            )

    def zero_shift(self, force: Array) -> Array:
        """(n_step, m) change of the forces (n_step, m) by one SD of the travel's zero, N."""
        shift: Array = (self.travel_zero_sd * self.slope) @ force
        return shift

    def covariance(self, force: Array, emulator: Array | None = None) -> Array:
        """(n_step, n_step, m) covariance of the residual without the travel's zero, N^2.

        The batch comes last. `force` (n_step, m) are predicted forces [N] and `emulator`
        (m, n_step, n_step) the emulator's covariance [N^2]. The discretisation error is half common
        to all increments and half independent: e_i f_i e_j f_j (0.5 + 0.5 delta_ij).
        """
        error = np.sqrt(0.5) * self.discretisation[:, None] * force
        total: Array = error[:, None] * error[None, :]
        total += self.mean[:, :, None]
        if emulator is not None:
            total += emulator.transpose(1, 2, 0)
        diagonal = np.arange(force.shape[0])
        total[diagonal, diagonal] += error**2
        return total


def force_errors(
    dataset: Dataset, settings: NoiseSettings, discretisation: Array | float = 0.0
) -> ForceErrors:
    """Errors of the forces of `dataset`; `discretisation` (n_step,) or one relative SD for all."""
    relative = np.broadcast_to(np.asarray(discretisation, dtype=np.float64), dataset.travel.shape)
    return ForceErrors(
        mean=mean_covariance(dataset, settings),
        discretisation=np.array(relative),
        travel_zero_sd=settings.travel_zero_sd,
        slope=slope_matrix(dataset.travel),
    )
