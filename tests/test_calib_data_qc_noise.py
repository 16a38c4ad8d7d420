"""Noise of static frames and the mean over samples, against random fields of known covariance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from calib.data.noise_shape import correlation_at
from calib.data.qc.averaging import mean_field, mean_force
from calib.data.qc.mapping import map_field
from calib.data.qc.noise_floor import correlogram, fit_length, likeliest, noise_floor
from calib.data.qc.statistics import box

POINTS = np.array([[x, y] for x in np.arange(0, 5, 0.2) for y in np.arange(0, 2.4, 0.2)])
STD = np.array([0.004, 0.006, 0.012])


def noise(n_frames, length, share, rng):
    """(n_frames, n, 3) fields: exponential correlation, one reference in all frames."""
    factor = np.linalg.cholesky(
        np.exp(-cdist(POINTS, POINTS) / length) + 1e-9 * np.eye(len(POINTS))
    )
    reference = factor @ rng.standard_normal((len(POINTS), 3))
    own = np.stack([factor @ rng.standard_normal((len(POINTS), 3)) for _ in range(n_frames)])
    return STD * (np.sqrt(share) * reference + np.sqrt(1 - share) * own)


@pytest.mark.parametrize(("length", "share"), [(0.3, 0.5), (0.6, 0.2)])
def test_noise_floor_of_a_known_random_field_is_found(length, share):
    rng = np.random.default_rng(5)
    found = [noise_floor(noise(8, length, share, rng), POINTS) for _ in range(12)]
    np.testing.assert_allclose(np.mean([f.std for f in found], axis=0), STD, rtol=0.06)
    assert np.mean([f.correlation_length for f in found]) == pytest.approx(length, rel=0.15)
    assert np.mean([f.reference_share for f in found]) == pytest.approx(share, abs=0.06)


def test_a_shift_of_whole_frames_is_no_noise_of_their_points():
    rng = np.random.default_rng(6)
    still = noise(6, 0.3, 0.5, rng)
    moved = still + rng.standard_normal((6, 1, 3))
    a, b = noise_floor(still, POINTS), noise_floor(moved, POINTS)
    np.testing.assert_allclose(a.std, b.std, rtol=1e-9)


def test_points_that_a_frame_lacks_are_left_out():
    rng = np.random.default_rng(7)
    fields = noise(5, 0.3, 0.5, rng)
    holes = fields.copy()
    holes[2, ::7] = np.nan
    assert noise_floor(holes, POINTS).std == pytest.approx(noise_floor(fields, POINTS).std, rel=0.2)
    with pytest.raises(ValueError, match="expected 10 or more points in all frames, found 3"):
        noise_floor(np.where(np.arange(len(POINTS))[:, None] < 3, fields, np.nan), POINTS)
    with pytest.raises(ValueError, match="expected 2 or more frames"):
        noise_floor(fields[:1], POINTS)


def test_correlogram_of_independent_points_is_nothing_and_of_equal_points_one():
    rng = np.random.default_rng(8)
    independent = rng.standard_normal((200, len(POINTS), 3))
    assert np.abs(correlogram(independent, POINTS)[1]).max() < 0.05
    equal = np.repeat(rng.standard_normal((4000, 1, 1)), len(POINTS), axis=1)
    assert correlogram(equal, POINTS)[1] == pytest.approx(1.0, abs=0.1)


def test_length_and_nugget_come_back_from_their_formula():
    distance = np.arange(0.1, 2.0, 0.1)
    length, nugget = fit_length(distance, 0.8 * np.exp(-distance / 0.45))
    assert (length, nugget) == (pytest.approx(0.45, rel=1e-3), pytest.approx(0.2, abs=1e-3))


APART = cdist(POINTS, POINTS)


@pytest.mark.parametrize(
    ("length", "smoothing", "nugget"),
    [(0.3, 0.0, 0.2), (0.3, 0.015, 0.0), (0.3, 0.15, 0.0), (0.5, 0.0, 0.0)],
)
def test_likelihood_tells_a_nugget_from_smooth_noise(length, smoothing, nugget):
    rng = np.random.default_rng(11)
    matrix = (1 - nugget) * correlation_at(APART, length, smoothing)
    matrix[np.diag_indices_from(matrix)] += nugget + 1e-9
    factor, found = np.linalg.cholesky(matrix), []
    for _ in range(6):
        values = np.einsum("pq,fqc->fpc", factor, rng.standard_normal((30, len(POINTS), 3)))
        values -= values.mean(axis=1, keepdims=True)
        found.append(likeliest([(values, POINTS)], 0.0, (0.4, 0.0)))
    mean, se = np.mean(found, axis=0), np.std(found, axis=0, ddof=1) / np.sqrt(6)
    expected = np.array([length, smoothing, nugget, 1.0])
    # of two that bound each other from below, one is zero: half of what the other scatters by
    assert np.all(np.abs(mean - expected) < 4 * se + [0.003, 0.003, 0.005, 0.003])
    assert np.all([f[1] * f[2] == 0 for f in found])


def test_noise_that_was_mapped_is_smoother_than_that_of_the_dic_points():
    """DIC points of exponential noise, 0.1 mm apart; parabolas through nine of them."""
    rng = np.random.default_rng(12)
    step = 0.104
    lattice = step * np.stack(np.mgrid[0:24, 0:12], axis=-1).reshape(-1, 2)
    factor = np.linalg.cholesky(np.exp(-cdist(lattice, lattice) / 0.3))
    series = []
    for _ in range(20):  # samples whose lattices lie differently
        dic = factor @ rng.standard_normal((len(lattice), 60))
        frames = np.moveaxis(dic.reshape(24, 12, 20, 3), 2, 0).transpose(0, 2, 1, 3)
        points = POINTS[(POINTS < [1.9, 0.9]).all(axis=1)]
        at = (points + rng.uniform(0.15, 0.25, 2)) / step
        mapped = map_field(frames, at, "shape")
        series.append((mapped - mapped.mean(axis=1, keepdims=True), points))
    length, smoothing, nugget, variance = likeliest(series, 0.0, (0.3, 0.0))
    # by the weights of the parabolas the variance is 0.954, what is 0.2 mm apart keeps 0.997
    assert nugget == 0.0
    assert variance == pytest.approx(0.954, rel=0.02)
    assert length == pytest.approx(0.3, rel=0.06)
    assert np.exp(smoothing / length) == pytest.approx(1 / 0.954, abs=0.02)


TRAVEL = np.array([0.6, 1.0])


def samples(n, rng, scatter=0.0):
    """(n, n_step, n_point, 3) fields of samples that differ along one smooth shape and by noise."""
    x, y = POINTS.T
    mean = np.stack([0.1 * x, -0.2 * y, 0.3 * y * x], axis=1) * np.array([0.6, 1.0])[:, None, None]
    shape = np.stack([np.sin(x), np.cos(x) * y, 0.1 * x * y], axis=1)[None] * np.ones((2, 1, 1))
    own = scatter * rng.standard_normal((n, 1, 1, 1))
    return mean, shape, mean + own * shape + STD * rng.standard_normal((n, 2, len(POINTS), 3))


def along(patterns, shape):
    """SD of the errors of known shape along one shape."""
    sizes = np.sum(patterns * shape, axis=(1, 2, 3)) / np.sum(shape**2)
    return np.sqrt(np.sum(sizes**2))


def test_samples_that_differ_by_noise_alone_have_no_patterns():
    mean, _, fields = samples(12, np.random.default_rng(0))
    found = mean_field(fields, POINTS, TRAVEL, 0.8, STD)
    # but for errors of the place, which are small against the noise
    assert len(found.patterns) == 2
    assert np.sqrt(np.mean(found.patterns**2)) < 0.2 * STD.min() / np.sqrt(12)
    np.testing.assert_allclose(found.residual_std, STD, rtol=0.05)
    z = (found.displacement - mean) / (STD / np.sqrt(12))
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=0.06)


def test_what_samples_differ_by_becomes_the_error_of_their_mean():
    rng = np.random.default_rng(1)
    _, shape, fields = samples(16, rng, scatter=0.05)
    found = mean_field(fields, POINTS, TRAVEL, 0.8, STD)
    assert len(found.patterns) == 3  # two of them errors of the place
    # one SD of the mean: 0.05 / sqrt(16) along the shape; an SD of 16 is known to 18 %
    assert along(found.patterns, shape) == pytest.approx(0.05 / 4, rel=0.4)
    np.testing.assert_allclose(found.residual_std, STD, rtol=0.06)


@pytest.mark.lasting
def test_mean_is_right_within_its_covariance_over_many_draws():
    z = []
    for seed in range(60):
        mean, shape, fields = samples(10, np.random.default_rng(seed), scatter=0.05)
        found = mean_field(fields, POINTS, TRAVEL, 0.8, STD)
        off = np.sum((found.displacement - mean) * shape) / np.sum(shape**2)
        z.append(off / along(found.patterns, shape))
    # a mean over the SD of 10 draws is Student's t with 9 degrees: SD sqrt(9 / 7); the covariance
    # of three patterns is widened by (n - 1) / (n - 3 - 2), so that all three together are right
    assert np.std(z) == pytest.approx(np.sqrt(9 / 7) / np.sqrt(9 / 5), rel=0.25)


def test_points_that_too_few_samples_have_are_left_out():
    _, _, fields = samples(10, np.random.default_rng(2))
    fields[:3, 1, 5] = np.nan
    fields[:1, 0, 6] = np.nan
    found = mean_field(fields, POINTS, TRAVEL, 0.8, STD)
    assert not found.kept[5] and found.kept[6]
    assert sorted(set(found.n_samples.tolist())) == [9.0, 10.0]
    # but for where the others stand, which is a matter of noise here
    expected = fields[1:, 0, 6].mean(axis=0)
    np.testing.assert_allclose(found.displacement[0, 5], expected, atol=0.1 * STD.min())
    with pytest.raises(ValueError, match="expected points that enough samples have"):
        mean_field(np.full_like(fields, np.nan), POINTS, TRAVEL, 0.8, STD)


def test_a_point_that_just_enough_samples_have_is_kept():
    _, _, fields = samples(25, np.random.default_rng(4))
    fields[14:, 0, 5] = np.nan
    assert 0.56 * 25 > 14
    assert mean_field(fields, POINTS, TRAVEL, 0.56, STD).kept[5]


def test_covariance_of_forces_is_that_between_samples():
    truth = [[0.04, 0.05], [0.05, 0.09]]
    forces = np.random.default_rng(3).multivariate_normal([1, 2], truth, 4000)
    mean, covariance = mean_force(forces)
    np.testing.assert_allclose(mean, [1, 2], atol=0.02)
    np.testing.assert_allclose(covariance, truth, rtol=0.08)


def test_box_has_tukeys_whiskers():
    values = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 20.0, np.nan])
    found = box(values)
    assert found == (1.0, 2.25, 3.5, 4.75, 5.0)
    few = box(np.array([1.0, 2.0, 3.0, 100.0]))
    assert (
        few.low <= few.quarter and few.high >= few.three_quarters == 27.25
    )  # whiskers end outside the box
