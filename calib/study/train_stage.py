"""Stage `train`: a first emulator of each hypothesis, and its errors on runs held out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.study.artifacts import read_json, write_json
from calib.study.config import Study
from calib.study.context import Context
from calib.study.sections import EmulatorLimits, Hypothesis
from calib.study.simulate_stage import load_design
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import Emulator, EmulatorDiagnostics, TrainingSet, diagnose

MAX_RMS_Z = 3.0
"""largest RMS of error over stated SD; of four independent values it is above 2 once in 300 studies
and above 3 once in 3 million, so that only an emulator that is too sure of itself is refused"""
DIAGNOSTICS = "diagnostics.json"
FIRST = "first"
"""folder of the emulators trained on the design alone"""


@dataclass(frozen=True)
class HeldOutErrors:
    """Force errors on every run held out."""

    relative: Array
    """(n_run, n_step) emulator over FE minus one"""
    standardised: Array
    """(n_run, n_step) error of the force over its stated SD"""


def run(context: Context) -> list[Path]:
    """Train, judge and keep the first emulators; returns their files and diagnostics."""
    sets = {
        hypothesis.name: split(load_design(context, hypothesis), context.study.design.n_runs)
        for hypothesis in context.study.hypotheses
    }
    return fit_and_judge(context, context.out / FIRST, sets)


def fit_and_judge(
    context: Context, folder: Path, sets: dict[str, tuple[TrainingSet, TrainingSet | None]]
) -> list[Path]:
    """Fit, judge and keep the emulators of {hypothesis: (training, held out)}; returns the files.

    Their diagnostics are told and kept beside them.
    """
    paths = []
    found = {}
    with_field = has_field(context.study)
    for hypothesis in context.study.hypotheses:
        training, held_out = sets[hypothesis.name]
        emulator = Emulator.fit(training, context.study.seed)
        path = emulator_path(folder, hypothesis)
        path.parent.mkdir(parents=True, exist_ok=True)
        emulator.save(path)
        paths.append(path)
        diagnostics = diagnose(emulator, training, held_out)
        found[hypothesis.name] = describe(
            diagnostics, held_out_errors(emulator, held_out), context.study.emulator, with_field
        )
        context.echo(f"  {hypothesis.name}: {one_line(diagnostics)}")
    write_json(folder / DIAGNOSTICS, found)
    return [*paths, folder / DIAGNOSTICS]


def has_field(study: Study) -> bool:
    """Whether the study's data have a field, so that the error of the emulated field matters."""
    return study.virtual is not None or study.data.is_experiment


def split(campaign: Campaign, n_train: int) -> tuple[TrainingSet, TrainingSet | None]:
    """Training runs and, where any reached the last increment, the runs held out."""
    parts = []
    for rows in (slice(None, n_train), slice(n_train, None)):
        parts.append(
            TrainingSet.from_runs(
                campaign.theta[rows],
                campaign.force[rows],
                campaign.displacement[rows],
                campaign.reached[rows],
            )
        )
    training, held_out = parts
    return training, held_out if len(held_out.ratios) else None


def held_out_errors(emulator: Emulator, held_out: TrainingSet | None) -> HeldOutErrors:
    """Errors of the force run by run; no rows without runs held out."""
    if held_out is None:
        empty = np.zeros((0, emulator.n_step))
        return HeldOutErrors(empty, empty)
    mean, covariance = emulator.unit_force(held_out.ratios)
    error = mean - held_out.force
    std = np.sqrt(np.einsum("nii->ni", covariance))
    return HeldOutErrors(error / held_out.force, error / std)


def describe(
    diagnostics: EmulatorDiagnostics,
    held_out: HeldOutErrors,
    limits: EmulatorLimits,
    with_field: bool,
) -> dict[str, object]:
    """All that is known of an emulator's error, with the rules of the study that it violates.

    The rule on the field holds where the data have one (`with_field`).
    """
    max_field_error = limits.max_field_error if with_field else np.inf
    failures = diagnostics.within(limits.max_force_error, max_field_error, MAX_RMS_Z)
    return {
        **diagnostics.to_dict(),
        "held_out_relative_error": held_out.relative,
        "held_out_standardised_error": held_out.standardised,
        "limits": limits,
        "max_rms_z": MAX_RMS_Z,
        "failures": failures,
        "units": {"force": "relative", "field": "mm"},
    }


def one_line(diagnostics: EmulatorDiagnostics) -> str:
    """The errors by which an emulator is judged, in words."""
    errors = diagnostics.judged
    kind = "leave-one-out" if diagnostics.held_out is None else "held-out"
    text = (
        f"{diagnostics.n_train} training runs, {errors.n_runs} {kind}: force error RMS "
        f"{100 * max(errors.force_rms):.3f} % at the worst increment, largest "
        f"{100 * errors.force_max:.3f} %"
    )
    if errors.field_rms is not None:
        text += f", field RMS {max(errors.field_rms):.2g} mm"
    return text


def emulator_path(out: Path, hypothesis: Hypothesis) -> Path:
    """File of a hypothesis' emulator."""
    return out / f"emulator_{hypothesis.name}.npz"


def load_emulator(out: Path, hypothesis: Hypothesis) -> Emulator:
    """Read a hypothesis' emulator; raises ValueError naming a damaged file."""
    return Emulator.load(emulator_path(out, hypothesis))


def load_diagnostics(out: Path) -> dict[str, dict[str, Any]]:
    """Read diagnostics.json: hypothesis -> what `describe` says."""
    found: dict[str, dict[str, Any]] = read_json(out / DIAGNOSTICS)
    return found
