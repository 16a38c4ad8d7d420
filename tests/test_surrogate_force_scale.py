"""Scales of a force: what mean and covariance of a logarithm say of the force."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from surrogate.coordinates import FAMILIES, Chosen
from surrogate.force_scale import ForceScale, choose_scale


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


@pytest.mark.parametrize(("judged", "log"), [([0, 1], True), ([2, 3], False)])
def test_scales_are_compared_by_densities_of_the_force(
    judged: list[int], log: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Equal densities of y: of a force below the mean ln f takes less, so it is more probable."""

    def equal(x: Any, y: Any, slopes: Any) -> Chosen:
        return Chosen(np.zeros(1), FAMILIES[0], 0.0, np.array(judged))

    monkeypatch.setattr("surrogate.force_scale.choose_coordinates", equal)
    force = np.array([[1.0, 2.0], [2.0, 3.0], [5.0, 9.0], [6.0, 12.0]])
    chosen = choose_scale(np.linspace(0.0, 1.0, 4)[:, None], force, None)
    assert chosen.scale.log is log
