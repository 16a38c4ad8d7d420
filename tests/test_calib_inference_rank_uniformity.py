"""Tests of uniformity keep the false-alarm rate they state and see what is not uniform."""

from __future__ import annotations

import numpy as np
import pytest

from calib.inference.rank_uniformity import clustered_error, coverage, uniformity


def test_false_alarms_come_at_the_stated_rate() -> None:
    """600 uniform sets of 300; rates within 4 binomial SDs: false alarm below 2e-4."""
    rng = np.random.default_rng(1)
    found = [uniformity(rng.random(300), false_alarm=0.05) for _ in range(600)]
    bound = 4 * np.sqrt(0.05 * 0.95 / 600)
    for alarms in (
        [one.chi_square_p < 0.05 for one in found],
        [not one.inside_band for one in found],
        [one.ecdf_p < 0.05 for one in found],
    ):
        assert abs(np.mean(alarms) - 0.05) < bound


@pytest.mark.parametrize("shape", [(0.6, 0.6), (2.2, 2.2), (1.6, 1.0)])
def test_narrow_wide_and_shifted_posteriors_are_seen(shape: tuple[float, float]) -> None:
    found = uniformity(np.random.default_rng(2).beta(*shape, 300))
    assert found.chi_square_p < 1e-3 or found.ecdf_p < 1e-3


def test_coverage_counts_central_intervals() -> None:
    below = np.array([[0.5], [0.26], [0.05], [0.99]])
    assert coverage(below)[:, 0].tolist() == [0.5, 0.5, 0.75]


def test_members_of_a_cluster_that_agree_count_once() -> None:
    inside = np.repeat(np.random.default_rng(1).random(40) < 0.5, 5).astype(float)
    alone = clustered_error(inside, np.arange(200))
    together = clustered_error(inside, np.repeat(np.arange(40), 5))
    assert together / alone == pytest.approx(np.sqrt(5.0), rel=0.03)


def test_impossible_probabilities_and_too_many_bins_are_refused() -> None:
    with pytest.raises(ValueError, match="below: expected in"):
        uniformity(np.array([0.5] * 99 + [1.1]))
    with pytest.raises(ValueError, match="n_bin: expected at most 8 for 40"):
        uniformity(np.linspace(0, 1, 40))
