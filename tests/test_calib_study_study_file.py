"""A study written by a run is the study that was run."""

from __future__ import annotations

from pathlib import Path

import pytest

from calib.study.config import embedded_studies, load_study
from calib.study.study_file import write_study


@pytest.mark.parametrize("name", sorted(embedded_studies()))
def test_a_written_study_reads_back_as_itself(name: str, tmp_path: Path) -> None:
    study = load_study(name)
    write_study(tmp_path / "study.toml", study)
    assert load_study(tmp_path / "study.toml") == study


def test_the_study_of_laws_on_table_5_1_has_each_law_stuck_and_sliding() -> None:
    file = Path(__file__).resolve().parents[1] / "benchmarks" / "thesis_laws.toml"
    found = {(h.pin, h.law) for h in load_study(file).hypotheses}
    laws = ("neo-hookean", "mooney-rivlin-2", "mooney-rivlin-3", "yeoh", "ogden-1")
    assert found == {(pin, law) for pin in ("stick", "slide") for law in laws}
