"""Grid convergence index of the pin force (Celik et al., J. Fluids Eng. 130, 2008).

From three meshes with representative sizes h1 < h2 < h3 the observed order p solves
p = |ln|e32 / e21| + ln((r21^p - s) / (r32^p - s))| / ln r21, s = sign(e32 / e21), and
GCI = 1.25 |e21 / f1| / (r21^p - 1).  p is kept between 1 and 2: differences that are by chance
small, or change sign, would otherwise promise too much, and singular edges have first order.
The meshes are refined in all directions, but not in the same ratio: h is the cube root of the mean
element's volume, and the index an estimate, not a bound.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.mesh_convergence import TRAVEL, solve
from fe import Response, load_response, save_response

Array = npt.NDArray[np.float64]

MESHES = ((12, 4, 2), (16, 5, 2), (24, 8, 3))
"""coarse to fine, of the meshes of benchmarks/mesh_convergence.py"""
RATIOS = np.array([0.5, 0.05])
INTERFACES = ("slide", "stick")
SAFETY = 1.25
"""of a study on three meshes"""


def index_percent(f: Array, h: Array, low: float = 1.0, high: float = 2.0) -> tuple[float, float]:
    """GCI, % of the finest value, and the observed order, of f (3,) at sizes h (3,), fine first."""
    f1, f2, f3 = f
    e21, e32 = f2 - f1, f3 - f2
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
    return 100.0 * SAFETY * abs(e21 / f1) / (r21**order - 1.0), order


def figures(folder: Path, meshes: tuple[tuple[int, int, int], ...] = MESHES) -> dict[str, Any]:
    """`force_gci_percent` of the finest mesh by contact and increment, and the observed orders."""
    size = np.array([np.prod(cells, dtype=float) ** (-1.0 / 3.0) for cells in meshes])[::-1]
    index: dict[str, Any] = {}
    order: dict[str, Any] = {}
    for interface in INTERFACES:
        force = np.array([run(folder, interface, cells).force for cells in meshes])[::-1]
        found = [index_percent(force[:, i], size) for i in range(len(TRAVEL))]
        index[interface] = {str(d): value for d, (value, _) in zip(TRAVEL, found, strict=True)}
        order[interface] = {str(d): p for d, (_, p) in zip(TRAVEL, found, strict=True)}
    return {
        "force_gci_percent": index,
        "force_gci_order": order,
        "force_gci_meshes": [list(cells) for cells in meshes],
    }


def run(folder: Path, interface: Any, cells: tuple[int, int, int]) -> Response:
    """One simulation, from the folder if it is there (delete that when the model changes)."""
    path = folder / f"{interface}-{'x'.join(map(str, cells))}.npz"
    if path.exists():
        return load_response(path)
    response = solve(interface, cells, RATIOS)
    folder.mkdir(parents=True, exist_ok=True)
    save_response(path, response)
    print(f"  {path.stem}: {response.seconds:.0f} s, {response.status}", flush=True)
    return response
