"""Campaigns that share one pool: same runs as one by one, kept as they come, each run once."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from analytic_block import AnalyticBlock

from calib.study.simulations import RunSet, StoredSimulate, load_run, run_together
from fe.executors import serial_map

BLOCK = AnalyticBlock(
    area=40.0, height=2.5, stiffening=0.5, cells=(4, 2, 4), travel=(0.6, 1.0, 1.4)
)
RATIOS = np.random.default_rng(11).random((5, 2))


def _sets(folder: Path) -> list[RunSet]:
    return [
        RunSet(BLOCK, RATIOS, folder / "stuck"),
        RunSet(replace(BLOCK, stiffening=0.0), RATIOS[:3], folder / "sliding"),
    ]


def _shuffled(f: Callable[[Any], Any], items: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
    """Results in another order than asked, as from several processes."""
    for index in np.random.default_rng(1).permutation(len(items)):
        yield int(index), f(items[index])


def _refuse(f: Callable[[Any], Any], items: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
    raise AssertionError(f"nothing was to run, found {len(items)} items")


def test_every_run_goes_to_its_own_campaign_in_whatever_order_results_come(tmp_path: Path) -> None:
    campaigns = run_together(_sets(tmp_path), _shuffled)
    for run_set, campaign in zip(_sets(tmp_path), campaigns, strict=True):
        expected = np.stack([run_set.simulate(row).force for row in run_set.ratios])
        np.testing.assert_array_equal(campaign.force, expected)


def test_progress_counts_the_runs_of_all_campaigns_once(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    run_together(_sets(tmp_path), _shuffled, lambda done, total: seen.append((done, total)))
    assert {total for _, total in seen} == {8}
    done = [d for d, _ in seen]
    assert done == sorted(done) and done[0] == 0 and done[-1] == 8


def test_finished_campaigns_run_nothing_again(tmp_path: Path) -> None:
    run_together(_sets(tmp_path), serial_map)
    campaigns = run_together(_sets(tmp_path), _refuse)
    assert [campaign.n_reused for campaign in campaigns] == [5, 3]


def test_an_interrupted_pool_goes_on_and_loses_no_run_that_arrived(tmp_path: Path) -> None:
    calls = 0

    def interrupted(f: Callable[[Any], Any], items: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
        for index, item in enumerate(items):
            if index == 3:
                raise KeyboardInterrupt
            yield index, f(item)

    def counted(f: Callable[[Any], Any], items: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
        nonlocal calls
        for index, item in enumerate(items):
            calls += 1
            yield index, f(item)

    with pytest.raises(KeyboardInterrupt):
        run_together(_sets(tmp_path), interrupted)
    assert len(list(tmp_path.rglob("run_*.npz"))) == 3
    run_together(_sets(tmp_path), counted)
    assert calls == 5


def test_a_changed_model_does_not_take_the_runs_of_the_old_one(tmp_path: Path) -> None:
    run_together(_sets(tmp_path), serial_map)
    stiffer = replace(BLOCK, stiffening=0.7)
    assert load_run(tmp_path / "stuck", BLOCK, RATIOS[0]) is not None
    assert load_run(tmp_path / "stuck", stiffer, RATIOS[0]) is None
    assert len(RunSet(stiffer, RATIOS, tmp_path / "stuck").missing()) == 5


def test_a_stored_simulation_is_solved_once_and_listed(tmp_path: Path) -> None:
    stored = StoredSimulate(BLOCK, tmp_path / "map")
    for row in (*RATIOS, *RATIOS):
        np.testing.assert_array_equal(stored(row).force, BLOCK(row).force)
    manifest = json.loads((tmp_path / "map" / "manifest.json").read_text())
    np.testing.assert_array_equal([run["ratios"] for run in manifest["runs"]], RATIOS)
    assert len(list((tmp_path / "map").glob("run_*.npz"))) == len(RATIOS)


def test_a_stored_simulation_takes_runs_of_the_design(tmp_path: Path) -> None:
    run_together(_sets(tmp_path), serial_map)
    StoredSimulate(BLOCK, tmp_path / "map", (tmp_path / "stuck",))(RATIOS[2])
    assert not (tmp_path / "map").exists()
