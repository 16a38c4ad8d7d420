"""Errors of the force: spread between samples, load cell, discretisation and travel zero."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from calib.data.dataset import Dataset
from calib.inference.discrepancy import (
    COMMON,
    LENGTH,
    TRAVEL_LENGTH,
    ForceDiscrepancy,
    smooth_over,
)
from calib.inference.shared_error import SharedError
from fe.response import Array

LOAD_CELL_SD = 0.25 / 12**0.5
"""SD of the load-cell noise, N: 0.25 N (thesis section 5.1) read as peak to peak, uniform."""
ZERO, COMPLIANCE = "zero of the travel", "compliance of the machine"
GAIN, SCALE = "gain of the load cell", "scale of the field"
FACE = "travel at the face less that of the force"


class ForceSizes(NamedTuple):
    """Unknown sizes of the force's errors, (m,) each, or None where they are known."""

    noise: Array | None
    """factor of the SD of the measured mean's errors"""
    discrepancy: Array | None
    """share by which the model errs"""
    of_force: Array | None
    """SD of the logarithm of the factor common to all travels, over that share"""


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
    """SD of the error in the zero of the pin travel, common to all increments, mm; that of the
    dataset where it states a larger one"""
    compliance_sd: float = 0.0
    """SD of what is left of the machine's compliance, mm/N: the pin travels less by it times the
    measured force"""
    face_travel_sd: float = 0.0
    """SD of the travel that the front face sees less that of the force, mm, common to all
    increments: a pin tilted along its bar comes down further at one end of it"""
    gain_sd: float = 0.0
    """relative SD of the load cell's calibration, common to all increments"""
    field_scale_sd: float = 0.0
    """relative SD of the scale of the measured field, common to all of it; that of the dataset
    where it states a larger one"""
    translation_sd: float = 0.0
    """SD of a rigid translation of the field along each axis, at each increment, mm"""
    rotation_sd: float = 0.0
    """SD of a small rigid rotation of the field about each axis, at each increment, degrees"""
    force_freedom: float | None = None
    """degrees of freedom of the forces' own errors as a Student-t; None is normal"""
    field_freedom: float | None = None
    """degrees of freedom of the field's noise as a Student-t; None is normal"""
    discrepancy: float = 0.0
    """share by which the model errs, where it is known; see `calib.inference.discrepancy`"""
    discrepancy_of_force: float = COMMON
    """SD of the logarithm of the force's factor common to all travels, over that share"""
    discrepancy_length: float = LENGTH
    """distance over the front face over which a discrepancy is correlated, mm"""
    discrepancy_travel_length: float = TRAVEL_LENGTH
    """travel over which a discrepancy is correlated, mm"""

    def __post_init__(self) -> None:
        for name in (
            "load_cell_sd",
            "travel_zero_sd",
            "compliance_sd",
            "face_travel_sd",
            "gain_sd",
            "field_scale_sd",
            "translation_sd",
            "rotation_sd",
            "discrepancy",
            "discrepancy_of_force",
        ):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"{name}: expected zero or a positive number, got {value}")
        for name in ("discrepancy_length", "discrepancy_travel_length"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name}: expected a length in mm, got {getattr(self, name)}")
        for name in ("force_freedom", "field_freedom"):
            freedom = getattr(self, name)
            if freedom is not None and not 1 <= freedom < np.inf:
                raise ValueError(f"{name}: expected 1 or more, got {freedom}")
        if self.force_freedom is not None and self.discrepancy > 0:
            raise ValueError(
                "discrepancy: expected none with Student-t forces: both explain forces that are off"
            )
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

    As measured between the samples where the dataset has it, else by the settings. Of n samples at
    p increments it is uncertain itself: given it, the mean is t-distributed with n - p degrees of
    freedom, whose scale is (n - 1) / (n - p) times as large, its covariance (n - 1) / (n - p - 2)
    times (Anderson, An Introduction to Multivariate Statistical Analysis, 5.2). Student-t forces
    take the scale, normal ones the covariance; with n = p + 2, where there is none, n - 1 times.
    """
    if dataset.force_covariance is not None:
        n, p = dataset.n_samples, dataset.travel.size
        return dataset.force_covariance / n * widening(n, p, settings)
    covariance = between_sample_covariance(
        dataset.force_sd, settings.load_cell_sd, settings.sample_correlation
    )
    return covariance / dataset.n_samples


def widening(n_samples: int, n_step: int, settings: NoiseSettings) -> float:
    """Factor of a covariance measured between samples at some increments, for its own error.

    That of a t-distribution's covariance, or scale under Student-t forces: `mean_covariance`.
    """
    left = n_samples - n_step - (2 if settings.force_freedom is None else 0)
    return (n_samples - 1) / max(left, 1)


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
    further: tuple[SharedError, ...] = ()
    """nuisances of the test beyond the zero of the travel"""
    freedom: float | None = None
    """degrees of freedom of all but the shared nuisances as a multivariate t; None is normal"""
    discrepancy: ForceDiscrepancy | None = None
    """how the model errs by a factor; None where it has no discrepancy"""

    def __post_init__(self) -> None:
        n = self.mean.shape[0]
        if self.discretisation.shape != (n,) or not np.all(self.discretisation >= 0):
            raise ValueError(
                f"discretisation: expected {n} relative SDs >= 0, got {self.discretisation}"
            )

    def factor(self, sizes: ForceSizes | None = None) -> Array | None:
        """(n_step, n_step, 1 or m) covariance of ln of the factor by which the model errs."""
        if self.discrepancy is None:
            return None
        if sizes is None:
            return self.discrepancy.covariance()
        return self.discrepancy.covariance(sizes.discrepancy, sizes.of_force)

    def zero_shift(self, force: Array) -> Array:
        """(n_step, m) change of the forces (n_step, m) by one SD of the travel's zero, N."""
        shift: Array = (self.travel_zero_sd * self.slope) @ force
        return shift

    @property
    def shared(self) -> tuple[SharedError, ...]:
        """All nuisances of the test that forces and field share, the travel's zero first."""
        return (_zero_error(self.travel_zero_sd, self.slope), *self.further)

    def shifts(self, force: Array) -> Array:
        """(q, n_step, m) changes of the forces (n_step, m) by one SD of each nuisance, N."""
        return np.stack([self.zero_shift(force), *(error.force @ force for error in self.further)])

    def to_first_order(self, force: Array, emulator: Array | None) -> Array:
        """(n_step, n_step, m) as `covariance`, with the model's factor for small d, N^2."""
        total, factor = self.covariance(force, emulator), self.factor()
        return total if factor is None else total + force[:, None] * force[None, :] * factor

    def measured(self, sizes: ForceSizes | None = None) -> Array:
        """(n_step, n_step, 1 or m) covariance of the measured mean, N^2."""
        own = self.mean[:, :, None]
        return own if sizes is None or sizes.noise is None else own * sizes.noise**2

    def covariance(
        self, force: Array, emulator: Array | None = None, sizes: ForceSizes | None = None
    ) -> Array:
        """(n_step, n_step, m) covariance without travel's zero and discrepancy, N^2.

        The batch comes last. `force` (n_step, m) are predicted forces [N] and `emulator`
        (m, n_step, n_step) the emulator's covariance [N^2]. The discretisation error is half common
        to all increments and half independent: e_i f_i e_j f_j (0.5 + 0.5 delta_ij). `sizes` where
        those of the errors are unknown.
        """
        error = np.sqrt(0.5) * self.discretisation[:, None] * force
        total: Array = error[:, None] * error[None, :]
        total += self.measured(sizes)
        if emulator is not None:
            total += emulator.transpose(1, 2, 0)
        diagonal = np.arange(force.shape[0])
        total[diagonal, diagonal] += error**2
        return total


