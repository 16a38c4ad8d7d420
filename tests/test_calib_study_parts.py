"""`simulate` and `train` alone: what they run, the tables they print, the plots they leave."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import pytest
from analytic_block import AnalyticBlock, analytic_block

from calib.study import simulate_stage, stage_list
from calib.study.campaign_tables import failures_table
from calib.study.config import Study, load_study
from calib.study.context import Context
from calib.study.prior_sections import ParameterPrior, Prior
from calib.study.sections import Cells, Hypothesis
from calib.study.stage_list import stages_of
from calib.study.stages import run_part
from fe.campaign import CampaignFailed
from fe.executors import serial_map


def small(name: str = "thesis-forces") -> Study:
    study = load_study(name)
    return replace(study, design=replace(study.design, n_runs=12, n_held_out=4))


def part(
    out: Path, until: Literal["simulate", "train"], study: Study | None = None, **how: Any
) -> tuple[tuple[str, ...], str]:
    lines: list[str] = []
    settings: dict[str, Any] = {
        "simulate_factory": analytic_block,
        "map_fn": serial_map,
        "echo": lines.append,
        "show_progress": False,
    }
    failures = run_part(study or small(), out, until, **(settings | how))
    return failures, "\n".join(lines)


def stops_above(s: float) -> Callable[[Study, Hypothesis, Cells], AnalyticBlock]:
    def factory(study: Study, hypothesis: Hypothesis, cells: Cells) -> AnalyticBlock:
        return replace(analytic_block(study, hypothesis, cells), stops_above=s)

    return factory


def test_a_part_runs_only_what_it_needs() -> None:
    study = small("virtual")
    assert [stage.name for stage in stages_of(study, "simulate")] == ["simulate"]
    assert [stage.name for stage in stages_of(study, "train")] == ["simulate", "train"]
    everything = [stage.name for stage in stages_of(study)]
    assert everything[:2] == ["virtual", "data"] and everything[-1] == "report"


def test_the_design_is_made_anew_for_other_priors_that_move_its_points(tmp_path: Path) -> None:
    """Or later stages would look for runs that nothing has made."""
    study = small()
    context = Context(study, tmp_path, analytic_block, serial_map, lambda _: None, False)  # type: ignore[arg-type]
    [simulate] = stages_of(study, "simulate")

    def with_prior(high: float) -> Context:
        own = Prior(s=ParameterPrior(distribution="uniform", low=0.0, high=high))
        first, second = study.hypotheses
        changed = replace(study, hypotheses=(replace(first, prior=own), second))
        return replace(context, study=changed)

    def of_shape(mean: float) -> Context:
        # Of the same ends, so that the box does not tell them apart.
        kept = ParameterPrior(distribution="normal", low=0.0, high=1.0, mean=mean, sd=0.1)
        prior = replace(study.prior, r=kept)
        design = replace(study.design, shape="prior")
        return replace(context, study=replace(study, prior=prior, design=design))

    narrow, wide = (simulate.settings(with_prior(high)) for high in (0.3, 0.4))
    assert narrow != wide and narrow == simulate.settings(with_prior(0.3))
    assert simulate.settings(of_shape(0.3)) != simulate.settings(of_shape(0.6))
    assert "points" not in simulate.settings(context)  # those of the study's r and s follow these


def test_stages_are_stale_after_a_change_of_the_code_that_they_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """FE runs are of the FE code alone, which the settings count."""
    study = small("virtual")
    context = Context(study, tmp_path, analytic_block, serial_map, lambda _: None, False)  # type: ignore[arg-type]

    def inputs(package: str) -> dict[str, dict[str, str]]:
        with monkeypatch.context() as changed:
            changed.setattr(stage_list, "code_hash", lambda name: f"new {name == package}")
            return {
                stage.name: stage.inputs(context)
                for stage in stages_of(study)
                if stage.name != "report"
            }

    before = inputs("none")
    virtual = {"virtual"} & {*before}
    for package, later, alone in (
        ("surrogate", True, {"data"} | virtual),
        ("calib.inference", True, {"data"}),
        ("calib.study", True, set[str]()),
        ("fe", False, set[str]()),
    ):
        after = inputs(package)
        moved = {name for name in before if before[name] != after[name]}
        assert moved == ({*before} - {"simulate"} - alone if later else set())


def test_data_that_are_moved_are_the_same_data(tmp_path: Path) -> None:
    def data_of(folder: str, force: float) -> dict[str, str]:
        path = tmp_path / folder / "forces.csv"
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"travel_mm,force_mean_N,force_sd_N,n_samples\n0.6,{force},0.1,5\n")
        study = replace(small(), data=replace(small().data, source=str(path)))
        context = Context(study, tmp_path, analytic_block, serial_map, lambda _: None, False)  # type: ignore[arg-type]
        [stage] = [stage for stage in stages_of(study) if stage.name == "data"]
        return stage.inputs(context)

    assert data_of("a", 1.0) == data_of("b", 1.0) != data_of("b", 1.1)


def test_what_is_kept_beside_results_is_the_study_file_of_today(tmp_path: Path) -> None:
    """Questions compare the two: a change that moves no result is written there all the same."""
    study = small()
    context = Context(study, tmp_path, analytic_block, serial_map, lambda _: None, False)  # type: ignore[arg-type]
    posterior = next(stage for stage in stages_of(study) if stage.name == "posterior")
    more = replace(study, verification=replace(study.verification, max_rounds=5))
    alone = replace(study, compute=replace(study.compute, workers=7))
    kept = posterior.settings(context)
    assert kept != posterior.settings(replace(context, study=more))
    assert kept == posterior.settings(replace(context, study=alone))


def test_a_larger_design_that_was_stopped_leaves_no_table_of_its_own(tmp_path: Path) -> None:
    """Its manifest stays when all runs of the smaller study, which is asked again, are there."""
    part(tmp_path, "simulate")
    larger = small()
    larger = replace(larger, design=replace(larger.design, n_runs=20))

    def stopped(*_: object) -> Iterator[object]:
        raise KeyboardInterrupt
        yield

    with pytest.raises(KeyboardInterrupt):
        part(tmp_path, "simulate", larger, map_fn=stopped)
    manifest = tmp_path / "campaign" / small().hypotheses[0].name / "manifest.json"
    assert len(json.loads(manifest.read_text())["runs"]) == 24
    _, text = part(tmp_path, "simulate")
    assert len(json.loads(manifest.read_text())["runs"]) == 16
    assert "24" not in text.split("hypothesis")[1]


def test_a_manifest_that_is_none_is_refused_by_name(tmp_path: Path) -> None:
    """Where the runs that it lists are looked for."""
    path = tmp_path / "manifest.json"
    path.write_text("{}")
    for read in (simulate_stage.manifest_files, simulate_stage.read_manifest):
        with pytest.raises(ValueError, match=r"manifest\.json: found no parameters, runs, unused"):
            read(tmp_path)


def test_simulate_prints_runs_and_leaves_a_figure(tmp_path: Path) -> None:
    failures, text = part(tmp_path, "simulate")
    assert failures == ()
    rows = {line.split()[0]: line.split()[1:4] for line in text.splitlines() if line}
    assert rows["stuck"] == rows["sliding"] == ["16", "16", "0"]
    figure = tmp_path / "campaign" / "design.png"
    assert str(figure) in text and figure.read_bytes().startswith(b"\x89PNG")
    assert "did not reach" not in text


def test_simulate_lists_failures_with_parameters_and_travel_once_and_again(tmp_path: Path) -> None:
    study = small()
    top = study.prior.s.high
    for expected_ran in (True, False):
        _, text = part(tmp_path, "simulate", study, simulate_factory=stops_above(0.999 * top))
        assert ("up to date" in text) != expected_ran
        assert text.count("stuck: 2 of 16 runs did not reach the last increment") == 1
        [row, _] = [line.split() for line in text.splitlines() if line.endswith("made to stop")][:2]
        assert float(row[2]) == pytest.approx(top, rel=1e-5)
        assert float(row[3]) == study.increments[0]


def test_too_many_failures_are_listed_before_the_study_stops(tmp_path: Path) -> None:
    lines: list[str] = []
    with pytest.raises(CampaignFailed, match="stuck: 4 of 16 runs failed"):
        part(tmp_path, "simulate", simulate_factory=stops_above(0.05), echo=lines.append)
    text = "\n".join(lines)
    assert "stuck: 4 of 16 runs did not reach the last increment" in text


def test_train_goes_on_from_simulate_and_prints_the_emulators_errors(tmp_path: Path) -> None:
    part(tmp_path, "simulate")

    def refuse(f: Callable[[Any], Any], items: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
        raise AssertionError(f"nothing was to be simulated, found {len(items)} items")

    failures, text = part(tmp_path, "train", map_fn=refuse)
    assert failures == ()
    assert "Emulator against FE runs" in text
    for name in ("emulator_stuck.npz", "emulator_sliding.npz", "diagnostics.json", "emulator.png"):
        path = tmp_path / "first" / name
        assert str(path) in text and path.is_file()


@pytest.mark.lasting
def test_train_says_which_limits_of_the_study_are_violated(tmp_path: Path) -> None:
    study = small()
    strict = replace(study, emulator=replace(study.emulator, max_force_error=1e-12))
    failures, _ = part(tmp_path, "train", strict)
    assert len(failures) == 2 and failures[0].startswith("stuck: ")


def test_a_table_of_failures_names_levels_and_units() -> None:
    manifest = {
        "parameters": [
            {"name": "height", "unit": "mm", "role": "geometry", "levels": []},
            {"name": "pin", "unit": "1", "role": "factor", "levels": ["bar", "round"]},
        ],
        "runs": [
            {"index": 0, "theta": [2.5, 1.0], "file": "a", "reached": True},
            {
                "index": 1, "theta": [2.6, 1.0], "file": "b", "reached": False,
                "reached_mm": 0.85, "message": "step below its limit",
            },
            {"index": 2, "theta": [2.6, 0.0], "file": None, "reached": False},
        ],
    }  # fmt: skip
    table = failures_table("stuck", json.loads(json.dumps(manifest)))
    assert table is not None
    assert table.columns == ("run", "height [mm]", "pin [-]", "reached [mm]", "why")
    assert table.rows == (("1", "2.6", "round", "0.85", "step below its limit"),)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"executor": "mpi"}, "executor: found 'mpi', expected one of processes, serial, dask"),
        ({"scheduler": "tcp://h:1"}, "scheduler: found 'tcp://h:1', expected none without"),
    ],
)
def test_executors_that_there_are_not_are_refused(
    tmp_path: Path, how: dict[str, str], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        part(tmp_path, "simulate", map_fn=None, **how)


@pytest.mark.lasting
@pytest.mark.parametrize("executor", ["processes", "dask"])
def test_every_executor_gives_the_same_files(tmp_path: Path, executor: str) -> None:
    if executor == "dask":
        pytest.importorskip("distributed")
    for name in ("serial", executor):
        part(tmp_path / name, "simulate", map_fn=None, executor=name, workers=1)
    runs = [
        {path.name: path.read_bytes() for path in (tmp_path / name).rglob("run_*.npz")}
        for name in ("serial", executor)
    ]
    assert runs[0] == runs[1] and len(runs[0]) == 32
