"""Notebooks run from first to last cell with the package as it is."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from calib.study.stages import StudyResult

NOTEBOOKS = sorted((Path(__file__).parent.parent / "notebooks").glob("*.ipynb"))


def test_there_are_notebooks() -> None:
    assert NOTEBOOKS


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_committed_without_output(path: Path) -> None:
    cells = nbformat.read(path, as_version=4).cells
    assert all(not cell.outputs for cell in cells if cell.cell_type == "code")


EXPECTED = {
    "01_thesis_forces": (5, "simulate   up to date"),
    "02_forward_model": (4, "converged: reached every asked travel"),
    "03_emulator": (5, "16 runs of 3 travels, 840 points of the front face"),
    "04_experiment_to_dataset": (4, "rejected without cause: none"),
    "05_thesis_revisited": (4, "python -m benchmarks.thesis_revisited | made"),
    "06_images_to_posterior": (3, "truth within the region of 95 %: yes"),
}
"""pictures that a notebook shows, and words that it prints"""


@pytest.mark.study
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_run(
    path: Path, thesis_study: StudyResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOFTCAL_RUNS", str(thesis_study.out.parent))
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=1200).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    pictures = [o for o in outputs if "image/png" in o.get("data", {})]
    n_pictures, words = EXPECTED[path.stem]
    assert len(pictures) == n_pictures
    assert words in "".join(o["text"] for o in outputs if o.output_type == "stream")
