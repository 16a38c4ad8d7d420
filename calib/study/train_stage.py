"""Stage `train`: a first emulator of each hypothesis, and its errors on runs held out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calib.study.artifacts import not_made, read_json, read_npz, write_json, write_npz
from calib.study.campaign_tables import label_of
from calib.study.config import Study
from calib.study.context import Context
from calib.study.judgement import judge, one_line
from calib.study.local_design import (
    LOCAL,
    MOST_LOST,
    REFINEMENT,
    inside,
    shares_beyond,
    within,
)
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
LEAST_HELD_OUT = 4
"""runs in a posterior's box that judge its emulator; as many as a study holds out by itself"""
IN_ITS_BOX = " in its box"
"""after the name of a hypothesis: its emulator of the posterior's box is meant"""
FIRST = "first"
"""folder of the emulators trained on the design alone"""


@dataclass(frozen=True)
class StudyRuns:
    """Runs of one hypothesis: those that train, those that judge."""

    training: tuple[Campaign, ...]
    held_out: Campaign
    box: Array | None = None
    """(d, 2) outside which runs count for nothing, see `calib.study.local_design`"""

    def training_set(self, study: Study) -> TrainingSet:
        """Those that train, complete ones with derivatives if the study wants them."""
        found = training_set(self.training, gradients=study.emulator.gradients)
        return within(found, self.box)

    def held_out_set(self) -> TrainingSet | None:
        """The complete ones of those that judge; None without any, or with few in a box.

        How many of the design's are in the box of a posterior is chance, and by one or two of them
        no emulator can be told from a good one: runs left out judge it then.
        """
        found = held_out_set(self.held_out)
        found = None if found is None else within(found, self.box)
        least = 1 if self.box is None else LEAST_HELD_OUT
        return None if found is None or len(found.ratios) < least else found

    def campaigns(self) -> list[Campaign]:
        """All that are in the box."""
        parts = [*self.training, self.held_out]
        if self.box is None:
            return parts
        kept = [np.flatnonzero(inside(part.theta, self.box)) for part in parts]
        return [rows(part, own) for part, own in zip(parts, kept, strict=True) if len(own)]


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
    for hypothesis in (h for h in context.study.hypotheses if h.name in runs):
        parts = runs[hypothesis.name]
        training, held_out = parts.training_set(context.study), parts.held_out_set()
        tolerance = FIELD_TOLERANCE * FINER ** (rounds or {}).get(hypothesis.name, 0)
        emulator = Emulator.fit(training, context.study.seed, field_tolerance=tolerance)
        path = emulator_path(folder, hypothesis)
        path.parent.mkdir(parents=True, exist_ok=True)
        emulator.save(path)
        partial = partial_runs(emulator, parts.campaigns())
        judged = judge(emulator, training, held_out, partial, context.study)
        labels = [label_of(p) for p in parameters_of(context.study, hypothesis)]
        found[hypothesis.name] = judged.facts | {"inputs": labels}
        points = context.sampling_model(hypothesis).points()
        write_npz(maps_path(folder, hypothesis), {"points": points, **judged.maps})
        paths += [path, maps_path(folder, hypothesis)]
        line = one_line(judged.diagnostics, judged.facts["n_with_gradients"])
        where = "" if parts.box is None else " in the posterior's box"
        context.echo(f"  {hypothesis.name}{where}: {line}")
    if not found:
        return []
    write_json(folder / DIAGNOSTICS, found)
    return [*paths, folder / DIAGNOSTICS]


def emulator_path(out: Path, hypothesis: Hypothesis) -> Path:
    """File of a hypothesis' emulator."""
    return out / f"emulator_{hypothesis.name}.npz"


def maps_path(out: Path, hypothesis: Hypothesis) -> Path:
    """File of the maps of its error on the front face."""
    return out / f"emulator_{hypothesis.name}_maps.npz"


def load_emulator(out: Path, hypothesis: Hypothesis) -> Emulator:
    """Read a hypothesis' emulator; raises ValueError naming a missing or damaged file."""
    path = emulator_path(out, hypothesis)
    try:
        return Emulator.load(path)
    except FileNotFoundError as error:
        raise not_made(path) from error


def load_maps(out: Path, hypothesis: Hypothesis) -> dict[str, Array]:
    """Read points (n_point, 2) mm and maps (n_step, n_point) mm of an emulator's error."""
    return read_npz(maps_path(out, hypothesis))


def load_local_diagnostics(out: Path) -> dict[str, dict[str, Any]]:
    """Read those of emulators of posteriors' boxes, of the hypotheses that are sampled in one."""
    boxes, beyond = read_json(out / REFINEMENT), shares_beyond(out)
    names = [
        name
        for name, found in boxes.items()
        if found.get("box") is not None and beyond.get(name, 0.0) <= MOST_LOST
    ]
    if not names:
        return {}
    found = load_diagnostics(out / LOCAL)
    return {f"{name}{IN_ITS_BOX}": found[name] for name in names}


def load_diagnostics(out: Path) -> dict[str, dict[str, Any]]:
    """Read diagnostics.json: hypothesis -> what `judgement.judge` says."""
    found: dict[str, dict[str, Any]] = read_json(out / DIAGNOSTICS)
    return found
