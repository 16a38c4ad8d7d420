"""Repeats of one test: the likelihood is that of the dense normal, and it finds what was drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from calib.inference.box_posterior import sample_box
from calib.inference.repeats import Predictive, Repeats, Scatter, log_density

TRAVEL = np.linspace(1.5, 12.0, 5)
CURVE = 7.0 * TRAVEL * np.exp(0.04 * TRAVEL)


def _drawn(seed: int, n: int = 4, discrepancy: float = 0.02) -> Repeats:
    rng = np.random.default_rng(seed)
    empty = Repeats(TRAVEL, np.stack([CURVE, CURVE]), 0.02, 6.0, 0.02)
    scale = Scatter(*np.array([[0.01], [0.03], [0.004], [discrepancy]]))
    delta = rng.multivariate_normal(np.zeros(5), empty.discrepancy(scale)[0])
    own = rng.multivariate_normal(np.zeros(5), empty.between(scale)[0], n)
    return replace(empty, force=CURVE * np.exp(delta + own))


def test_the_likelihood_is_that_of_the_dense_normal_of_all_curves() -> None:
    data = _drawn(1)
    rng = np.random.default_rng(2)
    log_force = np.log(CURVE) + 0.01 * rng.standard_normal((3, 5))
    scatter = Scatter(*(0.01 + 0.02 * rng.random((4, 3))))
    found = data.log_likelihood(log_force, scatter)
    between, common = data.between(scatter), data.discrepancy(scatter)
    for i in range(3):
        dense = np.kron(np.ones((4, 4)), common[i]) + np.kron(np.eye(4), between[i])
        expected = multivariate_normal(np.tile(log_force[i], 4), dense).logpdf(
            np.log(data.force).ravel()
        )
        assert found[i] == pytest.approx(expected, rel=1e-9)


def test_a_further_repeat_is_predicted_as_the_dense_normal_conditions() -> None:
    data = _drawn(3)
    scatter = Scatter(*np.array([[0.012], [0.02], [0.005], [0.03]]))
    log_force = np.log(CURVE)[None] + 0.02
    new = np.log(CURVE) + 0.013
    found = log_density(data.predictive(log_force, scatter), new)[0]
    five = replace(data, force=np.vstack([data.force, np.exp(new)]))
    common = data.discrepancy(scatter)[0]
    # The noise of a force of given SD is relative to the mean curve; keep that of the four.
    between = data.between(scatter)[0]
    whole = np.kron(np.ones((5, 5)), common) + np.kron(np.eye(5), between)
    joint = multivariate_normal(np.tile(log_force[0], 5), whole).logpdf(np.log(five.force).ravel())
    four = data.log_likelihood(log_force, scatter)[0]
    assert found == pytest.approx(joint - four, rel=1e-8)


def test_a_stiffness_is_recovered_within_its_stated_error() -> None:
    bounds = np.log([[0.5, 2.0], [0.002, 0.1], [0.005, 0.3], [0.001, 0.05], [0.002, 0.1]])
    z = []
    for seed in range(6):
        data = _drawn(10 + seed)

        def likelihood(x: np.ndarray, data: Repeats = data) -> np.ndarray:
            return data.log_likelihood(np.log(CURVE) + x[:, :1], Scatter(*np.exp(x[:, 1:]).T))

        found = sample_box(
            likelihood, bounds, np.random.default_rng(seed), n_walkers=24, n_steps=300
        )
        z.append(found.draws[:, 0].mean() / found.draws[:, 0].std())
    assert np.abs(z).max() < 3.0 and np.sqrt(np.mean(np.square(z))) < 1.9


def test_the_evidence_of_a_normal_likelihood_is_that_of_the_closed_form() -> None:
    def likelihood(x: np.ndarray) -> np.ndarray:
        return -0.5 * np.square(x / 0.1).sum(axis=1)

    found = sample_box(
        likelihood, np.array([[-1.0, 1.0]] * 3), np.random.default_rng(5), n_steps=400
    )
    expected = 3 * np.log(np.sqrt(2 * np.pi) * 0.1 / 2.0)
    assert found.log_evidence_sd < 0.05
    assert abs(found.log_evidence - expected) < 4 * found.log_evidence_sd + 1e-3
    assert found.draws.std(axis=0) == pytest.approx([0.1] * 3, rel=0.06)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"force": np.ones((1, 5))}, "two repeats"),
        ({"force": np.ones((2, 4))}, "expected"),
        ({"force": -np.ones((2, 5))}, "positive"),
        ({"noise_sd": 0.0}, "noise_sd"),
    ],
)
def test_impossible_data_are_refused(changes: dict[str, object], says: str) -> None:
    good = {"travel": TRAVEL, "force": np.stack([CURVE, CURVE]), "noise_sd": 0.02, "length": 6.0}
    with pytest.raises(ValueError, match=says):
        Repeats(**{**good, **changes})  # type: ignore[arg-type]


def test_a_predictive_is_a_density() -> None:
    one = Predictive(np.zeros((1, 1)), np.array([[[0.25]]]))
    grid = np.linspace(-4, 4, 4001)
    density = np.exp([log_density(one, np.array([x]))[0] for x in grid])
    assert np.sum(density) * (grid[1] - grid[0]) == pytest.approx(1.0, abs=1e-6)
