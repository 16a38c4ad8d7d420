"""Grid convergence index of the pin force (Celik et al., J. Fluids Eng. 130, 2008).

From three meshes with representative sizes h1 < h2 < h3 the observed order p solves
p = |ln|e32 / e21| + ln((r21^p - s) / (r32^p - s))| / ln r21, s = sign(e32 / e21), and
GCI = 1.25 |e21 / f1| / (r21^p - 1).  p is kept between 1 and 2: differences that are by chance
small, or change sign, would otherwise promise too much, and singular edges have first order.
The meshes are similar: refined in all directions in the same ratio, on lines of one smooth map.
Of the field, e32 and e21 are RMS differences over points and components, and the index is in mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.mesh_convergence import (
    RATIOS,
    TRAVEL,
    Case,
    Mesh,
    field_difference,
    similar,
    simulate,
)
from benchmarks.meshes import Pin
from fe import Response

Array = npt.NDArray[np.float64]

PINS: tuple[Pin, ...] = ("bar", "round")
CASES = tuple(Case(pin, touch) for pin in PINS for touch in ("slide", "stick", 0.3))
SAFETY = 1.25
"""of a study on three meshes"""


def index_percent(f: Array, h: Array, low: float = 1.0, high: float = 2.0) -> tuple[float, float]:
    """GCI, % of the finest value, and the observed order, of f (3,) at sizes h (3,), fine first."""
    f1, f2, f3 = f
    index, order = grid_index(f2 - f1, f3 - f2, h, low, high)
    return 100.0 * index / abs(f1), order


def grid_index(
    e21: float, e32: float, h: Array, low: float = 1.0, high: float = 2.0
) -> tuple[float, float]:
    """GCI in the unit of the differences, and the observed order, at sizes h (3,), fine first."""
    r21, r32 = h[1] / h[0], h[2] / h[1]
    if e21 == 0.0:
        return 0.0, high
    order = (low + high) / 2.0
    s = np.sign(e32 / e21)
    if e32 == 0.0:
        order = low
    else:
        for _ in range(100):
            q = np.log((r21**order - s) / (r32**order - s))
            order = float(np.clip(abs(np.log(abs(e32 / e21)) + q) / np.log(r21), low, high))
    return SAFETY * abs(e21) / (r21**order - 1.0), order


def figures(folder: Path, cases: Sequence[Case] = CASES) -> dict[str, Any]:
    """Indices of force (%) and field (mm) of the finest mesh by contact and increment; orders."""
    found: dict[str, Any] = {
        "force_gci_percent": {},
        "force_gci_order": {},
        "field_gci_mm": {},
        "field_gci_order": {},
        "force_gci_monotone": {},
        "gci_seconds": {},
        "gci_meshes": {},
    }
    for case in cases:
        meshes = similar(case)
        size = np.array([1.0 / mesh.numbers[0] for mesh in meshes])[::-1]
        runs = [_run(folder, case, mesh) for mesh in meshes][::-1]
        name = str(case)
        force = np.array([run.force for run in runs])
        e21, e32 = field_difference(runs[1], runs[0]), field_difference(runs[2], runs[1])
        by_force = [index_percent(force[:, i], size) for i in range(len(TRAVEL))]
        by_field = [grid_index(a, b, size) for a, b in zip(e21, e32, strict=True)]
        product = np.diff(force, axis=0).prod(axis=0)
        monotone = [np.nan if np.isnan(p) else bool(p >= 0.0) for p in product]
        found["force_gci_percent"][name] = _by_travel([index for index, _ in by_force])
        found["force_gci_order"][name] = _by_travel([order for _, order in by_force])
        found["field_gci_mm"][name] = _by_travel([index for index, _ in by_field])
        found["field_gci_order"][name] = _by_travel([order for _, order in by_field])
        found["force_gci_monotone"][name] = _by_travel(monotone)
        found["gci_seconds"][name] = [run.seconds for run in runs[::-1]]
        found["gci_meshes"][name] = [[*mesh.numbers] for mesh in meshes]
    return found


def _by_travel(values: list[Any]) -> dict[str, Any]:
    """None where a mesh is not followed."""
    known = [None if np.isnan(value) else value for value in values]
    return dict(zip(map(str, TRAVEL), known, strict=True))


def _run(folder: Path, case: Case, mesh: Mesh) -> Response:
    response = simulate(folder, case, mesh, RATIOS)
    print(f"  {case}, {mesh}: {response.seconds:.0f} s, {response.status}", flush=True)
    return response
