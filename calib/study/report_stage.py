"""Stage `report`: figures and report from the artifacts of all stages before, and closing words."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from calib.inference.coordinates import CONSTANTS
from calib.study.artifacts import write_bytes
from calib.study.assumptions import assumptions_table
from calib.study.config import Study
from calib.study.context import Context
from calib.study.emulator_tables import (
    emulator_table,
    emulator_tables,
    partial_table,
    refinement_table,
)
from calib.study.findings import Findings, read_findings
from calib.study.further_table import further_table
from calib.study.nuisances import correlation_table, nuisance_table
from calib.study.population_report import every_population_table, population_sections
from calib.study.predictive_tables import (
    face_summary_table,
    field_checks_tables,
    force_checks_table,
)
from calib.study.prior_stage import prior_table
from calib.study.report import Picture, Section, render, versions_table
from calib.study.report_figures import draw
from calib.study.sample_stage import load_samples
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
from calib.study.train_report import limits_of


def run(context: Context) -> list[Path]:
    """Draw the figures and write report.html; returns their paths."""
    study, out = context.study, context.out
    findings = read_findings(out, study, load_summary(out / "posterior.nc"))
    samples = {h.name: load_samples(out, h) for h in study.hypotheses}
    pictures = draw(findings, samples, study, out)
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
    tables = [*_all_tables(findings, study), *every_population_table(findings.summaries)]
    for text in texts(tables):
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
        *population_sections(findings.summaries, pictures),
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
