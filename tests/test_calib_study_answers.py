"""Answers of verbs are kept on disk and read back as sections of a report."""

from __future__ import annotations

from pathlib import Path

import pytest
from analytic_block import analytic_block

from calib.study.answers import FOLDER, QUESTIONS, answer_files, keep_answer, read_answers
from calib.study.config import load_study
from calib.study.context import Context
from calib.study.report import Section
from calib.study.tables import Table
from fe.executors import serial_map

STUDY = load_study("thesis-forces")
TABLE = Table("Left", ("constant", "SD"), (("C10", "0.1"), ("C01", "0.2 ± 0.1")), "A note.")


@pytest.fixture
def context(tmp_path: Path) -> Context:
    """Of a folder with chains and a figure, by their bytes alone."""
    for name in ("samples_stuck.npz", "samples_sliding.npz", "a.png"):
        (tmp_path / name).write_bytes(name.encode())
    return Context(STUDY, tmp_path, analytic_block, serial_map, lambda _: None, False)


def keep(context: Context, question: str) -> None:
    keep_answer(context, question, [TABLE], context.out / "a.png", ["C10 is known."])


def test_an_answer_comes_back_with_tables_remarks_and_figure(context: Context) -> None:
    keep(context, "identify")
    [found] = read_answers(context.out, STUDY)
    assert isinstance(found, Section)
    assert (found.title, found.text) == (QUESTIONS["identify"][0], ["C10 is known."])
    assert found.tables == [TABLE]
    assert [picture.path for picture in found.pictures] == [context.out / "a.png"]


def test_a_study_that_nothing_was_asked_of_has_no_answers(context: Context) -> None:
    assert answer_files(context.out) == [] and read_answers(context.out, STUDY) == []


def test_answers_stand_in_the_same_order_whichever_was_asked_first(context: Context) -> None:
    for question in reversed(QUESTIONS):
        keep(context, question)
    titles = [found.title for found in read_answers(context.out, STUDY)]
    assert titles == [title for title, _ in QUESTIONS.values()]


def test_an_answer_to_another_posterior_says_so(context: Context) -> None:
    keep(context, "evidence")
    (context.out / "samples_stuck.npz").write_bytes(b"sampled anew")
    [found] = read_answers(context.out, STUDY)
    assert found.text[0].endswith("of this report: `calib evidence` makes them anew.")
    assert found.text[1:] == ["C10 is known."]


def test_a_figure_that_was_deleted_is_left_out(context: Context) -> None:
    keep(context, "baseline")
    (context.out / "a.png").unlink()
    [found] = read_answers(context.out, STUDY)
    assert found.tables and not found.pictures


@pytest.mark.parametrize("text", ["{}", "[]", '{"remarks": [], "tables": [1]}'])
def test_a_damaged_answer_is_named(context: Context, text: str) -> None:
    path = context.out / FOLDER / "design-next.json"
    path.parent.mkdir()
    path.write_text(text)
    expected = "found no answer of `calib design-next` in it; delete it and ask again"
    with pytest.raises(ValueError) as refusal:
        read_answers(context.out, STUDY)
    assert str(refusal.value) == f"{path}: {expected}"
