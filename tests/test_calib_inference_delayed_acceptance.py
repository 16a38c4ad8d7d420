"""Delayed acceptance leaves the direct posterior invariant, whatever the emulator says."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.stats import kstest, norm

from calib.inference.delayed_acceptance import DelayedChain, Densities, begin, extend
from fe.response import Array

FALSE_ALARM = 1e-3
"""of each test below, all its comparisons together"""
ROOT = np.linalg.cholesky(np.array([[1.0, 0.6], [0.6, 0.8]]))
"""of the covariance of the exact posterior, N(0, .)"""


def normal(x: Array, centre: Array, root: Array) -> Array:
    white = np.linalg.solve(root, (x - centre).T)
    return -0.5 * np.square(white).sum(axis=0)


EXACT = partial(normal, centre=np.zeros(2), root=ROOT)
# 0.7 SD off and 1.5 times as wide along one axis: an emulator that nobody would keep.
WRONG = partial(normal, centre=np.array([0.7, -0.5]), root=ROOT * np.array([1.5, 0.8]))
BOTH = Densities(EXACT, WRONG)
N_CHAINS, N_STEPS = 500, 4


def ends(densities: Densities, n_inner: int) -> Array:
    """(n, 2) last states of many chains that begin with exact draws, white under the exact one."""
    starts = np.random.default_rng(5).standard_normal((N_CHAINS, 2)) @ ROOT.T
    last = [
        extend(
            begin(densities, start), densities, ROOT @ ROOT.T, N_STEPS, seed=k, n_inner=n_inner
        ).x[-1]
        for k, start in enumerate(starts)
    ]
    white: Array = np.linalg.solve(ROOT, np.array(last).T).T
    return white


@pytest.mark.parametrize("n_inner", [1, 3])
def test_exact_draws_stay_exact_under_a_biased_emulator(n_inner: int) -> None:
    white = ends(BOTH, n_inner)
    p = [kstest(column, norm.cdf).pvalue for column in (*white.T, white.sum(axis=1) / 2**0.5)]
    assert min(p) > FALSE_ALARM / len(p)


def test_the_same_test_sees_that_the_emulator_alone_is_wrong() -> None:
    white = ends(Densities(WRONG, WRONG), 3)
    assert min(kstest(column, norm.cdf).pvalue for column in white.T) < 1e-9


def test_a_long_chain_has_the_exact_moments() -> None:
    chain = extend(begin(BOTH, np.zeros(2)), BOTH, ROOT @ ROOT.T, 1500, seed=3, n_inner=5)
    white = np.linalg.solve(ROOT, chain.x[200:].T).T
    # Means of 26 batches of 50 steps: their spread is the error, correlation and all.
    for values, known in ((white, 0.0), (white**2, 1.0)):
        batches = values[: 26 * 50].reshape(26, 50, 2).mean(axis=1)
        error = batches.std(axis=0, ddof=1) / np.sqrt(26)
        # 4.5 SD of a t of 25 degrees: false alarm 1.4e-4 for each of four
        assert (np.abs(batches.mean(axis=0) - known) < 4.5 * error).all()
    assert 0.2 < chain.second_rate < 0.95 and 0.2 < chain.first_rate < 0.8


def test_a_right_emulator_costs_no_acceptance() -> None:
    right = Densities(EXACT, EXACT)
    chain = extend(begin(right, np.zeros(2)), right, ROOT @ ROOT.T, 60, seed=1, n_inner=2)
    assert chain.second_rate == 1.0
    assert chain.moved.sum() > 20


def test_a_chain_that_was_stopped_ends_as_one_that_was_not() -> None:
    kept: list[DelayedChain] = []
    whole = extend(
        begin(BOTH, np.zeros(2)), BOTH, np.eye(2), 30, seed=7, n_inner=2, on_step=kept.append
    )
    assert [chain.n_steps for chain in kept] == list(range(1, 31))
    again = extend(kept[11], BOTH, np.eye(2), 30, seed=7, n_inner=2)
    for name in ("x", "direct", "emulator", "moved", "accepted", "inner"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name))


def test_what_the_emulator_rejects_is_not_solved() -> None:
    asked = []

    def direct(x: Array) -> Array:
        asked.append(x[0])
        return EXACT(x)

    counted = Densities(direct, WRONG)
    chain = extend(begin(counted, np.zeros(2)), counted, np.eye(2), 40, seed=2)
    assert len(asked) == 1 + chain.moved.sum() < 41


def test_a_solve_that_fails_is_a_rejection() -> None:
    failing = Densities(lambda x: np.where(x[:, 0] > 0.1, np.nan, EXACT(x)), WRONG)
    chain = extend(begin(failing, np.zeros(2)), failing, np.eye(2), 50, seed=2, n_inner=2)
    assert (chain.x[:, 0] <= 0.1).all() and np.isfinite(chain.direct).all()


def test_a_start_outside_the_posterior_is_refused() -> None:
    nowhere = Densities(lambda x: np.full(len(x), -np.inf), EXACT)
    with pytest.raises(ValueError, match="direct posterior is zero"):
        begin(nowhere, np.zeros(2))
    with pytest.raises(ValueError, match="n_inner: expected at least 1"):
        extend(begin(BOTH, np.zeros(2)), BOTH, np.eye(2), 1, seed=1, n_inner=0)
