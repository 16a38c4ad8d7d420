"""Populations hold their truths as often as they say."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from benchmarks.population_calibration import NAMES, all_ranks, report
from calib.inference.rank_uniformity import uniformity

STORED = Path(__file__).parents[1] / "docs/verification/population.json"


def test_stored_ranks_are_in_their_bands() -> None:
    found = json.loads(STORED.read_text())
    assert found["n"] >= 100
    for name in NAMES:
        assert found[name]["ecdf_distance"] <= found[name]["ecdf_band"]


def test_a_report_of_wrong_ranks_says_so() -> None:
    """Posteriors half as wide as they should be: ranks pile up at the ends."""
    rng = np.random.default_rng(0)
    right = rng.random((200, 4))
    wrong = ndtr(2.0 * ndtri(right))
    found, bad = report(right), report(wrong)
    assert found[NAMES[0]]["chi_square_p"] > 1e-3
    assert bad[NAMES[0]]["chi_square_p"] < 1e-4


@pytest.mark.slow
def test_forty_virtual_populations_hold_their_truths() -> None:
    """Four quantities, each with a false alarm of 0.001 (fixed seeds)."""
    below = all_ranks(40)
    for column, name in enumerate(NAMES):
        assert uniformity(below[:, column], n_bin=8, false_alarm=1e-3).inside_band, name
