"""Splines through the nodes of a front face: what they keep, and what they take away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib.virtual import BlockTruth, solve_truth, truth
from calib.virtual.front_response import FrontResponse
from calib.virtual.smooth_front import FINEST, smoothed

CORNERS = np.array([0.0, 0.4, 0.7, 0.9, 1.2, 1.7, 2.3, 3.1, 4.0, 5.0])
TRAVEL = np.array([0.5, 1.0])
Y = np.linspace(0.0, 2.5, 13)


def lines(corners: np.ndarray) -> np.ndarray:
    """Lines of nodes: corners of elements and their middles."""
    middles = 0.5 * (corners[1:] + corners[:-1])
    return np.sort(np.concatenate([corners, middles]))


def cubic(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(..., 3) displacement odd in x along x and even in it along y and z, mm."""
    odd, even = 0.2 * x - 0.01 * x**3, 1.0 - 0.03 * x**2
    return np.stack([odd * y**2, even * (y - 0.1 * y**3), 0.5 * even * y], axis=-1)


def front(x: np.ndarray) -> FrontResponse:
    field = cubic(x[:, None], Y)
    return FrontResponse(x, Y, TRAVEL, 3.0 * TRAVEL, np.stack([field, 2.0 * field]))


def slopes(response: FrontResponse, x: np.ndarray) -> np.ndarray:
    """D u_x / dx at x and y = 1.3 in the last step, by differences over a micrometre."""
    at = [np.column_stack([x + d, np.full(x.size, 1.3)]) for d in (-5e-4, 5e-4)]
    before, after = (response.field_at(points, TRAVEL[-1:])[0, :, 0] for points in at)
    return (after - before) / 1e-3


@pytest.mark.parametrize("x", [lines(CORNERS), lines(np.union1d(-CORNERS, CORNERS))])
def test_cubic_fields_of_quarters_and_halves_are_kept(x) -> None:
    found = smoothed(front(x))
    assert found.displacement[0] == pytest.approx(cubic(found.x[:, None], found.y), abs=1e-12)
    assert np.array_equal(found.force, 3.0 * TRAVEL) and np.array_equal(found.travel, TRAVEL)
    assert np.diff(found.x[::2]).max() <= FINEST + 1e-12
    assert set(np.round(x[::2], 9)) <= set(np.round(found.x[::2], 9)), "edges stay edges"


def test_the_plane_of_symmetry_stays_one() -> None:
    whole, quarter = front(lines(np.union1d(-CORNERS, CORNERS))), front(lines(CORNERS))
    noise = 0.01 * np.random.default_rng(3).standard_normal(quarter.displacement.shape)
    noise[:, 0, :, 0] = 0.0
    rough = replace(quarter, displacement=quarter.displacement + noise)
    mirrored = np.concatenate([noise[:, :0:-1] * [-1.0, 1.0, 1.0], noise], axis=1)
    both = smoothed(replace(whole, displacement=whole.displacement + mirrored))
    found = smoothed(rough)
    assert np.all(found.displacement[:, 0, :, 0] == 0.0)
    half = both.displacement[:, both.x.size // 2 :]
    assert found.displacement == pytest.approx(half, abs=1e-12)


def test_the_sawtooth_of_elements_is_gone_and_what_it_is_about_is_left() -> None:
    """Middles of elements off by 4 micrometres: slopes jump by 0.1, and by next to nothing then."""
    x = lines(np.linspace(0.0, 5.0, 21))
    plain = front(x)
    off = np.zeros(plain.displacement.shape)
    off[:, 1::2, :, 0] = 0.004
    rough = replace(plain, displacement=plain.displacement + off)
    edges = x[2:-4:2]

    def jumps(response: FrontResponse) -> np.ndarray:
        return slopes(response, edges + 2e-3) - slopes(response, edges - 2e-3)

    assert np.abs(jumps(rough)).min() > 0.1
    found = smoothed(rough)
    beyond_curvature = jumps(found) - jumps(plain)
    assert np.abs(beyond_curvature).max() < 0.01 * np.abs(jumps(rough)).min()
    inner = np.column_stack([np.linspace(1.0, 4.0, 50), np.full(50, 1.3)])
    left = found.field_at(inner, TRAVEL) - smoothed(plain).field_at(inner, TRAVEL)
    assert left[..., 0] == pytest.approx(0.002, abs=5e-4), "half of it: their mean"
    assert np.abs(left[..., 1:]).max() < 1e-9


def test_truths_are_smooth_where_asked_and_solved_again_by_another_code(
    tmp_path, monkeypatch
) -> None:
    solved = []

    def solve(*_: object) -> FrontResponse:
        solved.append(1)
        return front(lines(CORNERS))

    monkeypatch.setattr(truth, "solve_front", solve)
    block = BlockTruth(shift_cells=None)
    smooth, again = (solve_truth(block, tmp_path).fine for _ in range(2))
    assert len(solved) == 1 and np.array_equal(smooth.displacement, again.displacement)
    assert np.array_equal(smooth.x, smoothed(front(lines(CORNERS))).x)
    rough = solve_truth(replace(block, smooth=False), tmp_path).fine
    assert len(solved) == 1 and np.array_equal(rough.x, lines(CORNERS))
    monkeypatch.setattr(truth, "code_hash", lambda _: "another")
    solve_truth(block, tmp_path)
    assert len(solved) == 2
