"""Noise of the mean field: which correlation holds where the DIC program states one."""

from __future__ import annotations

import numpy as np
import pytest

from calib.data.noise_shape import correlation_at, fall_off
from calib.data.qc.averaging import MeanField
from calib.data.qc.mean_noise import mean_noise, noise_doubts
from calib.data.qc.noise_floor import noise_floor
from calib.data.qc.static_noise import StaticNoise


def smooth_scatter():
    """Points of a face and the mean field of samples whose noise is smooth over half a mm."""
    x, y = np.meshgrid(0.2 * np.arange(11), 0.2 * np.arange(7), indexing="ij")
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    root = np.linalg.cholesky(correlation_at(apart, 0.15, 0.4) + 1e-9 * np.eye(len(points)))
    rng = np.random.default_rng(2)
    residual = 1e-3 * np.swapaxes(rng.standard_normal((12, 3, 3, len(points))) @ root.T, 2, 3)
    mean = MeanField(
        np.ones(len(points), bool),
        np.zeros((3, len(points), 3)),
        np.full(len(points), 12),
        np.zeros((0, 3, len(points), 3)),
        residual,
        np.full(3, 1e-3),
        np.zeros((12, 3)),
    )
    return points, mean


def test_correlation_has_fallen_to_1_over_e_at_its_fall_off():
    for length, smoothing in ((0.3, 0.0), (0.3, 0.05), (0.1, 0.6)):
        distance = np.array([fall_off(length, smoothing)])
        assert correlation_at(distance, length, smoothing)[0] == pytest.approx(np.exp(-1.0))
    assert fall_off(0.3, 0.0) == pytest.approx(0.3)


def test_a_stated_length_counts_only_where_it_reaches_further_than_the_noise_found():
    """It is that of an exponential: noise found smooth keeps its shape, or is left for it whole."""
    points, mean = smooth_scatter()
    found = mean_noise(points, mean, None, None).together
    reach = fall_off(found.correlation_length, found.smoothing)
    assert found.smoothing > 0.1  # so that its length alone is much less than its reach
    assert found.correlation_length < 0.7 * reach
    shorter = mean_noise(points, mean, None, None, 0.9 * reach).together
    assert (shorter.correlation_length, shorter.smoothing) == (
        found.correlation_length,
        found.smoothing,
    )
    longer = mean_noise(points, mean, None, None, 1.1 * reach).together
    assert (longer.correlation_length, longer.smoothing) == (1.1 * reach, 0.0)


@pytest.mark.parametrize(("quieter", "doubted"), [(1.0, False), (0.3, True)])
def test_static_frames_that_are_quieter_than_samples_do_not_lower_their_noise(quieter, doubted):
    points, mean = smooth_scatter()
    samples = mean_noise(points, mean, None, None).together.std
    frames = quieter * np.concatenate(list(np.roll(mean.residual, 1, axis=0)))
    floor = noise_floor(frames, points)
    found = mean_noise(points, mean, StaticNoise(floor, floor, frames), None)
    np.testing.assert_allclose(found.together.std, samples, rtol=0.1)
    said = noise_doubts(found)
    assert len(said) == doubted
    assert all("times as much as static frames" in sentence for sentence in said)
