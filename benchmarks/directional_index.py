"""Index of the fitting meshes from refining one coordinate at a time, by pin and contact.

Beside each fitting mesh stand one with half and one with twice as many elements along x, along y
and along z, or of rings, layers and sectors; all else is alike
(`benchmarks.coordinate_refinement`).  Where material sticks or rubs, the load step is a fourth
coordinate, stated beside the sum.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from benchmarks.coordinate_refinement import Share, share
from benchmarks.grid_convergence import CASES
from benchmarks.mesh_convergence import RATIOS, TRAVEL, Case, Mesh, fitting, simulate
from fe import Response, Rings

Array = npt.NDArray[np.float64]

STEP = "step"
"""name of the load step among the coordinates"""
FEWEST_RUBBING = 3
"""elements along a bar with friction: one or two keep lines of a design sample's mesh"""


class Neighbours(NamedTuple):
    """A coordinate and the meshes that differ from a mesh in it alone."""

    name: str
    coarse: Mesh
    fine: Mesh
    numbers: tuple[float, float, float]
    """of elements, or steps a mm, of coarse, own and fine mesh"""


class Index(NamedTuple):
    """What a mesh may be off by, each (n_step,)."""

    force: dict[str, Share]
    """%, by coordinate"""
    field: dict[str, Share]
    """mm, RMS over points and components, by coordinate"""


def neighbours(case: Case, mesh: Mesh) -> list[Neighbours]:
    """Half as many elements, rounded up, and twice as many of each coordinate in turn."""
    rings = isinstance(mesh.cells, Rings)
    found = []
    for axis, name in enumerate(("rings", "layers", "sectors") if rings else ("x", "y", "z")):
        own = mesh.numbers[axis]
        half = (own + 1) // 2
        if name == "z" and case.pin == "bar" and not isinstance(case.interface, str):
            half = max(half, FEWEST_RUBBING)
        numbers = (half, own, 2 * own)
        found.append(Neighbours(name, _with(mesh, axis, half), _with(mesh, axis, 2 * own), numbers))
    if case.interface != "slide":
        steps = [mesh._replace(step=mesh.step * factor) for factor in (2.0, 0.5)]
        by_mm = (0.5 / mesh.step, 1.0 / mesh.step, 2.0 / mesh.step)
        found.append(Neighbours(STEP, *steps, by_mm))
    return found


def _with(mesh: Mesh, axis: int, number: int) -> Mesh:
    """The mesh with another number of elements in one coordinate."""
    numbers = [*mesh.numbers]
    numbers[axis] = number
    one, two, three = numbers
    rings = isinstance(mesh.cells, Rings)
    return mesh._replace(cells=Rings(one, two, three) if rings else (one, two, three))


def index(own: Response, beside: list[tuple[Neighbours, Response, Response]]) -> Index:
    """Index of a mesh from its own run and those of its neighbours."""
    force, field = {}, {}
    for of, coarse, fine in beside:
        runs = (coarse, own, fine)
        percent = 100.0 * np.array([run.force for run in runs]) / own.force
        values = np.array([run.displacement for run in runs]).reshape(3, len(own.force), -1)
        force[of.name] = share(percent[..., None], of.numbers)
        field[of.name] = share(values, of.numbers)
    return Index(force, field)


def study(folder: Path, case: Case, mesh: Mesh) -> Index:
    """Index of one mesh; runs that the folder does not hold are made."""
    own = simulate(folder, case, mesh, RATIOS)
    beside = [
        (of, *(simulate(folder, case, one, RATIOS) for one in (of.coarse, of.fine)))
        for of in neighbours(case, mesh)
    ]
    return index(own, beside)


def total(shares: dict[str, Share], measure: Literal["index", "first_order"]) -> Array:
    """(n_step,) sum of a measure over the coordinates of the mesh, without the load step."""
    parts = [getattr(part, measure) for name, part in shares.items() if name != STEP]
    return np.asarray(np.sum(parts, axis=0))


def table_of(folder: Path, case: Case, mesh: Mesh) -> str:
    """Lines of Markdown of one mesh."""
    return table(study(folder, case, mesh))


def table(found: Index) -> str:
    """Lines of Markdown: each coordinate's share and order, and the sums."""
    heads = [*(f"force {d} %" for d in TRAVEL), *(f"field {d} mm" for d in TRAVEL)]
    lines = ["| index | " + " | ".join(heads) + " |", "|---" * (len(heads) + 1) + "|"]
    for name in found.force:
        force, field = found.force[name], found.field[name]
        lines.append(_line(f"{name} (order)", force.index, field.index, force.order, field.order))
    lines.append(_line("sum", *(total(of, "index") for of in found)))
    lines.append(_line("sum, order 1", *(total(of, "first_order") for of in found)))
    return "\n".join(lines)


def _line(name: str, force: Array, field: Array, *orders: Array) -> str:
    words = [*(f"{u:.2f}" for u in force), *(f"{u:.4f}" for u in field)]
    if orders:
        words = [f"{w} ({p:.1f})" for w, p in zip(words, np.concatenate(orders), strict=True)]
    return f"| {name} | " + " | ".join(words) + " |"


def figures(folder: Path) -> dict[str, Any]:
    """Sums and shares of force (%) and field (mm) of fitting meshes by contact and increment."""
    found: dict[str, dict[str, Any]] = {}
    for case in CASES:
        mesh = fitting(case)
        of = study(folder, case, mesh)
        print(f"{case}, {mesh}\n{table(of)}", flush=True)
        row: dict[str, Any] = {"directional_mesh": [*mesh.numbers]}
        for what, unit, shares in (("force", "percent", of.force), ("field", "mm", of.field)):
            key = f"{what}_directional"
            row[f"{key}_{unit}"] = _by_travel(total(shares, "index"))
            row[f"{key}_order_1_{unit}"] = _by_travel(total(shares, "first_order"))
            row[f"{key}_shares_{unit}"] = {k: _by_travel(v.index) for k, v in shares.items()}
            row[f"{key}_orders"] = {k: _by_travel(v.order) for k, v in shares.items()}
        for key, value in row.items():
            found.setdefault(key, {})[str(case)] = value
    return found


def _by_travel(values: Array) -> dict[str, float | None]:
    """None where no mesh tells."""
    known = [None if np.isnan(v) else float(v) for v in values]
    return dict(zip(map(str, TRAVEL), known, strict=True))
