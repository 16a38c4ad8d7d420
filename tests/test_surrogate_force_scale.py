"""Scales of a force: what mean and covariance of a logarithm say of the force."""

from __future__ import annotations

import numpy as np

from surrogate.force_scale import ForceScale


def test_a_lognormal_force_has_its_median_and_its_spread_relative_to_the_mean() -> None:
    """Of 400000 draws, within a few of their standard errors."""
    y, covariance = np.array([0.1, -0.2]), np.array([[0.09, 0.03], [0.03, 0.04]])
    scale = ForceScale(np.array([2.0, 50.0]), log=True)
    logs = np.random.default_rng(0).multivariate_normal(y, covariance, 400_000)
    drawn = scale.mean * np.exp(logs)
    [centre], [found] = scale.force(y[None], covariance[None])
    np.testing.assert_allclose(np.median(drawn, axis=0), centre, rtol=3e-3)
    relative = np.cov((drawn / drawn.mean(axis=0)).T)
    np.testing.assert_allclose(found / np.outer(centre, centre), relative, rtol=2e-2)
