"""Campaigns that share one pool: same runs as one by one, kept as they come, each run once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from toy_simulation import RATIOS, Toy

from fe.campaign import CampaignFailed, CampaignPlan, load_campaign, run_campaigns
from fe.executors import serial_map


def _plans(folder: Path) -> list[CampaignPlan]:
    return [
        CampaignPlan(Toy(), RATIOS[:5], folder / "stuck"),
        CampaignPlan(Toy(factor=2.0), RATIOS[:3], folder / "sliding"),
    ]


def _shuffled(f: Callable[[Any], Any], items: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
    """Results in another order than asked, as from several processes."""
    for index in np.random.default_rng(1).permutation(len(items)):
        yield int(index), f(items[index])


def _refuse(f: Callable[[Any], Any], items: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
    raise AssertionError(f"nothing was to run, found {len(items)} items")


def test_every_run_goes_to_its_own_campaign_in_whatever_order_results_come(tmp_path: Path) -> None:
    campaigns = run_campaigns(_plans(tmp_path), _shuffled)
    for plan, campaign in zip(_plans(tmp_path), campaigns, strict=True):
        expected = np.stack([plan.simulate(row).force for row in plan.theta])
        np.testing.assert_array_equal(campaign.force, expected)


def test_progress_counts_the_runs_of_all_campaigns_once(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    run_campaigns(_plans(tmp_path), _shuffled, lambda done, total: seen.append((done, total)))
    assert {total for _, total in seen} == {8}
    done = [d for d, _ in seen]
    assert done == sorted(done) and done[0] == 0 and done[-1] == 8


def test_finished_campaigns_run_nothing_again(tmp_path: Path) -> None:
    run_campaigns(_plans(tmp_path), serial_map)
    campaigns = run_campaigns(_plans(tmp_path), _refuse)
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
        run_campaigns(_plans(tmp_path), interrupted)
    assert len(list(tmp_path.rglob("run_*.npz"))) == 3
    run_campaigns(_plans(tmp_path), counted)
    assert calls == 5


def test_a_finished_campaign_is_loaded_and_an_unfinished_one_refused(tmp_path: Path) -> None:
    first, second = _plans(tmp_path)
    [done] = run_campaigns([first])
    assert load_campaign(first).force.tobytes() == done.force.tobytes()
    with pytest.raises(ValueError, match=r"sliding: expected all 3 runs .* found 3 missing"):
        load_campaign(second)
    assert not (tmp_path / "sliding").exists()


def test_too_many_failures_in_one_campaign_stop_all_and_name_it(tmp_path: Path) -> None:
    plans = [
        CampaignPlan(Toy(fails_above=0.2), RATIOS[[2, 1, 3, 4]], tmp_path / "stuck"),
        CampaignPlan(Toy(), RATIOS[:3], tmp_path / "sliding"),
    ]
    with pytest.raises(CampaignFailed, match="stuck: 1 of 4 runs failed"):
        run_campaigns(plans)
    assert len(list((tmp_path / "stuck").glob("run_*.npz"))) == 2
    assert not list((tmp_path / "sliding").glob("run_*.npz"))


def test_two_plans_of_one_store_are_refused(tmp_path: Path) -> None:
    plans = [CampaignPlan(Toy(), RATIOS[:2], tmp_path), CampaignPlan(Toy(), RATIOS[2:], tmp_path)]
    with pytest.raises(ValueError, match="a store of its own"):
        run_campaigns(plans)
