"""What a finished study found, as its report and its last words show it: tables and sections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.data import Dataset
from calib.inference.coordinates import CONSTANTS
from calib.study.answers import names_of, of_another, read_answers, sampled
from calib.study.artifacts import read_json
from calib.study.assumptions import assumptions_table
from calib.study.config import Study
from calib.study.data_stage import load_data
from calib.study.emulator_tables import (
    emulator_table,
    emulator_tables,
    partial_table,
    refinement_table,
)
from calib.study.further_table import further_table
from calib.study.local_design import REFINEMENT, shares_beyond
from calib.study.maxima_table import laplace_table, map_table, rounds_table
from calib.study.mesh_error_file import check_folder
from calib.study.nuisances import correlation_table, nuisance_table
from calib.study.population_report import every_population_table, population_sections
from calib.study.predictive_tables import (
    CHECKS,
    face_summary_table,
    field_checks_tables,
    force_checks_table,
)
from calib.study.prior_stage import FACTS, prior_table
from calib.study.report import Picture, Section, versions_table
from calib.study.summary import Summary, judgement_lines
from calib.study.summary_tables import constants_table, points_table
from calib.study.tables import (
    Table,
    comparison_table,
    data_table,
    mesh_table,
    optimization_table,
    published_table,
)
from calib.study.train_report import limits_of
from calib.study.train_stage import DIAGNOSTICS, load_local_diagnostics
from calib.study.validation_tables import validation_tables, verdicts
from calib.study.verification import load_rounds

VALIDATIONS = "validation"
"""folder of what `calib validate` finds on second tests"""


@dataclass(frozen=True)
class Findings:
    """Everything that is shown, as read from the artifacts of a study."""

    data: dict[str, Any]
    dataset: Dataset
    """that the posterior is conditioned on"""
    mesh: dict[str, Any]
    """hypothesis -> mesh_error.json"""
    diagnostics: dict[str, Any]
    """hypothesis -> its part of diagnostics.json"""
    local: dict[str, Any]
    """the same of emulators of posteriors' boxes, where there are any"""
    refinement: dict[str, Any]
    """hypothesis -> its part of refinement.json"""
    beyond: dict[str, float]
    """hypothesis -> share of its posterior beyond its box"""
    maps: dict[str, Any]
    comparison: dict[str, Any]
    predictive: dict[str, Any]
    """predictive.json"""
    prior: dict[str, Any]
    """hypothesis -> its part of prior_predictive.json"""
    rounds: list[dict[str, Any]]
    """of verification.json, hypothesis -> what was found and added"""
    validations: dict[str, dict[str, Any]]
    """second test -> validation.json of `calib validate`"""
    valid: frozenset[str]
    """second tests that were predicted by this posterior"""
    answers: tuple[Section, ...]
    """to questions that were put to the study"""
    summaries: tuple[Summary, ...]

    @property
    def judged(self) -> dict[str, Any]:
        """Diagnostics of all emulators."""
        return {**self.diagnostics, **self.local}

    @property
    def failures(self) -> list[str]:
        """Diagnostics outside the limits of the study, one sentence each."""
        return [f"{s.hypothesis}: {failure}" for s in self.summaries for failure in s.failures]


def read_findings(out: Path, study: Study, summaries: Sequence[Summary]) -> Findings:
    """Read the artifacts of a finished study; raises ValueError naming a damaged one."""
    validations = {path.parent.name: read_json(path) for path in validation_files(out)}
    chains = sampled(out, names_of(study))
    return Findings(
        data=read_json(out / "data.json"),
        dataset=load_data(out).dataset,
        mesh={
            h.name: read_json(check_folder(out, h) / "mesh_error.json") for h in study.hypotheses
        },
        diagnostics=read_json(out / DIAGNOSTICS),
        local=load_local_diagnostics(out),
        refinement=read_json(out / REFINEMENT),
        beyond=shares_beyond(out),
        maps=read_json(out / "map.json"),
        comparison=read_json(out / "comparison.json"),
        predictive=read_json(out / CHECKS),
        prior=read_json(out / FACTS),
        rounds=load_rounds(out),
        validations=validations,
        valid=frozenset(k for k, found in validations.items() if found.get("posterior") == chains),
        answers=tuple(read_answers(out, study)),
        summaries=tuple(summaries),
    )


