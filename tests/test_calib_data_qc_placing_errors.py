"""Samples that are taken from slightly wrong places and travels."""

import numpy as np
import pytest

from calib.data.qc.averaging import mean_field
from calib.data.qc.placing_errors import field_slopes, placed

X, Y = (c.ravel() for c in np.meshgrid(np.arange(0.1, 5, 0.2), np.arange(0.1, 2.5, 0.2)))
POINTS = np.stack([X, Y], axis=1)
TRAVEL = np.array([0.6, 0.8, 1.0, 1.2, 1.4])


def field(x, y, d):
    """(n_step, n, 3) a smooth field, mm."""
    d = np.atleast_1d(d)[:, None]
    across, up = np.sin(0.6 * x) * d, -0.2 * y * d * np.exp(-((x / 3) ** 2))
    return np.stack([0.3 * across * y, up, 0.3 * d**2 * np.cos(0.5 * x) * y], axis=-1)


def differences(step=1e-4):
    """(3, n_step, n, 3) slopes of the field by central differences."""
    x = (field(X + step, Y, TRAVEL) - field(X - step, Y, TRAVEL)) / (2 * step)
    y = (field(X, Y + step, TRAVEL) - field(X, Y - step, TRAVEL)) / (2 * step)
    d = (field(X, Y, TRAVEL + step) - field(X, Y, TRAVEL - step)) / (2 * step)
    return np.stack([x, y, d])


def test_slopes_over_scattered_points_are_those_of_the_field():
    keep = np.random.default_rng(0).random(X.size) < 0.8
    found = field_slopes(field(X, Y, TRAVEL)[:, keep], POINTS[keep], TRAVEL)
    np.testing.assert_allclose(found[:2], differences()[:2, :, keep], atol=0.02)
    inner = found[2, 1:-1]
    np.testing.assert_allclose(inner, differences()[2, 1:-1][:, keep], atol=1e-10)


def test_slopes_are_zero_where_points_or_travels_are_too_few():
    found = field_slopes(field(X, Y, TRAVEL)[:2, :5], POINTS[:5], TRAVEL[:2])
    assert not found.any()


def misplaced(n, rng, sd, noise):
    """(n, n_step, n_point, 3) a field taken from wrong places and travels, with noise."""
    off = rng.standard_normal((n, 3)) * sd
    taken = [field(X + a, Y + b, TRAVEL + d) for a, b, d in off]
    return np.array(taken) + noise * rng.standard_normal((n, TRAVEL.size, X.size, 3))


def test_errors_of_place_and_travel_are_found_with_their_size():
    sd, noise = np.array([0.01, 0.03, 0.01]), np.full(3, 0.002)
    fields = misplaced(200, np.random.default_rng(1), sd, noise)
    mean = fields.mean(axis=0)
    has = np.ones((200, X.size), dtype=bool)
    found = placed(fields - mean, has, field_slopes(mean, POINTS, TRAVEL), noise)
    # an SD of 200 draws is known to 5 %
    np.testing.assert_allclose(found.sizes.std(axis=0, ddof=1), sd, rtol=0.2)
    assert found.rest.std() == pytest.approx(0.002, rel=0.02)


@pytest.mark.lasting
def test_mean_of_misplaced_samples_is_right_within_what_is_stated():
    """False alarm below 1e-4: the mean of 30 chi-squares over 4,500 values each, SD 0.004."""
    sd, noise, n = np.array([0.005, 0.03, 0.01]), np.full(3, 0.004), 16
    ratios = []
    for seed in range(30):
        fields = misplaced(n, np.random.default_rng(seed), sd, noise)
        found = mean_field(fields, POINTS, TRAVEL, 0.8, noise)
        off = (found.displacement - field(X, Y, TRAVEL)) / (noise / np.sqrt(n))
        shapes = (found.patterns / (noise / np.sqrt(n))).reshape(len(found.patterns), -1)
        along = shapes @ off.ravel()
        inner = np.eye(len(shapes)) + shapes @ shapes.T
        total = np.sum(off**2) - along @ np.linalg.solve(inner, along)
        ratios.append(total / off.size)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.02)


def test_a_sample_without_some_points_is_fitted_by_the_others():
    sd, noise = np.array([0.0, 0.03, 0.0]), np.full(3, 1e-6)
    fields = misplaced(12, np.random.default_rng(2), sd, noise)
    mean = fields.mean(axis=0)
    slopes = field_slopes(mean, POINTS, TRAVEL)
    has = np.random.default_rng(3).random((12, X.size)) < 0.7
    off = np.where(has[:, None, :, None], fields - mean, 0.0)
    found = placed(off, has, slopes, noise)
    assert np.all(found.rest[:, :, 0][~has[:, 0]] == 0.0)
    assert np.abs(found.rest).max() < 0.1 * np.abs(off).max()


def test_points_that_misplaced_samples_lack_are_right_all_the_same():
    rng = np.random.default_rng(4)
    fields = misplaced(16, rng, np.array([0.0, 0.03, 0.01]), 1e-4)
    high = np.argsort(np.mean(fields[:, -1, :, 1], axis=1))[:3]
    fields[high[:, None], :, : X.size // 3] = np.nan  # the three that differ most lack a third
    found = mean_field(fields, POINTS, TRAVEL, 0.8, np.full(3, 1e-4))
    off = found.displacement - field(X, Y, TRAVEL)
    step = off[:, : X.size // 3].mean(axis=1) - off[:, X.size // 3 :].mean(axis=1)
    some = np.nanmean(fields, axis=0) - field(X, Y, TRAVEL)
    plain = some[:, : X.size // 3].mean(axis=1) - some[:, X.size // 3 :].mean(axis=1)
    assert np.abs(step).max() < 0.5 * np.abs(plain).max()
