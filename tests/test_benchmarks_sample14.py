"""What the comparison on DIC Challenge sample 14 is computed with, on waves whose loss is known."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.sample14 import (
    Sample,
    Wave,
    averaged,
    by_noise,
    followed,
    half_waves,
    losses,
    trade_off,
)
from benchmarks.sample14_efficiency import effective_subset, resolution
from benchmarks.sample14_programs import programs
from calib.dic import CorrelationSettings
from calib.dic.overlap import error_correlation

X = np.arange(2000.0)
TRUTH = 0.1 * np.sin(2 * np.pi * (X / 400 + (X / 1000) ** 2))
"""px, periods of 370 to 155 px"""


def wave(mean, step=8, noise=0.01):
    at = np.arange(40.0, 1960.0, step)
    return Wave(at, np.interp(at, X, mean), np.full(at.size, noise**2))


def test_a_tenth_of_a_wave_is_lost_at_the_period_published_for_a_subset_of_17_px():
    """67.8 px, order 1: Reu et al. 2022, Exp. Mech. 62:639, appendix."""
    assert resolution(17, 1) == pytest.approx(67.8, abs=0.1)
    for order, subset in ((1, 31), (2, 31)):
        period = resolution(subset, order)
        passed = followed(np.cos(2 * np.pi * (X - 1000) / period), subset, order)[1000]
        assert passed == pytest.approx(0.9, abs=0.002)


def test_the_subset_that_a_wave_went_through_is_found_again():
    for order, subset in ((1, 31), (1, 41), (2, 91)):
        for through in (subset - 4, subset + 4):
            found = effective_subset(wave(followed(TRUTH, through, order)), TRUTH, subset, order)
            assert found == pytest.approx(through, rel=0.02)


def test_a_wave_of_nine_tenths_has_lost_a_tenth_in_each_half():
    lost = losses(0.9 * TRUTH, TRUTH)
    assert len(lost) == len(half_waves(TRUTH)) >= 15
    np.testing.assert_allclose(lost, 0.01, rtol=0.01)
    figures = trade_off(wave(0.9 * TRUTH), TRUTH, 31, 1)
    assert figures["amplitude_error_px"] == pytest.approx(0.01, rel=0.02)
    assert figures["mean_loss_px"] == pytest.approx(0.01, rel=0.02)
    assert figures["noise_px"] == pytest.approx(0.01)


def test_columns_are_averaged_over_the_rows_that_were_found():
    points = np.array([[8.0, 0.0], [16.0, 0.0], [8.0, 8.0], [16.0, 8.0], [8.0, 16.0]])
    found = averaged(points, np.array([1.0, 4.0, 3.0, np.nan, 5.0]))
    np.testing.assert_allclose(found.x, [8.0, 16.0])
    np.testing.assert_allclose(found.mean, [3.0, 4.0])
    np.testing.assert_allclose(found.variance, [8.0 / 3.0, 0.0])


def test_the_loss_that_noise_alone_shows_is_that_of_overlapping_subsets():
    settings = CorrelationSettings(subset=51, order=2)
    at, y = wave(TRUTH).x, np.arange(30.0, 560.0, 8.0)
    points = np.column_stack([v.ravel() for v in np.meshgrid(at, y)])
    stated = by_noise(wave(TRUTH, noise=0.014), TRUTH, points, settings)
    # the noise of the means drawn directly, not through the half waves
    rows = float(error_correlation(settings, np.zeros(1), y[:, None] - y).mean())
    across = error_correlation(settings, at[:, None] - at, np.zeros(1))
    rng = np.random.default_rng(1)
    noise = rng.multivariate_normal(np.zeros(at.size), 0.014**2 * rows * across, 1000)
    passed, there = (np.interp(at, X, v) for v in (followed(TRUTH, 51, 2), TRUTH))
    drawn = np.array([losses(passed + one, there) for one in noise])
    largest = np.abs(drawn).max(axis=1)
    assert stated["expected_error_px"] == pytest.approx(np.median(largest), rel=0.05)
    assert stated["expected_error_95_px"] == pytest.approx(np.quantile(largest, 0.95), rel=0.1)
    assert stated["mean_loss_sd_px"] == pytest.approx(drawn.mean(axis=1).std(), rel=0.1)


def test_without_an_environment_of_another_program_there_are_no_figures(tmp_path, capsys):
    sample = Sample(np.zeros((9, 9)), {}, {})
    assert programs(sample, tmp_path, tmp_path / "peers") == {}
    said = capsys.readouterr().err
    assert "no environment of SUN-DIC, muDIC, pyvale" in said and said.count("\n") == 1