def closing_lines(out: Path, study: Study, summaries: Sequence[Summary]) -> list[str]:
    """What a run prints at its end: every table, failures, and where the results are."""
    findings = read_findings(out, study, summaries)
    synthetic = synthetic_sentence(findings.data)
    lines = ["", *([f"SYNTHETIC DATA. {synthetic}", ""] if synthetic else [])]
    for tables in _tables(findings, study).values():
        for table in tables:
            lines += [table.text(), ""]
    lines += judgement_lines(summaries)
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


def validation_files(out: Path) -> list[Path]:
    """What `calib validate` found on second tests, in the order of their names."""
    return sorted((out / VALIDATIONS).glob("*/validation.json"))


def _tables(findings: Findings, study: Study) -> dict[str, list[Table]]:
    """Tables by what they are about, in the order in which a run prints them."""
    n_train = {name: found["n_train"] for name, found in findings.diagnostics.items()}
    rounds = rounds_table(findings.maps, findings.rounds, n_train)
    found: dict[str, list[Table | None]] = {
        "constants": [
            table
            for summary in findings.summaries
            for table in (
                constants_table(summary, summary.truth),
                points_table(summary),
                further_table(summary),
            )
        ],
        "mesh": [mesh_table(findings.mesh)],
        "emulator": [emulator_table(findings.judged, limits_of(study))],
        "partial": [partial_table(findings.diagnostics)],
        "refinement": [refinement_table(findings.refinement, findings.beyond)],
        "maximum": [map_table(findings.maps), laplace_table(findings.maps), rounds],
        "starts": [optimization_table(findings.data["published"])],
        "published": [published_table(findings.comparison)],
        "comparison": [comparison_table(findings.comparison)],
        "correlation": [correlation_table(findings.comparison)],
        "checks": [
            force_checks_table(findings.predictive),
            face_summary_table(findings.predictive),
        ],
        "nuisances": [nuisance_table(findings.comparison)],
        "prior": [prior_table(findings.prior)],
        "population": [*every_population_table(findings.summaries)],
    }
    return {about: _kept(tables) for about, tables in found.items()}


def _kept(tables: Sequence[Table | None]) -> list[Table]:
    return [table for table in tables if table is not None]


def sections(findings: Findings, pictures: dict[str, Picture], study: Study) -> list[Section]:
    """The headings of the report with their tables and pictures."""
    tables = _tables(findings, study)
    judged = _kept(emulator_tables(findings.judged, limits_of(study)))
    checks = [*tables["checks"], *_kept(field_checks_tables(findings.predictive))]
    further = [*tables["nuisances"], *tables["correlation"]]
    assumed = [assumptions_table(study, findings.dataset), *further]
    return [
        Section(
            "Constants",
            ("One posterior under each hypothesis; their comparison is further below.",)
            if len(findings.summaries) > 1
            else (),
            tables["constants"],
            (pictures["marginals"], pictures["pairs"]),
        ),
        *population_sections(findings.summaries, pictures),
        Section("Forces", (), [data_table(findings.data)], (pictures["forces"],)),
        Section(
            "Predictive checks",
            (),
            checks,
            [pictures[name] for name in pictures if name.startswith("predictive_")],
        ),
        *_validations(findings, pictures),
        *findings.answers,
        Section("Before the data", (), tables["prior"], (pictures["prior"],)),
        Section("Hypotheses", (), [*tables["comparison"], *tables["starts"], *tables["published"]]),
        Section(
            "Emulator against the FE model",
            (),
            [*tables["maximum"], *judged],
            (pictures["emulator"], pictures["emulator_worst"]),
        ),
        Section("Refinement", (), tables["refinement"], (pictures["refinement"],)),
        Section("Mesh", (), tables["mesh"]),
        Section("Assumptions", (), assumed),
        Section("Chains", (), (), (pictures["chains"],)),
        Section("Versions", (), (versions_table(),)),
    ]


def _validations(findings: Findings, pictures: dict[str, Picture]) -> list[Section]:
    """One heading for each second test on which the calibration was validated."""
    return [
        Section(
            f"Validation: {name}",
            (*([] if name in findings.valid else [of_another("validate")]), *verdicts(found)),
            validation_tables(found),
            (pictures[f"validation_{name}"],),
        )
        for name, found in findings.validations.items()
    ]
