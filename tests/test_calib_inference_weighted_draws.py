"""Weighted draws say what the quadrature says, and tell how good they are."""

from __future__ import annotations

import numpy as np
import pytest
from test_calib_inference_sampling import POSTERIOR, PRIOR, TwoModes, integrated

from calib.inference.weighted_draws import draw_weighted
from fe.response import Array


def test_moments_and_evidence_are_those_of_the_quadrature() -> None:
    """Four z scores below 4: false alarm below 3e-4 (fixed seed)."""
    exact = integrated()
    draws = draw_weighted(POSTERIOR, np.random.default_rng(2), 16384)
    assert draws.ess > 3000
    z = (draws.mean - exact.mean) / exact.sd * np.sqrt(draws.ess)
    assert np.abs(z).max() < 4
    assert draws.sd == pytest.approx(exact.sd, rel=0.06)
    relative = np.sqrt(len(draws.x) / draws.ess - 1.0) / np.sqrt(len(draws.x))
    assert abs(draws.log_evidence - exact.log_evidence) < 4 * relative


def test_probabilities_below_are_those_of_the_quadrature() -> None:
    exact = integrated()
    draws = draw_weighted(POSTERIOR, np.random.default_rng(3), 16384)
    value = exact.mean + 0.5 * exact.sd
    expected = exact.expect(exact.x < value)
    # Single probabilities of the quadrature are good to the weight of a node, some 0.02.
    assert draws.below(value) == pytest.approx(expected, abs=0.05)


def test_same_seed_gives_the_same_bits() -> None:
    first, second = (draw_weighted(POSTERIOR, np.random.default_rng(1), 512) for _ in range(2))
    assert np.array_equal(first.weights, second.weights)


def test_the_mode_with_the_weight_is_found() -> None:
    draws = draw_weighted(TwoModes(), np.random.default_rng(1))  # type: ignore[arg-type]
    low, high = PRIOR.bounds.T
    assert draws.mean == pytest.approx(low + 0.2 * (high - low), abs=0.01)


def test_a_posterior_that_is_zero_is_refused() -> None:
    class Zero:
        prior = PRIOR

        def log_prob(self, x: Array) -> Array:
            return np.full(len(x), -np.inf)

    with pytest.raises(ValueError, match="posterior: zero"):
        draw_weighted(Zero(), np.random.default_rng(1))  # type: ignore[arg-type]
