"""In which directions a check mesh errs: one block on meshes finer or coarser in some of them.

Without noise: what each mesh makes of the constants, beside the check mesh at the same ones, under
the errors that a likelihood states (`benchmarks.mesh_statement`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import calibration_runs as runs
from benchmarks.calibration_figures import stuck_emulator
from benchmarks.calibration_finer import with_mesh_error
from benchmarks.mesh_cases import MESH_CASES, TRUTH_STIFFENING
from benchmarks.mesh_statement import fitted

CASE = "wide-stuck"
TRUTH = 9
"""the truth that posteriors of this case miss most"""
NAMES = ("ln_kappa", "r", "s", "zero_mm")
MESHES = (
    (18, 8, 4),
    (28, 8, 4),
    (18, 10, 4),
    (18, 8, 5),
    (12, 8, 4),
    (12, 8, 6),
    (12, 10, 5),
    (15, 10, 5),
    (12, 12, 6),
    (22, 10, 5),
)
"""the check of the case first"""


def figures(store: Path) -> dict[str, Any]:
    """By mesh: what constants and the zero of the travel are off by, of forces and field."""
    case = MESH_CASES[CASE]
    ratios = runs.ratios_drawn(runs.N_FINER, case.draw)[TRUTH : TRUTH + 1]
    known = stuck_emulator(store, case.other_cells)
    likelihood = with_mesh_error(store, case, known, ratios[:, None])[0]
    found = {}
    for cells in MESHES:
        folder = f"directions-{case.hypothesis}"
        pin = TRUTH_STIFFENING
        [response] = runs.solved(
            store, case.hypothesis, folder, ratios, cells, stiffening=pin
        ).responses
        fit = fitted(likelihood, ratios[0], response.force, response.displacement)
        off = dict(zip(NAMES, np.round(fit.off, 4).tolist(), strict=True))
        found[" x ".join(map(str, cells))] = off
        print(f"  {cells}: {off}", flush=True)
    return {"mesh_directions": {"ratios": ratios[0].tolist(), "off": found}}
