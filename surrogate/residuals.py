"""Errors of an emulator's forces and fields on runs it has not seen, beside what it stated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from surrogate.coverage import Coverage, coverage, mahalanobis
from surrogate.emulator import Emulator
from surrogate.field_prediction import FieldPrediction
from surrogate.gp import Array
from surrogate.modal import inner_weight
from surrogate.run_scale import RunScale, RunScales, fit_run_scale, mahalanobis_sizes
from surrogate.simultaneous_band import Spread, largest_of_drawn, standardised
from surrogate.training_set import TrainingSet

NORMAL_68 = 0.994457883209753
NORMAL_95 = 1.959963984540054
N_WORST = 10


@dataclass(frozen=True)
class WorstPoint:
    """A place on the front face where the emulated field errs most."""

    step: int
    point: int
    error: float
    """largest error of any run and component, mm"""


@dataclass(frozen=True)
class Errors:
    """Errors of an emulator on unseen runs; z is an error over its predicted SD."""

    n_runs: int
    force_rms: tuple[float, ...]
    """(n_step,) root mean square over runs of the relative force error"""
    force_max: float
    """largest relative force error of any run and step"""
    force_rms_z: float
    """root mean square z of forces over runs and steps; 1 if the uncertainty is true"""
    force_coverage_68: float
    """share of forces within the central 68 % of their prediction"""
    force_coverage_95: float
    force_coverage: Coverage
    field_rms: tuple[float, ...] | None
    """(n_step,) root mean square over runs, points and components, mm"""
    field_max: float | None
    """largest displacement error of any run, mm"""
    field_rms_z: float | None
    """field error over its predicted SD, truncation included, both as root mean squares"""
    field_coverage: Coverage | None
    worst_points: tuple[WorstPoint, ...] | None
    """worst first, each point once"""


@dataclass(frozen=True)
class ErrorShare:
    """Emulator error as a share of the measurement noise, root mean squares, worst step."""

    force: float
    field: float | None


@dataclass(frozen=True)
class Residuals:
    """Emulator minus runs it has not seen, and the SD it stated."""

    force: Array
    """(n, n_step) FE force, N"""
    force_error: Array
    """(n, n_step) N"""
    force_covariance: Array
    """(n, n_step, n_step) N^2"""
    field_error: Array | None
    """(n, n_step, n_point, 3) mm"""
    field_std: Array | None
    """(n, n_step, n_point, 3) mm, truncation included"""
    field_spread: Spread | None
    """of which `field_std` is the diagonal"""
    scales: RunScales = RunScales()  # noqa: RUF009 - immutable
    """of whole runs' errors, which runs left out have told; by default errors are as stated"""
    tells: npt.NDArray[np.bool_] | None = None
    """(n,) runs that tell scales of others, if left out; None: all"""

    @cached_property
    def told_scales(self) -> RunScales:
        """What these runs, left out in turn, tell of the scale of others' errors."""
        tells = np.ones(len(self.force), dtype=np.bool_) if self.tells is None else self.tells
        size, normal = self._force_sizes
        force = fit_run_scale(size[tells], normal[tells])
        if self._field_sizes is None:
            return RunScales(force)
        size, normal = self._field_sizes
        return RunScales(force, fit_run_scale(size[tells], normal[tells]))

    @property
    def force_z(self) -> Array:
        """(n, n_step) standardised errors of the force."""
        return standardised(self.force_error, np.sqrt(np.einsum("nii->ni", self.force_covariance)))

    @property
    def force_ranks(self) -> tuple[Array, Array]:
        """(n,) level of the joint region that each run's forces just lie in, widened and as stated.

        By the Mahalanobis distance (Bastos & O'Hagan 2009, Technometrics 51, 425).
        """
        return self.scales.force.rank(*self._force_sizes), RunScale().rank(*self._force_sizes)

    @property
    def field_ranks(self) -> tuple[Array, Array] | None:
        """(n,) level of the band that each whole field just lies in, widened and as stated."""
        if self._field_sizes is None:
            return None
        return self.scales.field.rank(*self._field_sizes), RunScale().rank(*self._field_sizes)

    @cached_property
    def _force_sizes(self) -> tuple[Array, Array]:
        """Mahalanobis distance of each run's forces (n,), and those of normal errors (n, m).

        In as many directions as the run's covariance has: with few runs fewer than steps.
        """
        size, rank = mahalanobis(self.force_error, self.force_covariance)
        return size, mahalanobis_sizes(rank)

    @cached_property
    def _field_sizes(self) -> tuple[Array, Array] | None:
        """Largest z of each field (n,), and those of fields drawn from its prediction (n, m)."""
        if self.field_error is None or self.field_std is None or self.field_spread is None:
            return None
        flat = (len(self.field_error), -1)
        error, std = self.field_error.reshape(flat), self.field_std.reshape(flat)
        size = np.abs(standardised(error, std)).max(axis=1, initial=0.0)
        return size, largest_of_drawn(std, self.field_spread)

    @property
    def field_rms_by_point(self) -> Array | None:
        """(n_step, n_point) root mean square over runs and components, mm: a map of the error."""
        if self.field_error is None:
            return None
        rms: Array = np.sqrt(np.mean(self.field_error**2, axis=(0, 3)))
        return rms

    def share_of_noise(self, force_noise: Array, field_noise: float) -> ErrorShare:
        """Errors over noise SDs of the force (n_step,) N and of a displacement, mm."""
        force = np.sqrt(np.mean(self.force_error**2, axis=0)) / force_noise
        field = None
        if self.field_error is not None:
            rms = np.sqrt(np.mean(self.field_error**2, axis=(0, 2, 3)))
            field = float(rms.max()) / field_noise
        return ErrorShare(float(force.max()), field)

    def errors(self) -> Errors:
        """All errors in numbers."""
        relative, z = self.force_error / self.force, np.abs(self.force_z)
        error, std = self.field_error, self.field_std
        rms, largest, ratio, covered, worst = None, None, None, None, None
        if error is not None and std is not None:
            rms = tuple(np.sqrt(np.mean(error**2, axis=(0, 2, 3))).tolist())
            largest = float(np.abs(error).max())
            ratio = float(np.sqrt(np.mean(error**2) / np.mean(std**2)))
            covered = coverage(standardised(error, std), self.field_ranks)
            worst = _worst(error)
        return Errors(
            n_runs=len(relative),
            force_rms=tuple(np.sqrt(np.mean(relative**2, axis=0)).tolist()),
            force_max=float(np.abs(relative).max()),
            force_rms_z=float(np.sqrt(np.mean(z**2))),
            force_coverage_68=float(np.mean(z < NORMAL_68)),
            force_coverage_95=float(np.mean(z < NORMAL_95)),
            force_coverage=coverage(z, self.force_ranks),
            field_rms=rms,
            field_max=largest,
            field_rms_z=ratio,
            field_coverage=covered,
            worst_points=worst,
        )


