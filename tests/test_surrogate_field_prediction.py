"""Fields with a covariance of low rank: the dense one at any subset, in linear memory."""

from __future__ import annotations

import tracemalloc
from functools import cache
from typing import Any

import numpy as np
import pytest

from surrogate import Emulator, TrainingSet, held_out_residuals, sobol_design
from surrogate.coverage import coverage, mahalanobis
from surrogate.field_prediction import compress, select
from surrogate.run_scale import RunScale, mahalanobis_sizes

BOX = np.array([[0.0, 1.0], [0.0, 0.5]])


@cache
def _runs(n_point: int = 15, n: int = 12) -> TrainingSet:
    x = sobol_design(n, BOX, seed=2)
    travel = np.array([0.6, 1.0, 1.4])
    force = 40.0 * travel ** (1.5 + 0.4 * x[:, :1]) * np.exp(x[:, 1:])
    place = np.linspace(0.0, 3.0, n_point * 3)
    rows = np.sin(place * (1.0 + 0.8 * x[:, :1] + 0.9 * x[:, 1:] ** 2))
    field = travel[:, None, None] * rows.reshape(n, 1, n_point, 3)
    return TrainingSet(x, force, field)


@cache
def _emulator(n_point: int = 15) -> Emulator:
    return Emulator.fit(_runs(n_point), 1, n_restarts=0, sharing="all")


X = np.array([[0.3, 0.2], [0.8, 0.1]])


def test_with_all_directions_the_covariance_is_the_dense_one() -> None:
    emulator = _emulator()
    found = emulator.predict_field(X, n_truncation=12)
    _, variance = emulator.field_weights(X)
    for i in range(2):
        dense = emulator.field_modes * variance[i] @ emulator.field_modes.T
        dense += emulator.field_truncation_factor @ emulator.field_truncation_factor.T
        factor = found.factor(i)
        np.testing.assert_allclose(factor @ factor.T + np.diag(found.rest), dense, atol=1e-12)
        std = np.sqrt(np.diag(dense)).reshape(3, 15, 3)
        np.testing.assert_allclose(found.std[i], std, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(found.mean, emulator.displacement(X), atol=1e-14)


@pytest.mark.parametrize("n_truncation", [0, 2, 20])
def test_with_fewer_directions_the_variances_stay_the_same(n_truncation: int) -> None:
    full = _emulator().predict_field(X, n_truncation=12)
    found = _emulator().predict_field(X, n_truncation=n_truncation)
    assert found.truncation.shape[1] == min(n_truncation, 12)
    np.testing.assert_allclose(found.std, full.std, rtol=1e-8, atol=1e-10)


def test_a_subset_is_a_part_of_the_whole() -> None:
    whole = _emulator().predict_field(X, n_truncation=0)
    part = _emulator().predict_field(X, steps=[2, 0], points=[3, 7, 8], n_truncation=0)
    assert part.shape == (2, 3, 3)
    expected = whole.mean[:, [2, 0]][:, :, [3, 7, 8]]
    np.testing.assert_allclose(part.mean, expected, atol=1e-14)
    np.testing.assert_allclose(part.std, whole.std[:, [2, 0]][:, :, [3, 7, 8]], rtol=1e-12)


def test_a_mask_chooses_what_its_places_do() -> None:
    by_mask = select((3, 4, 3), [True, False, True], np.array([False, True, True, True]))
    by_place = select((3, 4, 3), [0, 2], np.array([1, 2, 3]))
    np.testing.assert_array_equal(by_mask.rows, by_place.rows)
    assert by_mask.shape == by_place.shape == (2, 3, 3)


@pytest.mark.parametrize(
    "wanted",
    [[], [3], [-1], [[0]], [0.0, 1.9], [True, False], [False] * 3, [True] * 4, ["0"], 1, [0, 0]],
)
def test_steps_and_points_that_are_none_are_refused(wanted: Any) -> None:
    with pytest.raises(
        ValueError, match="steps: expected some of 0 to 2, each once, or a mask of all 3"
    ):
        select((3, 5, 3), wanted, None)
    with pytest.raises(
        ValueError, match="points: expected some of 0 to 2, each once, or a mask of all 3"
    ):
        select((5, 3, 3), None, wanted)


def test_the_compressed_covariance_keeps_the_strongest_directions() -> None:
    factor = np.random.default_rng(0).normal(size=(30, 8)) * 0.5 ** np.arange(8)
    leading, rest = compress(factor, 3)
    with pytest.raises(ValueError, match="rank: expected a whole number of 0 or more"):
        compress(factor, -1)
    dense = factor @ factor.T
    np.testing.assert_allclose(np.diag(leading @ leading.T) + rest, np.diag(dense))
    values, vectors = np.linalg.eigh(dense)
    best = vectors[:, -3:] * values[-3:] @ vectors[:, -3:].T
    np.testing.assert_allclose(leading @ leading.T, best, atol=1e-12)


@pytest.mark.lasting
def test_memory_is_linear_in_the_number_of_points() -> None:
    """Sixteen times the points: less than 20 times the memory; a dense covariance takes 256."""
    peaks = []
    for n_point in (200, 3200):
        emulator = _emulator(n_point)
        tracemalloc.start()
        found = emulator.predict_field(X)
        assert found.std.shape == (2, 3, n_point, 3)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 20 * peaks[0]


def test_errors_are_told_as_shares_of_the_noise() -> None:
    residuals = held_out_residuals(_emulator(), _runs(15, 20))
    share = residuals.share_of_noise(np.full(3, 0.25), 0.01)
    rms = np.sqrt(np.mean(residuals.force_error**2, axis=0)).max()
    assert share.force == pytest.approx(rms / 0.25)
    assert residuals.field_error is not None and residuals.field_rms_by_point is not None
    assert residuals.field_rms_by_point.shape == (3, 15)
    by_step = np.sqrt(np.mean(residuals.field_error**2, axis=(0, 2, 3)))
    assert share.field == pytest.approx(by_step.max() / 0.01)


def test_coverage_of_true_intervals_is_what_they_state() -> None:
    """10^4 correlated vectors; the standard error of a share is at most 0.005, bounds at 4."""
    rng = np.random.default_rng(0)
    root = rng.normal(size=(4, 4))
    error = rng.normal(size=(10_000, 4)) @ root.T
    covariance = np.broadcast_to(root @ root.T, (10_000, 4, 4))
    std = np.sqrt(np.diag(root @ root.T))
    size, normal = mahalanobis(error, covariance).size, mahalanobis_sizes(4)
    rank = RunScale().rank(size, normal)
    found = coverage(error / std, (rank, rank))
    assert found.joint is not None
    np.testing.assert_allclose(found.joint, [0.5, 0.8, 0.95], atol=0.02)
    np.testing.assert_allclose(found.by_step, np.tile([0.5, 0.8, 0.95], (4, 1)), atol=0.02)
    half = RunScale().rank(mahalanobis(error, 0.25 * covariance).size, normal)
    half = coverage(2.0 * error / std, (half, half))
    assert half.joint is not None and half.joint[2] < 0.7 and half.overall[2] < 0.7
