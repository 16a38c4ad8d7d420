"""A forward model that remembers: each point solved once, kept, listed and found elsewhere."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic_block import AnalyticBlock

from calib.study.run_identity import run_identity
from calib.study.simulations import StoredSimulate
from fe import run_files
from fe.campaign import run_campaign
from fe.response import Array, Response

BLOCK = AnalyticBlock(
    area=40.0, height=2.5, stiffening=0.5, cells=(4, 2, 4), travel=(0.6, 1.0, 1.4)
)
RATIOS = np.random.default_rng(11).random((5, 2))


def test_a_stored_simulation_is_solved_once_and_listed(tmp_path: Path) -> None:
    stored = StoredSimulate(BLOCK, tmp_path / "map")
    for row in (*RATIOS, *RATIOS):
        np.testing.assert_array_equal(stored(row).force, BLOCK(row).force)
    manifest = json.loads((tmp_path / "map" / "manifest.json").read_text())
    np.testing.assert_array_equal([run["theta"] for run in manifest["runs"]], RATIOS)
    assert len(list((tmp_path / "map").glob("run_*.npz"))) == len(RATIOS)


def test_a_stored_simulation_takes_runs_of_the_design(tmp_path: Path) -> None:
    run_campaign(BLOCK, RATIOS, tmp_path / "design", fingerprint=run_identity(BLOCK))
    StoredSimulate(BLOCK, tmp_path / "map", (tmp_path / "design",))(RATIOS[2])
    assert not (tmp_path / "map").exists()


def test_a_changed_model_does_not_take_the_runs_of_the_old_one(tmp_path: Path) -> None:
    StoredSimulate(BLOCK, tmp_path)(RATIOS[0])
    stiffer = replace(BLOCK, stiffening=0.7)
    found = StoredSimulate(stiffer, tmp_path)(RATIOS[0])
    np.testing.assert_array_equal(found.force, stiffer(RATIOS[0]).force)
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert len(manifest["runs"]) == 1 and len(manifest["unused"]) == 1


def test_a_damaged_run_is_refused_by_name(tmp_path: Path) -> None:
    StoredSimulate(BLOCK, tmp_path)(RATIOS[0])
    [path] = tmp_path.glob("run_*.npz")
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(ValueError, match=f"{path.name}: damaged run"):
        StoredSimulate(BLOCK, tmp_path)(RATIOS[0])


def test_derivatives_are_by_the_columns_of_a_row_and_nan_where_a_run_has_none(
    tmp_path: Path,
) -> None:
    def without_s(ratios: Array) -> Response:
        full = BLOCK(ratios)
        return replace(
            full,
            force_gradient=full.force_gradient[:, :1],
            displacement_gradient=full.displacement_gradient[..., :1],
            parameters=("r",),
        )

    found = StoredSimulate(BLOCK, tmp_path)._named(without_s(RATIOS[0]))
    assert found.parameters == ("r", "s")
    np.testing.assert_array_equal(found.force_gradient[:, 0], BLOCK(RATIOS[0]).force_gradient[:, 0])
    assert np.isnan(found.force_gradient[:, 1]).all()
    assert np.isnan(found.displacement_gradient[..., 1]).all()


def test_runs_of_another_version_are_not_solved_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are kept under other names, and would all be missing."""
    stored = StoredSimulate(BLOCK, tmp_path)
    for row in RATIOS[:3]:
        stored(row)
    other = {**run_files.software_versions(), "softcal": "0.0.0"}
    monkeypatch.setattr(run_files, "software_versions", lambda: other)
    monkeypatch.setattr("calib.study.simulations.software_versions", lambda: other)
    stored(RATIOS[3])
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    np.testing.assert_array_equal([run["theta"] for run in manifest["runs"]], RATIOS[3:4])
