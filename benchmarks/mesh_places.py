"""Where on the front face a mesh errs: the error of a check mesh, and the difference that tells it.

Both at the truths' own constants: a finer truth less the check mesh, whose pin gives way twice as
much, and the sampling mesh less the check mesh under one pin.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist

from benchmarks import calibration_runs as runs
from benchmarks.calibration_figures import points
from benchmarks.mesh_cases import MESH_CASES
from fe.response import Array

CASES = ("finer", "finer-stuck", "finer-stuck-new")
"""of `MESH_CASES`: those that what is stated of a mesh's error was chosen by"""
EDGES = (0.05, 0.15, 0.25, 0.35, 0.5, 0.7, 1.0, 1.5, 2.0)
"""mm, between which correlations over the points are averaged"""
SHARES = (0.1, 0.5, 0.9, 1.0)
"""quantiles of the sizes over the points"""


def figures(store: Path) -> dict[str, Any]:
    """By mesh: sizes over the face and correlations by distance."""
    found = {}
    for name in CASES:
        case = MESH_CASES[name]
        truths = runs.finer_truths(store, case)
        fine, _, stiffer = runs.checks(store, case, truths.theta[:, :2])
        error, size = spread(truths.displacement - fine.displacement, points())
        difference, measured = spread(stiffer.displacement - fine.displacement, points())
        alike = float(np.corrcoef(np.log(size), np.log(measured))[0, 1])
        found[name] = {
            "error_of_check": error,
            "difference": difference,
            "correlation_of_log_sizes": alike,
        }
        print(f"{name}: {found[name]}", flush=True)
    return {"mesh_places": found}


def spread(fields: Array, at: Array) -> tuple[dict[str, Any], Array]:
    """How fields (n, n_step, n_point, 3) are spread over points (n_point, 2) mm; and sizes.

    Each increment and component counts alike; sizes (n_point,) have a root mean square of one.
    """
    scaled = fields / np.sqrt(np.mean(fields**2, axis=(0, 2), keepdims=True))
    flat = np.moveaxis(scaled, 2, 0).reshape(len(at), -1)
    products = flat @ flat.T / flat.shape[1]
    size = np.sqrt(np.diag(products))
    correlation, apart = products / np.outer(size, size), cdist(at, at)
    by_distance = [
        float(correlation[(apart >= low) & (apart < high)].mean()) for low, high in pairwise(EDGES)
    ]
    told = {
        "quantiles": SHARES,
        "size": np.quantile(size, SHARES).tolist(),
        "distance_mm": EDGES,
        "correlation": by_distance,
    }
    return told, size
