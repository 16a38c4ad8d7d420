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
