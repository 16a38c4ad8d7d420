"""Answers to questions put to a finished study, kept on disk as sections of its report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from calib.study.artifacts import hash_of_file, read_json, write_json
from calib.study.config import Study
from calib.study.context import Context
from calib.study.report import Picture, Section
from calib.study.sample_stage import samples_path
from calib.study.tables import Table

FOLDER = "answers"
"""folder of the answers, one file for each verb that was asked"""
QUESTIONS = {
    "identify": (
        "What the data know of each constant",
        "Profile likelihoods, and SDs that each part of the data leaves of the prior's.",
    ),
    "evidence": (
        "Ranking of the hypotheses",
        "ln evidence, differences of leave-one-out scores and stacking weights, with their errors.",
    ),
    "baseline": (
        "The thesis' own method",
        "Starts and ends of the nine calibrations by the field, beside the posterior.",
    ),
    "design-next": (
        "What to measure next",
        "Expected information gain of every experiment, in nats.",
    ),
}
"""verb -> heading in the report and caption of its figure, in the order of the report"""


def keep_answer(
    context: Context,
    question: str,
    tables: Sequence[Table],
    figure: Path,
    remarks: Sequence[str] = (),
) -> None:
    """Keep what a verb found for the report; `figure` is a PNG below the study's folder."""
    answer = {
        "posterior": sampled(context.out, names_of(context.study)),
        "remarks": remarks,
        "tables": tables,
        "figure": figure.relative_to(context.out).as_posix(),
    }
    write_json(context.out / FOLDER / f"{question}.json", answer)


def answer_files(out: Path) -> list[Path]:
    """The answers that there are, in the order of the report."""
    paths = (out / FOLDER / f"{question}.json" for question in QUESTIONS)
    return [path for path in paths if path.is_file()]


def read_answers(out: Path, study: Study) -> list[Section]:
    """The answers that there are as sections of a report; one to another posterior says so.

    Raises ValueError naming a damaged file.
    """
    return [_section(path, out, study) for path in answer_files(out)]


def _section(path: Path, out: Path, study: Study) -> Section:
    question, stored = path.stem, read_json(path)
    title, caption = QUESTIONS[question]
    try:
        remarks = list(stored["remarks"])
        tables = [_table(table) for table in stored["tables"]]
        figure, asked_of = out / stored["figure"], stored["posterior"]
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"{path}: found no answer of `calib {question}` in it; delete it and ask again"
        ) from error
    if asked_of != sampled(out, names_of(study)):
        remarks.insert(0, of_another(question))
    pictures = [Picture(figure, caption)] if figure.is_file() else []
    return Section(title, remarks, tables, pictures)


def _table(stored: dict[str, Any]) -> Table:
    rows = tuple(tuple(row) for row in stored["rows"])
    return Table(stored["title"], tuple(stored["columns"]), rows, stored["note"])


def of_another(verb: str) -> str:
    """What a report says of numbers that its posterior has not given."""
    off = "These numbers are of another posterior than that of this report"
    return f"{off}: `calib {verb}` makes them anew."


def names_of(study: Study) -> list[str]:
    """The hypotheses of a study."""
    return [hypothesis.name for hypothesis in study.hypotheses]


def sampled(out: Path, hypotheses: Sequence[str]) -> dict[str, str]:
    """Hash of the chains of every one of these hypotheses that was sampled."""
    paths = {name: samples_path(out, name) for name in hypotheses}
    return {name: hash_of_file(path) for name, path in paths.items() if path.is_file()}
