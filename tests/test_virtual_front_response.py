"""The stored front face gives what the FE model gives, at any point and travel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from virtual_blocks import TRAVEL, analytic_truth, field_of, front, shifted_truth

from calib.virtual import BlockTruth, solve_truth
from calib.virtual.front_response import load_front, save_front
from calib.virtual.truth import continued, pin_at_centre, pin_shifted
from fe import BlockPin, Contact

COARSE = BlockTruth(
    contact=Contact("stick", "stick"),
    cells=(4, 3, 1),
    shift_cells=None,
    travel=(0.1, 0.2),
    smooth=False,
)
POINTS = np.random.default_rng(3).random((40, 2)) * [10.0, 2.5] - [5.0, 0.0]


def test_field_is_that_of_the_model_at_its_own_points() -> None:
    """The model has shape functions of its own 3-D elements; lines of nodes are rounded to 1e-9."""
    response = COARSE.model()(COARSE.ratios)
    found = solve_truth(COARSE)
    field = found.field_at(response.points, np.array(COARSE.travel))
    assert field == pytest.approx(response.displacement, abs=1e-8)
    assert found.force_at(response.travel) == pytest.approx(COARSE.kappa * response.force)


def test_a_mirrored_point_moves_the_other_way_along_x() -> None:
    mirror = np.array([-1.0, 1.0])
    here, there = (analytic_truth().field_at(POINTS * m, np.array([0.7])) for m in (1.0, mirror))
    assert there == pytest.approx(here * [-1.0, 1.0, 1.0], abs=1e-12)


def test_field_between_nodes_and_travels_is_that_of_the_function_it_was_made_of() -> None:
    """Quadratic elements 0.31 mm wide: error below 2e-4 mm of fields up to 0.8 mm."""
    found = analytic_truth().field_at(POINTS, np.array([0.0, 0.55, 1.73]))
    expected = np.stack([field_of(*POINTS.T, travel) for travel in (0.0, 0.55, 1.73)])
    assert found == pytest.approx(expected, abs=5e-4)
    assert np.all(found[0] == 0.0)


def test_travels_beyond_what_was_computed_are_refused() -> None:
    with pytest.raises(ValueError, match=r"at most 1\.9 mm"):
        analytic_truth().force_at(np.array([2.0]))


def test_the_pin_goes_where_it_is_shifted_to_and_the_sides_stay() -> None:
    x = np.linspace(-5.0, 5.0, 101)
    centred = pin_at_centre(x, 0.3, 5.0)
    assert pin_shifted(centred, 0.3, 5.0) == pytest.approx(x)
    near = np.abs(x - 0.3) < 2.4
    assert centred[near] == pytest.approx(x[near] - 0.3)
    assert centred[[0, -1]] == pytest.approx([-5.0, 5.0])


@pytest.mark.parametrize("shift", [-0.4, 0.4])
def test_at_the_solved_shift_the_field_is_that_of_the_shifted_model(shift: float) -> None:
    found = shifted_truth().field_at(POINTS, np.array([1.0]), shift)[0]
    assert found == pytest.approx(field_of(*POINTS.T, 1.0, shift), abs=2e-3)


def test_beyond_the_fine_model_the_coarse_one_adds_its_changes() -> None:
    whole, half = front(), front()
    cut = replace(
        half, travel=TRAVEL[:10], force=half.force[:10], displacement=half.displacement[:10]
    )
    found = continued(cut, whole)
    assert found.travel == pytest.approx(TRAVEL)
    assert found.force == pytest.approx(whole.force)
    assert found.displacement == pytest.approx(whole.displacement, abs=1e-12)
    assert continued(whole, cut) is whole


def test_a_shifted_block_of_the_fe_model_is_met_where_it_was_solved() -> None:
    """Fine and coarse model alike: the truth at that shift is the half model's own field."""
    truth = BlockTruth(
        specimen=BlockPin(),
        contact=Contact("stick", "stick"),
        cells=(4, 2, 1),
        shift_cells=(4, 2, 1),
        travel=(0.1, 0.2),
        smooth=False,
    )
    found = solve_truth(truth)
    half = truth.shift_models()[1]
    expected = half(truth.ratios)
    field = found.field_at(expected.points, np.array(truth.travel), 0.4)
    assert np.abs(field - expected.displacement).max() < 2e-3
    assert np.abs(expected.displacement).max() > 0.05


def test_a_stored_response_is_read_back_and_another_file_refused(tmp_path) -> None:
    path = tmp_path / "front.npz"
    save_front(path, front())
    assert np.array_equal(load_front(path).displacement, front().displacement)
    path.write_bytes(b"no")
    with pytest.raises(ValueError, match="not a stored front-face response"):
        load_front(path)


def test_equal_truths_are_solved_once(tmp_path) -> None:
    first = solve_truth(COARSE, tmp_path)
    stored = list(tmp_path.glob("*.npz"))
    written = [path.stat().st_mtime_ns for path in stored]
    again = solve_truth(COARSE, tmp_path)
    assert [path.stat().st_mtime_ns for path in tmp_path.glob("*.npz")] == written
    assert np.array_equal(first.fine.force, again.fine.force)
