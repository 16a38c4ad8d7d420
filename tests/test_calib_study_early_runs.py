"""Runs that ended early beyond the complete ones, and a posterior that reaches there."""

from __future__ import annotations

import numpy as np
import pytest

from calib.study.artifacts import plain
from calib.study.early_runs import beyond_complete_runs
from calib.study.training_runs import PartialRuns

NAMES = ("r", "height")
COMPLETE = np.array([[0.0, 2.4], [0.8, 2.4], [0.3, 2.6], [0.6, 2.5]])


def diagnostics(at: list[tuple[float, float]], relative: object, z: object) -> dict[str, object]:
    """As they are read from diagnostics.json."""
    early = PartialRuns(
        np.array(at).reshape(-1, 2),
        np.full(len(at), 1.0),
        np.array(relative, dtype=float).reshape(len(at), -1 if at else 1),
        np.array(z, dtype=float).reshape(len(at), -1 if at else 1),
        None,
    )
    found: dict[str, object] = plain(
        {"partial_runs": early, "runs": {"leave_one_out": {"ratios": COMPLETE}}}
    )
    return found


def draws(share: float) -> np.ndarray:
    """Of which a share has r above 0.8."""
    beyond = np.arange(200) < 200 * share
    return np.column_stack([np.where(beyond, 0.9, 0.5), np.full(200, 2.5)])


def test_a_posterior_beyond_all_complete_runs_is_told_with_what_early_ones_say() -> None:
    found = diagnostics(
        [(1.0, 2.5), (0.9, 2.5), (0.4, 2.5)],
        [[0.01, -0.058, np.nan], [0.02, np.nan, np.nan], [0.9, np.nan, np.nan]],
        [[3.0, 30.0, np.nan], [12.0, np.nan, np.nan], [90.0, np.nan, np.nan]],
    )
    [said] = beyond_complete_runs(found, draws(0.41), NAMES)
    assert said.startswith(
        "41% of its posterior lies beyond the runs that got through (r above 0.8)"
    )
    assert "2 runs ended early" in said  # the third has complete ones around it
    assert "off by up to 5.8% of the force, 30 of its stated SDs" in said
    assert beyond_complete_runs(found, draws(0.01), NAMES) == []


def test_a_posterior_beyond_another_side_is_not_told() -> None:
    found = diagnostics([(1.0, 2.9)], [[0.5]], [[9.0]])
    elsewhere = np.column_stack([np.full(200, 0.5), np.where(np.arange(200) < 60, 2.3, 2.5)])
    assert beyond_complete_runs(found, elsewhere, NAMES) == []
    # nor a side that the failed run lies beyond, but no draw
    [said] = beyond_complete_runs(found, draws(0.3), NAMES)
    assert said.startswith("30% of its posterior") and "height" not in said


def test_runs_that_are_good_nowhere_are_told_without_an_error() -> None:
    found = diagnostics([(0.3, 2.8)], [[np.nan, np.nan]], [[np.nan, np.nan]])
    tall = np.column_stack([np.full(200, 0.5), np.linspace(2.5, 2.7, 200)])
    [said] = beyond_complete_runs(found, tall, NAMES)
    assert "(height above 2.6), where 1 run ended early and the emulator extrapolates;" in said


@pytest.mark.parametrize("at", [[], [(0.4, 2.5)]])
def test_no_run_that_ended_early_beyond_the_complete_ones_is_no_matter(at: list) -> None:
    found = diagnostics(at, [[0.5]] * len(at), [[9.0]] * len(at))
    assert beyond_complete_runs(found, draws(0.9), NAMES) == []
