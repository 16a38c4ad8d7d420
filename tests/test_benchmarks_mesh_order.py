"""Three meshes tell the order of what their fields err by."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.mesh_order import falling
from calib.study.block_cells import refinement

MESHES = ((12, 3, 3), (16, 8, 4), (19, 9, 5))


@pytest.mark.parametrize("order", [1, 2])
def test_errors_of_a_known_order_have_the_ratio_of_that_order(order: int) -> None:
    rng = np.random.default_rng(order)
    exact, shape = rng.standard_normal((2, 3, 5, 40, 3))
    sizes = [1.0 / refinement(cells, MESHES[0]) for cells in MESHES]
    coarse, fine, finest = (exact + 0.01 * size**order * shape for size in sizes)
    found = falling((coarse, fine, finest), MESHES)
    assert found["ratio"] == pytest.approx([found["ratio_of_order"][order]] * 5, rel=1e-9)
    assert found["ratio_of_order"][1] > 1.3 * found["ratio_of_order"][2]
