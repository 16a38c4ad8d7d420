"""Scales of a force: what mean and covariance of a logarithm say of the force."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from surrogate.coordinates import FAMILIES, Chosen
from surrogate.design import unit_design
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
        return Chosen(np.zeros(1), FAMILIES[0], np.array(judged))

    def exact(x: Any, y: np.ndarray, *_: Any) -> tuple[np.ndarray, np.ndarray]:
        return y, np.zeros_like(y)

    monkeypatch.setattr("surrogate.force_scale.choose_coordinates", equal)
    monkeypatch.setattr("surrogate.force_scale.left_out", exact)
    force = np.array([[1.0, 2.0], [2.0, 3.0], [5.0, 9.0], [6.0, 12.0]])
    chosen = choose_scale(np.linspace(0.0, 1.0, 4)[:, None], force, None)
    assert chosen.scale.log is log


@pytest.mark.parametrize("with_slopes", [False, True])
@pytest.mark.parametrize("log", [False, True])
def test_a_scale_on_which_forces_have_fewer_modes_is_taken(log: bool, with_slopes: bool) -> None:
    """Exactly two modes on one scale, eight and more on the other: rounding is no merit."""
    travel = np.linspace(0.1, 0.6, 8)
    shapes = np.array([1.0 / (1.0 - travel) ** 2, travel])
    x = unit_design(16, 2, 0)

    def force(x: np.ndarray) -> np.ndarray:
        y = np.column_stack([1.0 + x[:, 0], 0.5 + x[:, 1] ** 2]) @ shapes
        return np.exp(y) if log else y

    gradient = None
    if with_slopes:
        steps = 1e-5 * np.eye(2)
        moved = [(force(x + step) - force(x - step)) / 2e-5 for step in steps]
        gradient = np.stack(moved, axis=-1)
    assert choose_scale(x, force(x), gradient).scale.log is log