def force_errors(
    dataset: Dataset,
    settings: NoiseSettings,
    discretisation: Array | float = 0.0,
    *,
    mean: Array | None = None,
    unknown_discrepancy: bool = False,
) -> ForceErrors:
    """Errors of the forces of `dataset`; `discretisation` (n_step,) or one relative SD for all.

    `mean` (n_step, n_step) N^2 stands in for `mean_covariance`. `unknown_discrepancy`: the share by
    which the model errs comes with `ForceSizes`.
    """
    relative = np.broadcast_to(np.asarray(discretisation, dtype=np.float64), dataset.travel.shape)
    discrepancy = None
    if settings.discrepancy > 0 or unknown_discrepancy:
        discrepancy = ForceDiscrepancy(
            smooth_over(dataset.travel, settings.discrepancy_travel_length),
            settings.discrepancy,
            settings.discrepancy_of_force,
        )
    return ForceErrors(
        mean=mean_covariance(dataset, settings) if mean is None else mean,
        discretisation=np.array(relative),
        travel_zero_sd=travel_zero_sd(dataset, settings),
        slope=slope_matrix(dataset.travel),
        further=further_errors(dataset, settings),
        freedom=settings.force_freedom,
        discrepancy=discrepancy,
    )


def travel_zero_sd(dataset: Dataset, settings: NoiseSettings) -> float:
    """SD of the travel's zero, mm: the study's, or what the data state of it where larger."""
    return max(settings.travel_zero_sd, dataset.travel_zero_sd)


def field_scale_sd(dataset: Dataset, settings: NoiseSettings) -> float:
    """Relative SD of the field's scale: the study's, or that of the calibration where larger."""
    stated = 0.0 if dataset.field is None else dataset.field.scale_sd
    return max(settings.field_scale_sd, stated)


def field_nuisances(dataset: Dataset, settings: NoiseSettings) -> list[SharedError]:
    """The nuisances of the test that move a field, those with an SD."""
    zero = _zero_error(travel_zero_sd(dataset, settings), slope_matrix(dataset.travel))
    found = (zero, *further_errors(dataset, settings))
    return [error for error in found if error.sd > 0 and np.any(error.field)]


def _zero_error(sd: float, slope: Array) -> SharedError:
    return SharedError(ZERO, "mm", sd, sd * slope, sd * slope)


def further_errors(dataset: Dataset, settings: NoiseSettings) -> tuple[SharedError, ...]:
    """Compliance of the machine, travel at the face, gain of the load cell, scale of the field.

    Those with an SD. Compliance c: the pin travels less by c F, F the measured force, so that to
    first order force and field change by -c F times their slope. Gain and scale multiply what is
    predicted.
    """
    n = dataset.travel.size
    nothing, one = np.zeros((n, n)), np.eye(n)
    slope = slope_matrix(dataset.travel)
    by_travel = -dataset.force_mean[:, None] * slope
    scale_sd = field_scale_sd(dataset, settings)
    known = (
        SharedError(COMPLIANCE, "mm/N", settings.compliance_sd, by_travel, by_travel),
        SharedError(FACE, "mm", settings.face_travel_sd, nothing, slope),
        SharedError(GAIN, "1", settings.gain_sd, one, nothing),
        SharedError(SCALE, "1", scale_sd, nothing, one),
    )
    return tuple(
        replace(error, force=error.sd * error.force, field=error.sd * error.field)
        for error in known
        if error.sd > 0 and (dataset.field is not None or error.name not in (FACE, SCALE))
    )
