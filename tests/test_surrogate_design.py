"""Designs: corners first, nested, inside the box, and even."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc

from surrogate.design import sobol_design

BOX = np.array([[0.0, 1.0], [-0.2, 0.5]])


def test_the_corners_of_the_box_come_first_each_once() -> None:
    corners = sobol_design(20, BOX, seed=3)[:4]
    assert {tuple(p) for p in corners} == {(0.0, -0.2), (0.0, 0.5), (1.0, -0.2), (1.0, 0.5)}


@pytest.mark.parametrize("n", [1, 3, 4, 5, 12, 20, 63])
def test_a_smaller_design_is_the_beginning_of_a_larger_one(n: int) -> None:
    larger = sobol_design(64, BOX, seed=3)
    assert sobol_design(n, BOX, seed=3).tobytes() == larger[:n].tobytes()


def test_points_are_inside_the_box_and_all_different() -> None:
    points = sobol_design(200, BOX, seed=0)
    assert (points >= BOX[:, 0]).all() and (points <= BOX[:, 1]).all()
    assert len(np.unique(points, axis=0)) == 200


def test_the_same_seed_gives_the_same_design_and_another_seed_another() -> None:
    a = sobol_design(10, BOX, seed=1)
    assert a.tobytes() == sobol_design(10, BOX, seed=1).tobytes()
    assert not np.array_equal(a[4:], sobol_design(10, BOX, seed=2)[4:])


def test_points_after_the_corners_are_more_even_than_random_ones() -> None:
    """Discrepancy of 64 points, 20 seeds each: at most 0.0002 against at least 0.0020."""
    unit = np.array([[0.0, 1.0], [0.0, 1.0]])
    sobol = [qmc.discrepancy(sobol_design(68, unit, seed)[4:]) for seed in range(20)]
    random = [qmc.discrepancy(np.random.default_rng(s).random((64, 2))) for s in range(20)]
    assert max(sobol) < min(random)


def test_three_dimensions_have_eight_corners() -> None:
    points = sobol_design(9, np.array([[0.0, 1.0]] * 3), seed=0)
    assert len({tuple(p) for p in points[:8]}) == 8
    assert set(points[:8].ravel()) == {0.0, 1.0}
    assert ((points[8] > 0.0) & (points[8] < 1.0)).all()


@pytest.mark.parametrize(
    ("n", "bounds", "message"),
    [
        (0, BOX, "n: must be a whole number of at least 1, got 0"),
        (2.5, BOX, "n: must be a whole number of at least 1, got 2.5"),
        (3.0, BOX, "n: must be a whole number of at least 1, got 3.0"),
        (True, BOX, "n: must be a whole number of at least 1, got True"),
        (5, np.zeros(2), r"bounds: must be \(d, 2\)"),
        (5, np.array([[1.0, 0.0]]), "bounds: must be finite with low < high"),
        (5, np.array([[0.0, np.inf]]), "bounds: must be finite with low < high"),
    ],
)
def test_a_box_that_is_none_is_refused(n: int, bounds: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        sobol_design(n, bounds, seed=0)


def test_numbers_of_points_may_be_numpys() -> None:
    box = np.array([[0.0, 1.0]])
    assert np.array_equal(sobol_design(np.int64(5), box, 0), sobol_design(5, box, 0))  # type: ignore[arg-type]