def leave_one_out_residuals(emulator: Emulator, training_set: TrainingSet) -> Residuals:
    """Of the emulator's own training runs, each left out in turn, in closed form.

    Of an emulator of forces the runs may have a field, and the other way round not. Raises
    ValueError for runs at other inputs than the emulator's.
    """
    processes = emulator.force.processes
    inputs = processes.scaled(training_set.ratios)
    if inputs.shape != processes.inputs.shape or not np.allclose(inputs, processes.inputs):
        raise ValueError("training_set: is not the one the emulator was trained on; train again")
    force, covariance = emulator.unit_force_leave_one_out()
    error, std, spread = None, None, None
    if emulator.field is not None:
        pod = emulator.field.pod
        mean, variance = emulator.field.processes.leave_one_out()
        # The residual of a run on modes fitted with it flatters; the one without it does not.
        left_out = pod.truncation.reshape(len(training_set.ratios), *_field(training_set).shape[1:])
        weights = (mean - pod.weights(_field(training_set).reshape(len(mean), -1))) @ pod.modes.T
        error = weights.reshape(left_out.shape) - left_out
        std = np.sqrt(variance @ (pod.modes**2).T + pod.left_out_variance).reshape(error.shape)
        factor = pod.truncation.T / np.sqrt(len(pod.truncation))
        spread = Spread(pod.modes, variance, factor)
    residuals = Residuals(
        training_set.force, force - training_set.force, covariance, error, std, spread
    )
    return replace(residuals, tells=inner_weight(training_set.ratios) > 0.0)


def held_out_residuals(
    emulator: Emulator, runs: TrainingSet, scales: RunScales | None = None
) -> Residuals:
    """Of runs that the emulator was not trained on.

    `scales` of whole runs' errors are those that runs left out tell
    (`leave_one_out_residuals(emulator, training_set).told_scales`), which widen joint regions.
    Raises ValueError for runs of other steps or points than the emulator's.
    """
    force, covariance = emulator.unit_force(runs.ratios)
    if runs.force.shape != force.shape:
        raise ValueError(f"runs: expected {force.shape[1]} steps, found {runs.force.shape[1]}")
    error, std, spread = None, None, None
    if emulator.field is not None:
        field: FieldPrediction = emulator.predict_field(runs.ratios, n_truncation=0)
        if (found := _field(runs)).shape != field.mean.shape:
            raise ValueError(
                f"runs: expected fields {field.mean.shape[1:]} (steps, points, components), found "
                f"{found.shape[1:]}"
            )
        error, std = field.mean - found, field.std
        truncation = emulator.field_truncation_factor
        spread = Spread(field.modes, field.weight_variance, truncation)
    scales = RunScales() if scales is None else scales
    return Residuals(runs.force, force - runs.force, covariance, error, std, spread, scales)


def _worst(error: Array) -> tuple[WorstPoint, ...]:
    by_place = np.abs(error).max(axis=(0, 3))
    step = by_place.argmax(axis=0)
    largest = by_place.max(axis=0)
    points = np.argsort(-largest, kind="stable")[:N_WORST]
    return tuple(WorstPoint(int(step[p]), int(p), float(largest[p])) for p in points)


def _field(runs: TrainingSet) -> Array:
    if runs.displacement is None:
        raise ValueError("displacement: the emulator has a field, these runs have none")
    return runs.displacement
