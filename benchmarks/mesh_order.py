"""At which order a field's error falls: three meshes of one block."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import calibration_runs as runs
from benchmarks.calibration_runs import FRICTION
from benchmarks.mesh_cases import (
    CHECK_STIFFENING,
    PIN_SHARE,
    MeshCase,
    hypothesis,
    study,
)
from benchmarks.run_key import kept_campaign
from calib.study.block_cells import refinement
from calib.study.context import block_pin_model, stiffened
from calib.study.sections import Cells
from calib.study.usual_meshes import RUBBING
from fe.campaign_result import Campaign
from fe.executors import process_map
from fe.response import Array

FINEST: Cells = (19, 9, 5)
"""of a block that rubs; 20 x 10 x 5 is followed to 1.0 mm only"""
RATIOS = np.array([[0.5498, 0.1902], [0.8204, 0.338]])
"""(r, s) of two truths of the stuck cases"""


def order_of(store: Path, case: MeshCase, truths: Campaign) -> dict[str, Any]:
    """How much less than the sampling mesh the check errs by, at the ratios of the truths.

    All under the check's pin: the truth's gives way less, by `PIN_SHARE` of what the check's does.
    """
    fine, coarse, stiffer = runs.checks(store, case, truths.theta[:, :2])
    pin = (coarse.displacement - stiffer.displacement) / (CHECK_STIFFENING - 1.0)
    finest = truths.displacement + PIN_SHARE * pin
    return falling(
        (stiffer.displacement, fine.displacement, finest),
        (case.cells, case.check_cells, case.truth_cells),
    )


def rubbing(store: Path) -> dict[str, Any]:
    """The same of a block that rubs, on the meshes of studies that name none and a finer one."""
    used = study()
    found = replace(hypothesis("sliding"), pin=FRICTION, base=FRICTION)
    meshes = (*RUBBING, FINEST)
    fields = [
        kept_campaign(
            stiffened(block_pin_model(used, found, cells), CHECK_STIFFENING),
            RATIOS,
            store / "order",
            max_failure_rate=1.0,
            map_fn=process_map(0),
        ).displacement
        for cells in meshes
    ]
    return {"mesh_order_rubbing": falling(tuple(fields), meshes)}


def falling(fields: tuple[Array, ...], meshes: tuple[Cells, ...]) -> dict[str, Any]:
    """Differences of the two finer fields (n, n_step, n_point, 3) over those of the two coarser.

    As root mean squares over truths, points and components at each increment, and what errors of
    orders 1 and 2 would give.
    """
    coarse, fine, finest = fields
    seen = refinement(meshes[1], meshes[0])
    finer = refinement(meshes[2], meshes[1])
    return {
        "ratio": (_size(fine - finest) / _size(coarse - fine)).tolist(),
        "ratio_of_order": {order: (1.0 - finer**-order) / (seen**order - 1.0) for order in (1, 2)},
    }


def _size(differences: Array) -> Array:
    """(n_step,) root mean square of (n, n_step, n_point, 3)."""
    size: Array = np.sqrt(np.mean(differences**2, axis=(0, 2, 3)))
    return size
