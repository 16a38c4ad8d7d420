"""Choices made on a part of the runs see all that varies in them."""

from __future__ import annotations

import numpy as np
import pytest

from surrogate import Emulator, Factor, Levels, TrainingSet, design
from surrogate.coordinates import thinned
from surrogate.thinning import part_of_runs

FACTORS = (Factor("r", 0.0, 1.0), Factor("s", 0.0, 0.5), Levels("pin", ("bar", "round")))


@pytest.mark.parametrize(("n", "n_rows", "n_left"), [(5, 15, 5), (200, 200, 200), (201, 201, 101)])
def test_as_many_runs_are_left_as_there_are_rows_to_spare(n: int, n_rows: int, n_left: int) -> None:
    x = np.arange(2.0 * n).reshape(n, 2)
    part = part_of_runs(x, n_rows, 200)
    assert len(part) == n_left and (np.diff(part) > 0).all()
    assert part[0] >= 0 and part[-1] < n
    np.testing.assert_array_equal(part, part_of_runs(x, n_rows, 200))


def test_usable_derivatives_are_rows() -> None:
    slopes, x = np.ones((100, 1, 3)), np.random.default_rng(0).random((100, 3))
    slopes[:, :, 2] = np.nan
    assert len(thinned(x, None)) == 100 and len(thinned(x, slopes)) == 50


@pytest.mark.parametrize("period", range(2, 13))
def test_all_levels_that_take_turns_are_left(period: int) -> None:
    for n in range(201, 2000, 199):
        counts = np.bincount(
            part_of_runs(np.arange(float(n))[:, None], n, 200) % period, minlength=period
        )
        assert counts.min() > 0


@pytest.mark.parametrize("place", range(0, 260, 20))
def test_an_input_that_one_run_varies_is_not_left_out(place: int) -> None:
    x = np.column_stack([np.random.default_rng(1).random((260, 2)), np.zeros(260)])
    x[place, 2] = 1.0
    part = part_of_runs(x, 260, 200)
    assert place in part and len(part) in (130, 131) and (np.diff(part) > 0).all()


@pytest.mark.lasting
def test_runs_whose_levels_take_turns_make_an_emulator() -> None:
    """100 runs with two derivatives each: every other one is of the same pin."""
    x = design(FACTORS, 100, 1).theta(FACTORS)
    travel = np.array([0.6, 1.0])
    force = travel * np.exp(0.4 * x[:, :1] + 0.2 * x[:, 1:2] - 0.3 * x[:, 2:])
    gradient = force[..., None] * [0.4, 0.2, np.nan]
    emulator = Emulator.fit(TrainingSet(x, force, None, force_gradient=gradient), 1, n_restarts=0)
    found, _ = emulator.unit_force(np.array([[0.3, 0.2, 0.0], [0.3, 0.2, 1.0]]))
    expected = travel * np.exp(0.16 - 0.3 * np.array([[0.0], [1.0]]))
    np.testing.assert_allclose(found, expected, rtol=1e-4)
