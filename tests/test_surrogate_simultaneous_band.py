"""Fields drawn from a prediction lie in its simultaneous band as often as it says."""

from __future__ import annotations

import numpy as np

from surrogate.coverage import LEVELS, coverage
from surrogate.simultaneous_band import Spread, rank_of_largest

N, N_OBS, K, Q = 2000, 60, 4, 3


def _case(seed: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    modes, factor = rng.standard_normal((N_OBS, K)), 0.3 * rng.standard_normal((N_OBS, Q))
    variance = rng.uniform(0.1, 2.0, (N, K))
    std = np.sqrt(variance @ (modes**2).T + np.sum(factor**2, axis=1))
    error = (np.sqrt(variance) * rng.standard_normal((N, K))) @ modes.T
    error += rng.standard_normal((N, Q)) @ factor.T
    return error, std, modes, variance, factor


def test_the_band_holds_the_share_of_fields_that_it_says() -> None:
    """Standard errors of 2000 fields and 400 draws: 0.027, 0.022, 0.012; four of them: 1e-4."""
    error, std, modes, variance, factor = _case(7)
    rank = rank_of_largest(error, std, Spread(modes, variance, factor))
    found = coverage((error / std)[:, None], rank=rank).joint
    assert found is not None
    assert (np.abs(np.array(found) - LEVELS) < 4.0 * np.array([0.027, 0.022, 0.012])).all()


def test_twice_the_errors_leave_the_band() -> None:
    error, std, modes, variance, factor = _case(8)
    rank = rank_of_largest(2.0 * error, std, Spread(modes, variance, factor))
    assert np.mean(rank <= 0.95) < 0.7


def test_values_that_are_the_same_in_all_runs_count_nothing() -> None:
    error, std, modes, variance, factor = _case(10)
    error[:, 5], std[:, 5], modes[5], factor[5] = 0.0, 0.0, 0.0, 0.0
    with np.errstate(all="raise"):
        rank = rank_of_largest(error, std, Spread(modes, variance, factor))
    assert np.isfinite(rank).all() and 0.3 < np.mean(rank <= 0.5) < 0.7
