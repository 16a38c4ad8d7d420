"""What is known of an emulator's error: by run, by point, against the noise and the limits."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from calib.study.config import Study
from calib.study.data_stage import measured
from calib.study.training_runs import PartialRuns
from fe.response import Array
from surrogate import (
    Emulator,
    EmulatorDiagnostics,
    Errors,
    Residuals,
    TrainingSet,
    diagnose,
    held_out_residuals,
    leave_one_out_residuals,
)

MAX_RMS_Z = 3.0
"""largest RMS of error over stated SD; of four independent values it is above 2 once in 300 studies
and above 3 once in 3 million, so that only an emulator that is too sure of itself is refused"""


class Noise(NamedTuple):
    """What the measurement leaves unknown: as the study states it, or as its data have it."""

    force: Array
    """(n_step,) standard error of the mean force over the force"""
    field: float | None
    """smallest SD of a displacement component, mm; None without a field"""


class Judged(NamedTuple):
    """Errors of one emulator: as JSON data, and as maps of the front face."""

    facts: dict[str, Any]
    maps: dict[str, Array]
    """kind of residual -> (n_step, n_point) root mean square over runs and components, mm"""
    diagnostics: EmulatorDiagnostics


def has_field(study: Study) -> bool:
    """Whether the study's data have a field, so that the error of the emulated field matters."""
    return study.data.has_field


def measurement_noise(study: Study) -> Noise:
    """The noise by which errors of an emulator are measured; before there are data, too.

    Raises StudyError when measured data cannot be read.
    """
    virtual = study.virtual
    if virtual is not None:
        share = virtual.force_sd_share / np.sqrt(virtual.n_samples)
        field = min(virtual.field_noise_std) if has_field(study) else None
        return Noise(np.full(len(study.increments), share), field)
    data = measured(study).dataset
    field = None if data.field is None else float(np.min(data.field.noise_std))
    return Noise(data.force_sd / data.force_mean / np.sqrt(data.n_samples), field)


def judge(
    emulator: Emulator,
    training: TrainingSet,
    held_out: TrainingSet | None,
    partial: PartialRuns,
    study: Study,
) -> Judged:
    """All that is known of an emulator's error, with the rules of the study that it violates.

    The rules on the field hold where the data have one.
    """
    diagnostics = diagnose(emulator, training, held_out)
    residuals = {"leave_one_out": (training, leave_one_out_residuals(emulator, training))}
    if held_out is not None:
        residuals["held_out"] = (held_out, held_out_residuals(emulator, held_out))
    limits = study.emulator
    max_field_error = limits.max_field_error if has_field(study) else None
    failures = diagnostics.within(limits.max_force_error, max_field_error, MAX_RMS_Z)
    facts = {
        **diagnostics.to_dict(),
        "n_with_gradients": _with_gradients(training),
        "runs": {kind: _by_run(*found) for kind, found in residuals.items()},
        "partial_runs": partial,
        "share_of_noise": _share_of_noise(diagnostics.judged, measurement_noise(study)),
        "limits": limits,
        "max_rms_z": MAX_RMS_Z,
        "failures": failures,
        "units": {"force": "relative", "field": "mm", "reached": "mm"},
    }
    maps = {
        kind: found.field_rms_by_point
        for kind, (_, found) in residuals.items()
        if found.field_rms_by_point is not None
    }
    return Judged(facts, maps, diagnostics)


def one_line(diagnostics: EmulatorDiagnostics, n_with_gradients: int) -> str:
    """The errors by which an emulator is judged, in words."""
    errors = diagnostics.judged
    kind = "leave-one-out" if diagnostics.held_out is None else "held-out"
    text = (
        f"{diagnostics.n_train} training runs ({n_with_gradients} with derivatives), "
        f"{errors.n_runs} {kind}: force error RMS "
        f"{100 * max(errors.force_rms):.3f} % at the worst increment, largest "
        f"{100 * errors.force_max:.3f} %"
    )
    if errors.field_rms is not None:
        text += f", field RMS {max(errors.field_rms):.2g} mm"
    return text


def _by_run(runs: TrainingSet, residuals: Residuals) -> dict[str, Array | None]:
    error = residuals.field_error
    return {
        "ratios": runs.ratios,
        "relative_force_error": residuals.force_error / residuals.force,
        "standardised_error": residuals.force_z,
        "field_rms": None if error is None else np.sqrt(np.mean(error**2, axis=(2, 3))),
    }


def _with_gradients(training: TrainingSet) -> int:
    """Runs whose forces teach by at least one derivative."""
    slopes = training.force_gradient
    if slopes is None:
        return 0
    usable = np.isfinite(slopes).all(axis=1)
    return int(np.count_nonzero(np.any(usable, axis=1)))


def _share_of_noise(errors: Errors, noise: Noise) -> dict[str, float | None]:
    """Root mean square errors over the noise, worst increment."""
    field = None
    if noise.field is not None and errors.field_rms is not None:
        field = max(errors.field_rms) / noise.field
    return {"force": float(np.max(np.array(errors.force_rms) / noise.force)), "field": field}
