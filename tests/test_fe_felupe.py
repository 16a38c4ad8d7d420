"""The same mesh, element and law in FElupe, an independent code, give the same forces."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("felupe")

from benchmarks import felupe_patch, stuck_patch
from benchmarks.first_order_block import bricks
from benchmarks.stuck_patch import StuckPatch

TRAVEL = (0.1, 0.2, 0.3)


@pytest.mark.parametrize("dimple", [False, True])
@pytest.mark.parametrize(
    ("constants", "bulk"),
    [((0.004, 0.008, 0.003), 6.0), ((0.015, 0.0, 0.0), 0.15)],
)
def test_forces_on_distorted_elements_are_those_of_felupe(constants, bulk, dimple):
    """Q2 displacement, discontinuous P1 pressure in both; bulk/mu = 250 and 5.

    The bound is far below 0.1 %: the discrete problems are the same, so only the tolerances of
    the two Newton iterations and rounding may differ.
    """
    case = StuckPatch(
        (2, 2, 2, 3), TRAVEL, constants=constants, bulk=bulk, dimple=dimple, distortion=0.2
    )
    ours, theirs = stuck_patch.press(case), felupe_patch.press(case)
    assert ours.n_unknowns == theirs.n_unknowns
    np.testing.assert_allclose(ours.force, theirs.force, rtol=1e-6)


def test_the_comparison_would_see_another_law():
    """A change of 1 % of one constant shows: the agreement above is not by insensitivity."""
    case = StuckPatch((2, 2, 2, 3), TRAVEL[:1], constants=(0.004, 0.008, 0.003))
    other = StuckPatch((2, 2, 2, 3), TRAVEL[:1], constants=(0.004, 0.00808, 0.003))
    difference = stuck_patch.press(case).error_percent(felupe_patch.press(other).force)
    assert difference > 0.3


def test_first_order_elements_of_the_benchmark_are_those_of_felupe():
    """The thesis' kind of element: trilinear displacement, one pressure."""
    case = StuckPatch((2, 2, 2, 3), TRAVEL, constants=(0.015, 0.0, 0.0), distortion=0.2)
    ours = stuck_patch.press(case, bricks, "softcal Q1/P0")
    theirs = felupe_patch.press(case, "Q1/P0")
    assert ours.n_unknowns == theirs.n_unknowns
    np.testing.assert_allclose(ours.force, theirs.force, rtol=1e-6)


def test_first_order_elements_of_felupe_come_down_to_ours_as_the_mesh_is_refined():
    """Trilinear displacement with one pressure: another element, the same limit."""
    gaps = []
    for n in (2, 4):
        case = StuckPatch((n, n, n, n), TRAVEL[:2], constants=(0.015, 0.0, 0.0), dimple=True)
        theirs = felupe_patch.press(case, "Q1/P0").force
        gaps.append(theirs[-1] / stuck_patch.press(case).force[-1] - 1.0)
    assert gaps[0] > gaps[1] > 0.0
    assert gaps[1] < 0.6 * gaps[0]
