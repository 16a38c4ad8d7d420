"""Covariances of derivatives are derivatives of covariances, in all families and coordinates."""

from __future__ import annotations

import numpy as np
import pytest

from surrogate.covariance import (
    covariance,
    mean_gradient,
    prior_variance,
    rows_of,
    slopes_by_length,
    values_only,
)
from surrogate.warp import STRENGTHS, warp_slope, warped

LENGTH = np.array([0.5, 0.8, 1.3])
RNG = np.random.default_rng(0)
X, Y = RNG.random((7, 3)), RNG.random((4, 3))
FULL = rows_of(np.ones((7, 3), dtype=bool))
H = 1e-5


@pytest.mark.parametrize("family", range(3))
def test_the_covariance_with_a_derivative_is_the_limit_of_differences(family: int) -> None:
    values = values_only(4, 3)
    found = covariance(family, LENGTH, Y, values, X, FULL)
    for axis, step in enumerate(H * np.eye(3)):
        above, below = (
            covariance(family, LENGTH, Y, values, X + sign * step, values_only(7, 3))
            for sign in (1, -1)
        )
        own = found[:, FULL.of_point[:, 1 + axis]]
        np.testing.assert_allclose(own, (above - below) / (2 * H), atol=1e-8)


@pytest.mark.parametrize("family", range(3))
def test_the_covariance_of_two_derivatives_is_the_limit_of_differences(family: int) -> None:
    full = rows_of(np.ones((4, 3), dtype=bool))
    found = covariance(family, LENGTH, Y, full, X, FULL)
    for axis, step in enumerate(H * np.eye(3)):
        above, below = (
            covariance(family, LENGTH, Y + sign * step, values_only(4, 3), X, FULL)
            for sign in (1, -1)
        )
        own = found[full.of_point[:, 1 + axis]]
        np.testing.assert_allclose(own, (above - below) / (2 * H), atol=1e-7)


@pytest.mark.parametrize("family", range(3))
def test_the_matrix_of_all_rows_is_symmetric_positive_definite_with_the_stated_diagonal(
    family: int,
) -> None:
    matrix = covariance(family, LENGTH, X, FULL, X, FULL)
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-14)
    assert np.linalg.eigvalsh(matrix).min() > 0.0
    np.testing.assert_allclose(np.diag(matrix), prior_variance(family, LENGTH, FULL), atol=1e-14)


@pytest.mark.parametrize("family", range(3))
def test_rows_that_are_left_out_leave_the_others_as_they_are(family: int) -> None:
    usable = np.random.default_rng(1).random((7, 3)) > 0.4
    rows = rows_of(usable)
    kept = np.concatenate([np.arange(7), 7 + np.flatnonzero(usable.ravel())])
    full = covariance(family, LENGTH, X, FULL, X, FULL)
    some = covariance(family, LENGTH, X, rows, X, rows)
    np.testing.assert_array_equal(some, full[np.ix_(kept, kept)])


@pytest.mark.parametrize("family", range(3))
def test_slopes_by_length_are_limits_of_differences(family: int) -> None:
    weight = np.random.default_rng(2).normal(size=(28, 28))
    weight = weight + weight.T
    found = slopes_by_length(family, LENGTH, X, FULL, weight)
    for axis in range(3):
        sums = []
        for sign in (1, -1):
            length = LENGTH * np.exp(sign * H * np.eye(3)[axis])
            sums.append(np.sum(weight * covariance(family, length, X, FULL, X, FULL)))
        assert found[axis] == pytest.approx((sums[0] - sums[1]) / (2 * H), rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("family", range(3))
def test_the_gradient_of_the_mean_is_the_limit_of_differences(family: int) -> None:
    weights = np.random.default_rng(3).normal(size=(28, 2))
    found = mean_gradient(family, LENGTH, Y, X, FULL, weights)
    for axis, step in enumerate(H * np.eye(3)):
        above, below = (
            covariance(family, LENGTH, Y + sign * step, values_only(4, 3), X, FULL) @ weights
            for sign in (1, -1)
        )
        np.testing.assert_allclose(found[:, axis], (above - below) / (2 * H), atol=1e-6)


@pytest.mark.parametrize("strength", STRENGTHS)
def test_stretched_coordinates_keep_the_ends_and_have_the_stated_slope(strength: float) -> None:
    """Also below the low edge, where they go on along their tangent."""
    c, u = np.array([strength]), np.linspace(-0.3, 1.2, 31)[:, None] + 1e-3
    np.testing.assert_allclose(warped(np.array([[0.0], [1.0]]), c), [[0.0], [1.0]], atol=1e-15)
    difference = (warped(u + 1e-6, c) - warped(u - 1e-6, c)) / 2e-6
    np.testing.assert_allclose(warp_slope(u, c), difference, rtol=1e-5)
    assert (warp_slope(u, c) > 0.0).all()
