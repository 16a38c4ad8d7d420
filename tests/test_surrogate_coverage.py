"""Distances in covariances that leave some directions out, and the coverage told by them."""

from __future__ import annotations

import numpy as np
import pytest

from surrogate import Residuals
from surrogate.coverage import coverage, mahalanobis
from surrogate.run_scale import RunScale, mahalanobis_sizes

pytestmark = pytest.mark.lasting


def _drawn(n: int, n_step: int, rank: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors (n, n_step) and their covariances, each of its own; steps of very different size."""
    rng = np.random.default_rng(3)
    root = rng.normal(size=(n, n_step, rank)) * 10.0 ** -np.arange(n_step)[:, None]
    error = np.einsum("nik,nk->ni", root, rng.normal(size=(n, rank)))
    return error, root @ root.transpose(0, 2, 1)


@pytest.mark.parametrize("rank", [1, 3, 5])
def test_the_rank_of_the_covariance_is_the_freedom_of_the_distance(rank: int) -> None:
    """10^4 errors of 8 steps; the standard error of a share is at most 0.005, bounds at 4."""
    error, covariance = _drawn(10_000, 8, rank)
    found = mahalanobis(error, covariance)
    assert (found.rank == rank).all()
    assert np.mean(found.size**2) == pytest.approx(rank, rel=0.06)
    ranks = RunScale().rank(found.size, mahalanobis_sizes(found.rank))
    joint = coverage(np.zeros((10_000, 8)), (ranks, ranks)).joint
    assert joint is not None
    np.testing.assert_allclose(joint, [0.5, 0.8, 0.95], atol=0.02)


def test_weak_steps_of_a_covariance_of_full_rank_count_in_full() -> None:
    """SDs from 1 to 1e-7: variances whose ratio is below the share that is rounding."""
    error, covariance = _drawn(200, 8, 20)
    found = mahalanobis(error, covariance)
    assert (found.rank == 8).all()
    scale = 10.0 ** np.arange(8)
    scaled = np.linalg.solve(covariance * scale[:, None] * scale, (error * scale)[..., None])
    expected = np.sqrt(np.einsum("ni,ni->n", error * scale, scaled[..., 0]))
    np.testing.assert_allclose(found.size, expected, rtol=1e-7)


def test_what_has_no_variance_counts_nothing() -> None:
    found = mahalanobis(np.array([[3.0, 5.0], [2.0, 2.0]]), np.array([np.diag([4.0, 0.0])] * 2))
    np.testing.assert_allclose(found.size, [1.5, 1.0])
    nothing = mahalanobis(np.ones((1, 2)), np.zeros((1, 2, 2)))
    assert nothing.size[0] == 0.0 and nothing.rank[0] == 0
    assert RunScale(0.1, 0.5).rank(nothing.size, mahalanobis_sizes(nothing.rank))[0] == 0.0


def test_joint_regions_of_forces_are_of_the_directions_that_are_known() -> None:
    """4000 runs of 8 steps known by 3 modes: shares to 0.008, the scale's moments to 0.013."""
    error, covariance = _drawn(4000, 8, 3)
    residuals = Residuals(np.ones(error.shape), error, covariance, None, None, None)
    found = residuals.errors().force_coverage
    assert found.joint is not None
    np.testing.assert_allclose(found.joint, [0.5, 0.8, 0.95], atol=0.032)
    told = residuals.told_scales.force
    assert abs(told.log_mean) < 0.065 and told.log_std < 0.25
