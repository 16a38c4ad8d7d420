"""Forces of CalculiX (C3D20R) on the same case; skipped, visibly, where ccx is not installed."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import calculix_patch, stuck_patch
from benchmarks.stuck_patch import StuckPatch

pytestmark = pytest.mark.skipif(
    not calculix_patch.available(),
    reason="ccx is not installed (apt-get install calculix-ccx): no comparison with CalculiX",
)

LAW = (0.004, 0.008, 0.003)
MU = 2.0 * (LAW[0] + LAW[1])
TRAVEL = (0.2, 0.4)


def difference_percent(case: StuckPatch) -> float:
    return calculix_patch.press(case).error_percent(stuck_patch.press(case).force)


class Confined(StuckPatch):
    """Nothing moves sideways, so the deformation is homogeneous: no element can differ."""

    def fixed(self, positions):
        fixed, _ = super().fixed(positions)
        fixed[:, [0, 2]] = True
        pressed = positions[:, 1] > self.height - 1e-9
        fixed[pressed] = True
        return fixed, pressed


@pytest.mark.parametrize("constants", [LAW, (0.004, 0.008, 0.0), (0.012, 0.0, 0.0)])
def test_the_law_with_its_cross_term_is_that_of_calculix(constants):
    """To the seven digits that ccx prints."""
    case = Confined((1, 1, 2, 2), TRAVEL, constants=constants, bulk=10 * MU)
    ours, theirs = stuck_patch.press(case).force, calculix_patch.press(case).force
    np.testing.assert_allclose(theirs, ours, rtol=1e-6)


@pytest.mark.lasting
@pytest.mark.parametrize(("bulk_ratio", "bound"), [(2.0, 0.2), (10.0, 1.2)])
def test_forces_in_a_dimple_agree_better_as_the_mesh_is_refined(bulk_ratio, bound):
    """Measured on 4 x 4 x 8 (x, y, z 8 x 4 x 8): 0.14 % at bulk/mu = 2, 1.1 % at 10.

    Serendipity bricks stiffen as the bulk modulus grows; softcal's own force moves by less than
    0.2 % between these meshes, so the gap is mostly theirs to close.
    """
    kwargs = {"constants": LAW, "bulk": bulk_ratio * MU, "dimple": True, "footprint": 2.5}
    coarse, fine = (
        difference_percent(StuckPatch((n, n, n, 2 * n), TRAVEL, **kwargs)) for n in (2, 4)
    )
    assert fine < bound
    assert fine < 0.6 * coarse


@pytest.mark.lasting
def test_forces_under_a_sharp_footprint_approach_each_other():
    """The footprint's edge is singular: both codes converge slowly, CalculiX from above."""
    kwargs = {"constants": LAW, "bulk": 10 * MU}
    gaps = []
    for n in (2, 4):
        case = StuckPatch((n, n, n, 2 * n), TRAVEL, **kwargs)
        gaps.append(calculix_patch.press(case).force / stuck_patch.press(case).force - 1.0)
    assert (gaps[1] > 0.0).all()
    assert (gaps[1] < 0.7 * gaps[0]).all()
    assert (gaps[1] < 0.03).all()


def test_a_failure_of_calculix_is_reported_with_what_it_printed(monkeypatch):
    case = StuckPatch((1, 1, 1, 1), TRAVEL, constants=LAW, bulk=10 * MU)
    whole = calculix_patch.deck(case)
    monkeypatch.setattr(
        calculix_patch, "deck", lambda _: whole.replace("MATERIAL=SILICONE", "MATERIAL=NONE")
    )
    with pytest.raises(RuntimeError, match=r"(?s)ccx did not solve all 2 increments:\n.*ERROR"):
        calculix_patch.press(case)
