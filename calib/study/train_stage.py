"""Stage `train`: a first emulator of each hypothesis, and its errors on runs held out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.study.artifacts import read_json, write_json, write_npz
from calib.study.campaign_tables import label_of
from calib.study.config import Study
from calib.study.context import Context
from calib.study.judgement import judge, one_line
from calib.study.sections import Hypothesis
from calib.study.simulate_stage import load_design
from calib.study.training_runs import held_out_set, partial_runs, rows, training_set
from calib.study.unknowns import parameters_of
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import Emulator, TrainingSet
from surrogate.emulator import FIELD_TOLERANCE

DIAGNOSTICS = "diagnostics.json"
FINER = 0.1
"""of the share of the fields that the modes leave out, after each round of verification: what is
left out moves a maximum by some tenths of an SD where a field is known from many points"""
FIRST = "first"
"""folder of the emulators trained on the design alone"""


@dataclass(frozen=True)
class StudyRuns:
    """Runs of one hypothesis: those that train, those that judge."""

    training: tuple[Campaign, ...]
    held_out: Campaign

    def training_set(self, study: Study) -> TrainingSet:
        """The complete ones of those that train, with derivatives if the study wants them."""
        return training_set(self.training, gradients=study.emulator.gradients)


def run(context: Context) -> list[Path]:
    """Train, judge and keep the first emulators; returns their files and diagnostics."""
    runs = {h.name: design_runs(context, h) for h in context.study.hypotheses}
    return fit_and_judge(context, context.out / FIRST, runs)


def design_runs(context: Context, hypothesis: Hypothesis, *added: Campaign) -> StudyRuns:
    """The design's runs of one hypothesis, and those `added` where the posterior is."""
    design, n = load_design(context, hypothesis), context.study.design.n_runs
    return StudyRuns((rows(design, slice(n)), *added), rows(design, slice(n, None)))


def fit_and_judge(
    context: Context,
    folder: Path,
    runs: dict[str, StudyRuns],
    rounds: Mapping[str, int] | None = None,
) -> list[Path]:
    """Fit, judge and keep the emulators of {hypothesis: runs}; returns the files.

    Each of {hypothesis: `rounds`} of verification leaves out `FINER` times as much of the fields.
    Their diagnostics are told and kept beside them, with maps of their error on the front face.
    """
    paths = []
    found = {}
    for hypothesis in context.study.hypotheses:
        parts = runs[hypothesis.name]
        training, held_out = parts.training_set(context.study), held_out_set(parts.held_out)
        tolerance = FIELD_TOLERANCE * FINER ** (rounds or {}).get(hypothesis.name, 0)
        emulator = Emulator.fit(training, context.study.seed, field_tolerance=tolerance)
        path = emulator_path(folder, hypothesis)
        path.parent.mkdir(parents=True, exist_ok=True)
        emulator.save(path)
        partial = partial_runs(emulator, [*parts.training, parts.held_out])
        judged = judge(emulator, training, held_out, partial, context.study)
        labels = [label_of(p) for p in parameters_of(context.study, hypothesis)]
        found[hypothesis.name] = judged.facts | {"inputs": labels}
        points = context.sampling_model(hypothesis).points()
        write_npz(maps_path(folder, hypothesis), {"points": points, **judged.maps})
        paths += [path, maps_path(folder, hypothesis)]
        line = one_line(judged.diagnostics, judged.facts["n_with_gradients"])
        context.echo(f"  {hypothesis.name}: {line}")
    write_json(folder / DIAGNOSTICS, found)
    return [*paths, folder / DIAGNOSTICS]


def emulator_path(out: Path, hypothesis: Hypothesis) -> Path:
    """File of a hypothesis' emulator."""
    return out / f"emulator_{hypothesis.name}.npz"


def maps_path(out: Path, hypothesis: Hypothesis) -> Path:
    """File of the maps of its error on the front face."""
    return out / f"emulator_{hypothesis.name}_maps.npz"


def load_emulator(out: Path, hypothesis: Hypothesis) -> Emulator:
    """Read a hypothesis' emulator; raises ValueError naming a damaged file."""
    return Emulator.load(emulator_path(out, hypothesis))


def load_maps(out: Path, hypothesis: Hypothesis) -> dict[str, Array]:
    """Read points (n_point, 2) mm and maps (n_step, n_point) mm of an emulator's error."""
    with np.load(maps_path(out, hypothesis), allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}


def load_diagnostics(out: Path) -> dict[str, dict[str, Any]]:
    """Read diagnostics.json: hypothesis -> what `judgement.judge` says."""
    found: dict[str, dict[str, Any]] = read_json(out / DIAGNOSTICS)
    return found
