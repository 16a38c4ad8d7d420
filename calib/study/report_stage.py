"""Stage `report`: figures and report from the artifacts of all stages before, and closing words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from calib.inference.coordinates import CONSTANTS, theta_of
from calib.study.artifacts import read_json, write_bytes
from calib.study.assumptions import assumptions_table
from calib.study.config import Study
from calib.study.context import Context
from calib.study.emulator_figures import refinement_loop
from calib.study.emulator_tables import (
    emulator_table,
    emulator_tables,
    partial_table,
    refinement_table,
)
from calib.study.figure_style import save_png, symbol
from calib.study.force_figures import MeasuredForce, PredictedForce, force_travel
from calib.study.further_table import further_table
from calib.study.mesh_error import check_folder
from calib.study.nuisances import correlation_table, nuisance_table
from calib.study.posterior_figures import Chains, Samples, chains, marginals, pairs
from calib.study.predict_stage import CHECKS
from calib.study.predictive_report import predictive_figures
from calib.study.predictive_tables import (
    face_summary_table,
    field_checks_tables,
    force_checks_table,
)
from calib.study.prior_stage import FACTS, FIGURE, prior_table
from calib.study.refine_stage import REFINEMENT
from calib.study.report import Picture, Section, render, versions_table
from calib.study.sample_stage import StoredSamples, load_samples
from calib.study.study_file import study_text
from calib.study.summary import (
    Summary,
    constants_table,
    load_summary,
    points_table,
)
from calib.study.tables import (
    Table,
    comparison_table,
    data_table,
    map_table,
    mesh_table,
    optimization_table,
    published_table,
    texts,
)
from calib.study.train_report import emulator_figure, limits_of, worst_figure
from calib.study.train_stage import DIAGNOSTICS
from fe.response import Array


@dataclass(frozen=True)
class Findings:
    """Everything that is shown, as read from the artifacts of a study."""

    data: dict[str, Any]
    mesh: dict[str, Any]
    """hypothesis -> mesh_error.json"""
    diagnostics: dict[str, Any]
    """hypothesis -> its part of diagnostics.json"""
    refinement: dict[str, Any]
    """hypothesis -> its part of refinement.json"""
    maps: dict[str, Any]
    comparison: dict[str, Any]
    predictive: dict[str, Any]
    """predictive.json"""
    prior: dict[str, Any]
    """hypothesis -> its part of prior_predictive.json"""
    summaries: tuple[Summary, ...]

    @property
    def failures(self) -> list[str]:
        """Diagnostics outside the limits of the study, one sentence each."""
        return [f"{s.hypothesis}: {failure}" for s in self.summaries for failure in s.failures]


def read_findings(out: Path, study: Study, summaries: Sequence[Summary]) -> Findings:
    """Read the artifacts of a finished study; raises ValueError naming a damaged one."""
    return Findings(
        data=read_json(out / "data.json"),
        mesh={
            h.name: read_json(check_folder(out, h) / "mesh_error.json") for h in study.hypotheses
        },
        diagnostics=read_json(out / DIAGNOSTICS),
        refinement=read_json(out / REFINEMENT),
        maps=read_json(out / "map.json"),
        comparison=read_json(out / "comparison.json"),
        predictive=read_json(out / CHECKS),
        prior=read_json(out / FACTS),
        summaries=tuple(summaries),
    )


def run(context: Context) -> list[Path]:
    """Draw the figures and write report.html; returns their paths."""
    study, out = context.study, context.out
    findings = read_findings(out, study, load_summary(out / "posterior.nc"))
    samples = {h.name: load_samples(out, h) for h in study.hypotheses}
    pictures = _draw(findings, samples, study, out)
    html = render(
        study=study.name,
        seed=study.seed,
        synthetic=synthetic_sentence(findings.data),
        failures=findings.failures,
        verdict=findings.comparison["verdict"],
        sections=_sections(findings, pictures, study),
        study_text=study_text(study),
    )
    write_bytes(out / "report.html", html.encode())
    drawn = [picture.path for name, picture in pictures.items() if name != "prior"]
    return [*drawn, out / "report.html"]


def closing_lines(out: Path, study: Study, summaries: Sequence[Summary]) -> list[str]:
    """What a run prints at its end: every table, failures, and where the results are."""
    findings = read_findings(out, study, summaries)
    synthetic = synthetic_sentence(findings.data)
    lines = ["", *([f"SYNTHETIC DATA. {synthetic}", ""] if synthetic else [])]
    for text in texts(_all_tables(findings, study)):
        lines += [text, ""]
    lines += [f"FAILED  {failure}" for failure in findings.failures]
    if not findings.failures:
        lines.append("All diagnostics are within the limits of the study.")
    places = (
        ("posterior", out / "posterior.nc"),
        ("report", out / "report.html"),
        ("figures", out / "figures"),
    )
    return [*lines, *(f"{name:<9} {path}" for name, path in places)]


def synthetic_sentence(data: dict[str, Any]) -> str:
    """How synthetic data were made; empty for measured ones."""
    if not data["synthetic"]:
        return ""
    if data["truth"] is None:
        return "No experiment was made: a model made the instruments' files that the data are from."
    truth = ", ".join(f"{name} {data['truth'][name]:.4g} MPa" for name in CONSTANTS)
    return (
        "No experiment was made: forces and front-face field come from the FE model under the "
        f"hypothesis {data['truth_hypothesis']} on a finer mesh with {truth}, and noise was added."
    )


def _all_tables(findings: Findings, study: Study) -> list[Table | None]:
    return [
        *(
            table
            for summary in findings.summaries
            for table in (
                constants_table(summary, summary.truth),
                points_table(summary),
                further_table(summary),
            )
        ),
        mesh_table(findings.mesh),
        emulator_table(findings.diagnostics, limits_of(study)),
        partial_table(findings.diagnostics),
        refinement_table(findings.refinement),
        map_table(findings.maps),
        optimization_table(findings.data["published"]),
        published_table(findings.comparison),
        comparison_table(findings.comparison),
        correlation_table(findings.comparison),
        force_checks_table(findings.predictive),
        face_summary_table(findings.predictive),
        nuisance_table(findings.comparison),
        prior_table(findings.prior),
    ]


def _sections(findings: Findings, pictures: dict[str, Picture], study: Study) -> list[Section]:
    tables = _all_tables(findings, study)
    n = 3 * len(findings.summaries)
    constants = tables[:n]
    mesh, _, _, refinement, maximum, starts, published, compared, correlated = tables[n : n + 9]
    force_checks, face_checks, nuisances, before = tables[n + 9 :]

    def kept(*found: Table | None) -> list[Table]:
        return [table for table in found if table is not None]

    return [
        Section(
            "Constants",
            ("One posterior under each contact hypothesis; the comparison is further below.",),
            kept(*constants),
            (pictures["marginals"], pictures["pairs"]),
        ),
        Section("Forces", (), kept(data_table(findings.data)), (pictures["forces"],)),
        Section(
            "Predictive checks",
            (),
            kept(force_checks, face_checks, *field_checks_tables(findings.predictive)),
            [pictures[name] for name in pictures if name.startswith("predictive_")],
        ),
        Section("Before the data", (), kept(before), (pictures["prior"],)),
        Section("Hypotheses", (), kept(compared, starts, published)),
        Section(
            "Emulator against the FE model",
            (),
            kept(maximum, *emulator_tables(findings.diagnostics, limits_of(study))),
            (pictures["emulator"], pictures["emulator_worst"]),
        ),
        Section("Refinement", (), kept(refinement), (pictures["refinement"],)),
        Section("Mesh", (), kept(mesh)),
        Section("Assumptions", (), kept(assumptions_table(study), nuisances, correlated)),
        Section("Chains", (), (), (pictures["chains"],)),
        Section("Versions", (), (versions_table(),)),
    ]


def _draw(
    findings: Findings, samples: dict[str, StoredSamples], study: Study, out: Path
) -> dict[str, Picture]:
    data = findings.data
    kind = "synthetic" if data["synthetic"] else "measured"
    drawn: dict[str, tuple[Figure, str]] = {
        "forces": (
            _force_figure(findings, samples),
            f"Force against travel: {kind} mean with standard error (thick) and SD between "
            "samples (thin); bands hold 94 % of the posterior predictive draws of the mean force.",
        ),
        "marginals": (
            marginals(_posterior_samples(findings, samples), data["published"], data["truth"]),
            "Marginal posterior of each constant under each hypothesis, each on its own axis.",
        ),
        "pairs": (
            pairs(_posterior_samples(findings, samples, without="mu"), data["truth"]),
            "Posterior draws and contours that hold 50 % and 94 % of them; note that every "
            "hypothesis has its own axes.",
        ),
        "chains": (
            chains([_chains(name, stored) for name, stored in samples.items()]),
            "Chains of every ensemble after burn-in; they should be indistinguishable.",
        ),
        "emulator": (
            emulator_figure(findings.diagnostics, study),
            "Error of the emulators' force on FE runs that were held out.",
        ),
        "emulator_worst": (
            worst_figure(out, findings.diagnostics, study),
            "Largest force error of every run by an emulator that had not seen it; error of the "
            "emulated field at each point of the front face, the worst ten ringed.",
        ),
        "refinement": (
            refinement_loop(findings.refinement),
            "How far the posterior mean may move, and the emulators' error at the runs added.",
        ),
    }
    drawn |= predictive_figures(findings.predictive, study, out)
    pictures = {}
    for name, (figure, caption) in drawn.items():
        save_png(figure, out / "figures" / f"{name}.png")
        pictures[name] = Picture(out / "figures" / f"{name}.png", caption)
    pictures["prior"] = Picture(
        out / FIGURE,
        "Forces that the priors expect, with all errors, before the data were looked at: bands "
        "hold 50 % and 94 % of the draws.",
    )
    return pictures


def _force_figure(findings: Findings, samples: dict[str, StoredSamples]) -> Figure:
    data = findings.data
    measured = MeasuredForce(
        label="synthetic" if data["synthetic"] else "measured",
        travel=np.asarray(data["travel"]),
        mean=np.asarray(data["force_mean"]),
        sd=np.asarray(data["force_sd"]),
        n_samples=data["n_samples"],
    )
    predicted = []
    for name, stored in samples.items():
        published = findings.comparison["hypotheses"][name]["published"]
        force = None if published is None else np.asarray(published["force"], dtype=float)
        predicted.append(PredictedForce(name, stored.predictive, force))
    return force_travel(measured, predicted)


def _posterior_samples(
    findings: Findings,
    samples: dict[str, StoredSamples],
    without: str = "",
) -> list[Samples]:
    """Draws of the constants and of what else was unknown, by hypothesis."""
    found = []
    for hypothesis, stored in samples.items():
        space = stored.space
        x = stored.chains.reshape(-1, space.size)
        values = dict(zip(space.law.constants, space.constants(theta_of(x)).T, strict=True))
        units = dict(zip(space.law.constants, space.law.units, strict=True))
        for unknown, column in zip(space.unknowns, space.natural(x).T, strict=True):
            if unknown in (*space.inputs, *space.errors):
                values[unknown.name], units[unknown.name] = column, unknown.unit
        values.pop(without, None)
        shown = {name: "-" if unit == "1" else unit for name, unit in units.items()}
        maximum = findings.maps[hypothesis]
        found.append(Samples(hypothesis, values, maximum["emulator"], maximum["fe"] or {}, shown))
    return found


def _chains(name: str, stored: StoredSamples) -> Chains:
    natural: Array = stored.space.natural(stored.chains)
    walkers = natural.transpose(3, 0, 2, 1)
    labels = [
        f"{symbol(u.name)} [{'-' if u.unit == '1' else u.unit}]" for u in stored.space.unknowns
    ]
    return Chains(name, dict(zip(labels, walkers, strict=True)))
