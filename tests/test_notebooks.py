"""Notebooks run from first to last cell with the package as it is, on smaller meshes."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import nbformat
import pytest
from cheaper_text import in_place_of
from nbclient import NotebookClient

from calib.study.stages import StudyResult

FOLDER = Path(__file__).parent.parent / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
THESIS_STUDY = "01_thesis_forces"


def test_every_notebook_is_run() -> None:
    assert {path.stem for path in NOTEBOOKS} == set(EXPECTED)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_committed_without_output(path: Path) -> None:
    cells = nbformat.read(path, as_version=4).cells
    assert all(not cell.outputs for cell in cells if cell.cell_type == "code")


EXPECTED = {
    THESIS_STUDY: (5, "simulate   up to date"),
    "02_forward_model": (4, "converged: reached every asked travel"),
    "03_emulator": (5, "24 runs of 3 travels, 840 points of the front face"),
    "04_experiment_to_dataset": (5, "rejected without cause: none"),
    "05_thesis_revisited": (5, "python -m benchmarks.thesis_revisited | made"),
    "06_images_to_posterior": (3, "truth within the region of 95 %: yes"),
}
"""pictures that a notebook shows, and words that it prints"""

CHEAPER = {
    "02_forward_model": {
        '"bar": (12, 4, 2), "bar, stuck": (12, 5, 3), "round": (6, 3, 6)': (
            '"bar": (8, 3, 2), "bar, stuck": (8, 4, 2), "round": (4, 3, 4)'
        ),
        "(6, 3, 1), (12, 5, 3), (10, 8, 3)": "(6, 3, 1), (8, 4, 2), (8, 5, 2)",
        "(6, 2, 1), (12, 4, 2), (16, 5, 2)": "(6, 2, 1), (8, 3, 2), (10, 3, 2)",
        '"bar, stuck": (8, 4, 2), "bar, frictionless": (8, 3, 2), "round, stuck": (6, 3, 6)}': (
            '"bar, stuck": (4, 2, 1), "bar, frictionless": (4, 2, 1), "round, stuck": (3, 2, 3)}'
        ),
    },
    "03_emulator": {
        "(8, 3, 1)": "(6, 2, 1)",
        "sobol_design(24, BOX, 3": "sobol_design(8, BOX, 3",
    },
    "04_experiment_to_dataset": {"cells=(8, 3, 2)": "cells=(6, 2, 1)"},
    "06_images_to_posterior": {
        "cells=(14, 5, 3)": "cells=(10, 4, 3)",
        "(8, 3, 2), (12, 4, 3)": "(8, 3, 1), (10, 4, 2)",
    },
}
"""meshes and runs of a notebook, and those of its test"""


def read_cheaper(name: str) -> nbformat.NotebookNode:
    """A notebook with the meshes and runs of its test."""
    text = (FOLDER / f"{name}.ipynb").read_text(encoding="utf-8")
    as_json = partial(json.dumps, ensure_ascii=False)
    in_json = {
        as_json(costly)[1:-1]: as_json(cheap)[1:-1]
        for costly, cheap in CHEAPER.get(name, {}).items()
    }
    return nbformat.reads(in_place_of(text, in_json), as_version=4)


def assert_shows(name: str, cheaper: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A notebook runs from first to last cell and shows and prints what is expected of it.

    A backend named in the environment would take the place of the notebook's own, which shows.
    """
    monkeypatch.delenv("MPLBACKEND", raising=False)
    path = FOLDER / f"{name}.ipynb"
    notebook = read_cheaper(name) if cheaper else nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=1200).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    pictures = [o for o in outputs if "image/png" in o.get("data", {})]
    printed = "".join(o["text"] for o in outputs if o.output_type == "stream")
    n_pictures, words = EXPECTED[name]
    assert len(pictures) == n_pictures
    assert words in printed


@pytest.mark.study
def test_the_notebook_of_the_thesis_study_runs(
    thesis_file: Path, thesis_study: StudyResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOFTCAL_RUNS", str(thesis_study.out.parent))
    monkeypatch.setenv("SOFTCAL_STUDY", str(thesis_file))
    assert_shows(THESIS_STUDY, False, monkeypatch)


@pytest.mark.notebook
@pytest.mark.parametrize("name", [name for name in EXPECTED if name != THESIS_STUDY])
def test_notebooks_run(name: str, finished_studies: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOFTCAL_RUNS", str(finished_studies))
    assert_shows(name, True, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize("name", CHEAPER)
def test_notebooks_run_as_they_are_printed(
    name: str, finished_studies: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOFTCAL_RUNS", str(finished_studies))
    assert_shows(name, False, monkeypatch)
