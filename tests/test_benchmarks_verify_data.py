"""What docs/verification/data.json is made by: counting, merging, the folder of real files."""

from __future__ import annotations

import json

import pytest

from benchmarks import verify_data
from benchmarks.reader_samples import davis_csv, matchid_load


def run(tmp_path, *arguments):
    out = tmp_path / "data.json"
    verify_data.main(["--only", "readers", "--data", str(tmp_path), "--out", str(out), *arguments])
    return json.loads(out.read_text())["readers"]


def test_figures_count_real_files_and_mutants_and_keep_other_readers(tmp_path):
    folder = tmp_path / "dic_exports" / "any"
    folder.mkdir(parents=True)
    (folder / "a.csv").write_bytes(davis_csv())
    (folder / "load.csv").write_bytes(matchid_load())
    (folder / "volts.csv").write_text("Index;ADC 1 [V]\n1;0.1\n")
    (folder / "README.md").write_text("text")
    run(tmp_path, "--mutants", "3", "--formats", "DaVis csv")
    figures = run(tmp_path, "--mutants", "2", "--formats", "MatchID load csv")
    assert set(figures) == {"DaVis csv", "MatchID load csv"}
    davis, load = figures["DaVis csv"], figures["MatchID load csv"]
    assert (davis["files_read"], davis["files_refused"], davis["mutants_tried"]) == (1, 0, 3)
    assert (load["files_read"], load["files_refused"], load["mutants_tried"]) == (1, 1, 2)
    assert davis["tracebacks"] == load["tracebacks"] == 0


def test_a_file_that_two_readers_claim_is_an_error(tmp_path, monkeypatch):
    (tmp_path / "dic_exports").mkdir()
    (tmp_path / "dic_exports" / "a.csv").write_bytes(davis_csv())
    twice = (*verify_data.FORMATS, verify_data.FORMATS[1])
    monkeypatch.setattr(verify_data, "FORMATS", twice)
    with pytest.raises(ValueError, match="one format"):
        verify_data.real_files(tmp_path)


def test_the_folder_of_real_files_is_named_by_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("SOFTCAL_DATA", str(tmp_path))
    assert verify_data.data_folder() == tmp_path
    monkeypatch.delenv("SOFTCAL_DATA")
    assert verify_data.data_folder() == verify_data.ROOT.parent / "shared" / "data"
