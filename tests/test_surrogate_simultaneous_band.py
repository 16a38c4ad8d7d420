"""Fields drawn from a prediction lie in its simultaneous band as often as it says."""

from __future__ import annotations

import numpy as np

from surrogate import Emulator, TrainingSet, held_out_residuals
from surrogate.coverage import LEVELS, Coverage, coverage
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
    """As u_z of a body of revolution: rounding leaves them SDs of 1e-19 and errors of 1e-17 mm."""
    x = np.random.default_rng(10).uniform(0.0, 1.0, (40, 2))
    value = np.sin(x @ np.array([[3.0, 5.0, 2.0], [4.0, 1.0, 6.0]]) + np.array([0.0, 1.0, 2.0]))
    field = value[:, :, None, None] * np.array([[1.0, 0.3, 0.7], [0.2, 1.0, 0.0]])
    force = np.exp(value)

    def covered(field: np.ndarray) -> Coverage:
        train, unseen = (
            TrainingSet.from_runs(x[rows], force[rows], field[rows], np.ones(20, dtype=bool))
            for rows in (slice(0, 20), slice(20, 40))
        )
        found = held_out_residuals(Emulator.fit(train, 1), unseen).errors().field_coverage
        assert found is not None and found.joint is not None
        return found

    varying = covered(field[..., :2])
    for constant in (0.0, 0.3):
        beside = covered(np.where(np.arange(3) < 2, field, constant))
        np.testing.assert_allclose(beside.joint, varying.joint, atol=0.06)
        assert min(beside.overall) >= min(varying.overall)
