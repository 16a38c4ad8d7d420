"""The autocorrelation time is that of processes for which it is known."""

from __future__ import annotations

import numpy as np
import pytest

from calib.inference.autocorrelation import integrated_time
from fe.response import Array


def autoregressive(coefficient: float, n: int, walkers: int) -> Array:
    noise = np.random.default_rng(0).standard_normal((n, walkers))
    values = noise.copy()
    for step in range(1, n):
        values[step] = coefficient * values[step - 1] + np.sqrt(1 - coefficient**2) * noise[step]
    return values


@pytest.mark.parametrize("coefficient", [0.0, 0.5, 0.9])
def test_time_of_an_autoregressive_process(coefficient: float) -> None:
    """(1 + a) / (1 - a); 16 walkers of 5000 draws give it within 10 % (4 SD or more)."""
    exact = (1 + coefficient) / (1 - coefficient)
    found = integrated_time(autoregressive(coefficient, 5000, 16))
    assert found == pytest.approx(exact, rel=0.1)


def test_walkers_that_stay_apart_have_a_long_memory() -> None:
    values = autoregressive(0.0, 400, 8) + 2.0 * np.arange(8)
    assert integrated_time(values) > 100


def test_one_constant_walker_does_no_harm_and_a_constant_ensemble_is_never_done() -> None:
    values = autoregressive(0.0, 400, 8)
    values[:, 0] = values.mean()
    assert integrated_time(values) == pytest.approx(1.0, abs=0.3)
    assert integrated_time(np.ones((400, 8))) == np.inf
