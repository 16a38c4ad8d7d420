"""The questions put to a finished study: verbs, tables, files; on a block in closed form."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic_block import analytic_block

from calib.cli import main
from calib.study.config import load_study
from calib.study.finished import chosen
from calib.study.stages import run_study
from fe.executors import serial_map


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished study with a field, both hypotheses."""
    study = load_study("virtual")
    study = replace(
        study,
        design=replace(study.design, n_runs=12, n_held_out=4, n_refine=3),
        sampler=replace(study.sampler, n_ensembles=2, n_autocorrelation=10.0, max_steps=600),
    )
    out = tmp_path_factory.mktemp("questions") / "virtual"
    run_study(
        study,
        out,
        simulate_factory=analytic_block,
        map_fn=serial_map,
        echo=lambda _: None,
        show_progress=False,
    )
    return out


def test_identify_says_what_each_part_of_the_data_knows(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["identify", str(run)]) == 0
    text = capsys.readouterr().out
    assert "force: SD left [%]" in text and "field: SD left [%]" in text
    assert "The field alone says nothing of C10 + C01." in text
    found = json.loads((run / "identify.json").read_text())
    for parts in (known["parts"] for known in found.values()):
        by_part = {name: part["sd_over_prior"] for name, part in parts.items()}
        assert by_part["field"][0] == pytest.approx(1.0, abs=0.05)
        assert by_part["force"][0] < 0.3
        both = np.array(by_part["both"])
        assert np.all(both < 1.05 * np.minimum(by_part["force"], by_part["field"]))
    assert (run / "figures" / "identify.png").stat().st_size > 10_000


def test_evidence_gives_no_number_without_its_error(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evidence", str(run)]) == 0
    text = capsys.readouterr().out
    rows = [line for line in text.splitlines() if line.startswith(("stuck ", "sliding "))]
    assert len(rows) == 4
    assert all(row.count("±") >= 5 for row in rows)
    found = json.loads((run / "evidence.json").read_text())
    for standing in found.values():
        (by_grid, error), (by_nested, sd) = (
            standing["log_evidence_quadrature"],
            standing["log_evidence_nested"],
        )
        assert abs(by_grid - by_nested) < 5 * np.hypot(error, sd)
        assert standing["blocks"]["names"] == ["all forces", "whole field"]
    assert sum(s["stacking_weight"][0] for s in found.values()) == pytest.approx(1.0)


def test_baseline_ends_at_one_error_and_many_stiffnesses(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["baseline", str(run), "--hypothesis", "sliding"]) == 0
    text = capsys.readouterr().out
    assert "SYNTHETIC field" in text and "thesis Table 5.3, real data, as printed" in text
    found = json.loads((run / "baseline.json").read_text())
    exact = found["runs"][1]
    force = np.array(exact["force"])[:, -1]
    assert exact["exact_gradients"] and len(exact["error"]) == 9
    assert np.ptp(exact["error"]) < 0.05 * min(exact["error"])
    assert force.max() > 2.0 * force.min()


def test_wrong_questions_are_refused_in_one_sentence(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["identify", str(tmp_path)]) == 2
    assert "found no study with data" in capsys.readouterr().err
    assert main(["baseline", str(run), "--truth", "0.01", "0.01", "0.001"]) == 2
    assert "the study has a field" in capsys.readouterr().err
    with pytest.raises(ValueError, match="expected one of stuck, sliding"):
        chosen(load_study("virtual"), "glued")
