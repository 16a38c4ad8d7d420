"""How good an emulator is: errors of forces and fields on runs it has not seen."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from surrogate.emulator import Emulator
from surrogate.gp import Array
from surrogate.training_set import TrainingSet

NORMAL_68 = 0.994457883209753
NORMAL_95 = 1.959963984540054


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
    field_rms: tuple[float, ...] | None
    """(n_step,) root mean square over runs, points and components, mm"""
    field_max: float | None
    """largest displacement error of any run, mm"""
    field_rms_z: float | None
    """field error over its predicted SD, truncation included, both as root mean squares"""


@dataclass(frozen=True)
class EmulatorDiagnostics:
    """Errors on held-out runs (if there are any) and by leaving out each training run in turn."""

    n_train: int
    n_excluded: int
    """runs of the training design that did not reach every travel"""
    n_held_out_excluded: int
    """held-out runs that did not reach every travel"""
    n_field_modes: int
    field_truncation_std: tuple[tuple[float, ...], ...] | None
    """(n_step, 3) what the field's modes leave out, mm"""
    leave_one_out: Errors
    """closed form: hyperparameters and modes are those of all runs"""
    held_out: Errors | None

    @property
    def judged(self) -> Errors:
        """The errors by which the emulator is judged: of held-out runs if there are any."""
        return self.leave_one_out if self.held_out is None else self.held_out

    def to_dict(self) -> dict[str, object]:
        """Values for JSON."""
        return asdict(self)

    def within(self, tolerance_force: float, tolerance_field: float, max_rms_z: float) -> list[str]:
        """Rules that are violated, one sentence each; an empty list if the emulator is good.

        `tolerance_force` bounds the relative RMS force error at every step, `tolerance_field` the
        RMS displacement error [mm] at every step, `max_rms_z` the RMS of standardised errors.
        """
        errors = self.judged
        source = "leave-one-out" if self.held_out is None else "held-out"
        rules = [
            ("force error (relative RMS, worst step)", max(errors.force_rms), tolerance_force),
            ("force error over its predicted SD (RMS z)", errors.force_rms_z, max_rms_z),
        ]
        if errors.field_rms is not None and errors.field_rms_z is not None:
            rules += [
                ("field error (RMS in mm, worst step)", max(errors.field_rms), tolerance_field),
                ("field error over its predicted SD", errors.field_rms_z, max_rms_z),
            ]
        return [
            f"emulator: {source} {what} is {value:.3g}, above {limit:.3g}"
            for what, value, limit in rules
            if not value <= limit
        ]


def diagnose(
    emulator: Emulator, training_set: TrainingSet, held_out: TrainingSet | None = None
) -> EmulatorDiagnostics:
    """Measure an emulator on the runs it was trained on, left out in turn, and on held-out runs.

    Raises ValueError when `training_set` is not the one of the emulator, or `held_out` is empty.
    """
    if training_set.fingerprint != emulator.header.fingerprint:
        raise ValueError("training_set: is not the one the emulator was trained on; train again")
    if held_out is not None and not len(held_out.ratios):
        raise ValueError("held_out: no run reached every travel; pass None or more runs")
    truncation = None
    if emulator.field is not None:
        truncation = tuple(tuple(row) for row in emulator.field_truncation_std.tolist())
    return EmulatorDiagnostics(
        n_train=len(training_set.ratios),
        n_excluded=training_set.n_excluded,
        n_held_out_excluded=0 if held_out is None else held_out.n_excluded,
        n_field_modes=0 if emulator.field is None else emulator.field_modes.shape[1],
        field_truncation_std=truncation,
        leave_one_out=_leave_one_out_errors(emulator, training_set),
        held_out=None if held_out is None else _held_out_errors(emulator, held_out),
    )


def _leave_one_out_errors(emulator: Emulator, runs: TrainingSet) -> Errors:
    force, covariance = emulator.unit_force_leave_one_out()
    field = None
    if emulator.field is not None:
        pod = emulator.field.pod
        mean, variance = emulator.field.processes.leave_one_out()
        weights = (pod.weights(_flat(runs)) - mean) @ pod.modes.T
        # The residual of a run on modes fitted with it flatters; the one without it does not.
        field = weights + pod.truncation, variance
    return _errors(emulator, runs, force, covariance, field)


def _held_out_errors(emulator: Emulator, runs: TrainingSet) -> Errors:
    force, covariance = emulator.unit_force(runs.ratios)
    field = None
    if emulator.field is not None:
        mean, variance = emulator.field_weights(runs.ratios)
        field = _flat(runs) - emulator.field.pod.reconstruct(mean), variance
    return _errors(emulator, runs, force, covariance, field)


def _flat(runs: TrainingSet) -> Array:
    if runs.displacement is None:
        raise ValueError("displacement: the emulator has a field, these runs have none")
    return runs.displacement.reshape(len(runs.ratios), -1)


def _errors(
    emulator: Emulator,
    runs: TrainingSet,
    force: Array,
    covariance: Array,
    field: tuple[Array, Array] | None,
) -> Errors:
    """Errors from predicted forces [N] and, of the field, errors (n, n_obs), variances (n, k)."""
    relative = force / runs.force - 1.0
    z = np.abs(force - runs.force) / np.sqrt(np.einsum("nii->ni", covariance))
    rms, largest, ratio = None, None, None
    if field is not None and emulator.field is not None:
        error, variance = field
        by_step = error.reshape(len(error), emulator.n_step, -1)
        rms = tuple(np.sqrt(np.mean(by_step**2, axis=(0, 2))).tolist())
        largest = float(np.abs(error).max())
        # Modes are orthonormal: the variance summed over the field is that of the weights.
        predicted = variance.sum() / error.size + emulator.field.pod.truncation_variance.mean()
        ratio = float(np.sqrt(np.mean(error**2) / predicted))
    return Errors(
        n_runs=len(relative),
        force_rms=tuple(np.sqrt(np.mean(relative**2, axis=0)).tolist()),
        force_max=float(np.abs(relative).max()),
        force_rms_z=float(np.sqrt(np.mean(z**2))),
        force_coverage_68=float(np.mean(z < NORMAL_68)),
        force_coverage_95=float(np.mean(z < NORMAL_95)),
        field_rms=rms,
        field_max=largest,
        field_rms_z=ratio,
    )
