"""Fields drawn from a prediction lie in its simultaneous band as often as it says."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from surrogate import Emulator, TrainingSet, held_out_residuals
from surrogate.coverage import LEVELS, Coverage, coverage
from surrogate.field_prediction import FieldPrediction
from surrogate.run_scale import RunScale
from surrogate.simultaneous_band import Spread, field_band, largest_of_drawn, standardised

pytestmark = pytest.mark.lasting

NORMAL, WIDE = RunScale(), RunScale(0.1, 0.6)

N, N_OBS, K, Q = 2000, 60, 4, 3


class Case(NamedTuple):
    error: np.ndarray
    std: np.ndarray
    spread: Spread


def _case(seed: int, scale: RunScale = NORMAL) -> Case:
    """Errors of N fields, those of each times a factor of its own, and what is stated of them."""
    rng = np.random.default_rng(seed)
    modes, factor = rng.standard_normal((N_OBS, K)), 0.3 * rng.standard_normal((N_OBS, Q))
    variance = rng.uniform(0.1, 2.0, (N, K))
    std = np.sqrt(variance @ (modes**2).T + np.sum(factor**2, axis=1))
    error = (np.sqrt(variance) * rng.standard_normal((N, K))) @ modes.T
    error += rng.standard_normal((N, Q)) @ factor.T
    error *= np.exp(scale.log_mean + scale.log_std * rng.standard_normal((N, 1)))
    return Case(error, std, Spread(modes, variance, factor))


def _prediction(
    modes: np.ndarray, variance: np.ndarray, factor: np.ndarray, rest: np.ndarray
) -> FieldPrediction:
    shape = (2, N_OBS // 6, 3)
    return FieldPrediction(shape, np.zeros((N, *shape)), modes, variance, factor, rest)


def _rank(case: Case, scale: RunScale = NORMAL) -> np.ndarray:
    size = np.abs(standardised(case.error, case.std)).max(axis=1)
    return scale.rank(size, largest_of_drawn(case.std, case.spread))


@pytest.mark.parametrize("scale", [NORMAL, WIDE], ids=["normal", "wide"])
def test_the_band_holds_the_share_of_fields_that_it_says(scale: RunScale) -> None:
    """Standard errors of 2000 fields and 400 draws: 0.027, 0.022, 0.012; four of them: 1e-4."""
    case = _case(7, scale)
    ranks = _rank(case, scale), _rank(case)
    found = coverage((case.error / case.std)[:, None], ranks).joint
    assert found is not None
    assert (np.abs(np.array(found) - LEVELS) < 4.0 * np.array([0.027, 0.022, 0.012])).all()


def test_errors_that_are_larger_than_stated_leave_the_band() -> None:
    case = _case(8)
    assert np.mean(_rank(case._replace(error=2.0 * case.error)) <= 0.95) < 0.7
    assert np.mean(_rank(_case(9, WIDE)) <= 0.95) < 0.85


@pytest.mark.parametrize("level", [0.5, 0.95])
def test_the_half_width_is_that_of_the_level(level: float) -> None:
    """Of 2000 fields; the standard error of a share is at most 0.027."""
    error, std, (modes, variance, factor) = case = _case(11, WIDE)
    prediction = _prediction(modes, variance, factor, np.zeros(N_OBS))
    np.testing.assert_allclose(prediction.std.reshape(N, -1), std)
    wide = field_band(prediction, level, WIDE)
    inside = (np.abs(error) <= wide.reshape(N, -1)).all(axis=1)
    assert abs(inside.mean() - level) < 4.0 * 0.027
    assert np.mean(inside == (_rank(case, WIDE) <= level)) > 0.99
    assert (field_band(prediction, level) < wide).all()


def test_the_band_knows_of_independent_errors() -> None:
    """Standard error of the share of 2000 fields by 400 draws: 0.012; four of them."""
    error, _, (modes, variance, factor) = _case(12)
    rest = np.full(N_OBS, 2.0)
    error = error + np.sqrt(rest) * np.random.default_rng(13).standard_normal(error.shape)
    half = field_band(_prediction(modes, variance, factor, rest), 0.95).reshape(N, -1)
    assert abs(np.mean((np.abs(error) <= half).all(axis=1)) - 0.95) < 4.0 * 0.012


def test_a_level_that_is_no_probability_is_refused() -> None:
    _, _, (modes, variance, factor) = _case(14)
    prediction = _prediction(modes, variance, factor, np.zeros(N_OBS))
    with pytest.raises(ValueError, match="between 0 and 1, found 95"):
        field_band(prediction, 95.0)


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
