"""Index of the fitting meshes from refining one coordinate at a time, by pin and contact.

Beside each fitting mesh stand one with half and one with twice as many elements along x, along y
and along z, or of rings, layers and sectors; all else is alike
(`benchmarks.coordinate_refinement`), also the load step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from benchmarks.coordinate_refinement import Share, share
from benchmarks.grid_convergence import CASES
from benchmarks.mesh_convergence import RATIOS, TRAVEL, Case, Mesh, fitting, followed, simulate
from benchmarks.meshes import name_of
from fe import Response, Rings

Array = npt.NDArray[np.float64]

BEFORE: dict[str, Mesh] = {
    "slide": Mesh((16, 5, 2), 0.05),
    "round, friction 0.3": Mesh(Rings(9, 6, 2), 0.05),
}
"""by case: the mesh that was refined first, whose sum was over 1 % or 0.005 mm: of the coordinate
with the largest share the fitting mesh has twice as many elements"""
LESS_FINE: dict[str, dict[str, int]] = {
    "slide": {"z": 6},
    "friction 0.3": {"y": 12},
}
"""by case: numbers of elements of a second index, to which a coordinate is refined by less than
twice: of 16 x 5 x 8 the front face tucks in its foot at 1.4 mm, which no other mesh does; 16 x 16 x
4 with friction is followed to 1.0 mm only, 16 x 12 x 4 to 1.2 mm"""
FEWEST_RUBBING = 3
"""elements along a bar with friction: one or two have the lines of one that slides"""


class Neighbours(NamedTuple):
    """A coordinate and the meshes that differ from a mesh in it alone."""

    name: str
    coarse: Mesh
    fine: Mesh
    numbers: tuple[int, int, int]
    """of elements, of coarse, own and fine mesh"""


class Index(NamedTuple):
    """What a mesh may be off by, each (n_step,)."""

    force: dict[str, Share]
    """%, by coordinate"""
    field: dict[str, Share]
    """mm, RMS over points and components, by coordinate"""


def neighbours(
    case: Case, mesh: Mesh, finer: Mapping[str, int] = MappingProxyType({})
) -> list[Neighbours]:
    """With half as many elements, rounded up, and twice as many, of each coordinate in turn.

    `finer` are other numbers than twice as many, by the coordinate's name.
    """
    rings = isinstance(mesh.cells, Rings)
    found = []
    for axis, name in enumerate(("rings", "layers", "sectors") if rings else ("x", "y", "z")):
        own = mesh.numbers[axis]
        half = (own + 1) // 2
        if name == "z" and case.pin == "bar" and not isinstance(case.interface, str):
            half = max(half, FEWEST_RUBBING)
        numbers = (half, own, finer.get(name, 2 * own))
        coarse, fine = (_with(mesh, axis, number) for number in numbers[::2])
        found.append(Neighbours(name, coarse, fine, numbers))
    return found


def _with(mesh: Mesh, axis: int, number: int) -> Mesh:
    """The mesh with another number of elements in one coordinate."""
    numbers = [*mesh.numbers]
    numbers[axis] = number
    one, two, three = numbers
    rings = isinstance(mesh.cells, Rings)
    return mesh._replace(cells=Rings(one, two, three) if rings else (one, two, three))


def index(triples: dict[str, tuple[tuple[int, int, int], Sequence[Response]]]) -> Index:
    """Index from the numbers and runs of each coordinate's coarse, own and fine mesh."""
    force, field = {}, {}
    for name, (numbers, runs) in triples.items():
        own = runs[1].force
        percent = 100.0 * np.array([run.force for run in runs]) / own
        values = np.array([run.displacement for run in runs]).reshape(3, len(own), -1)
        force[name] = share(percent[..., None], numbers)
        field[name] = share(values, numbers)
    return Index(force, field)


def study(
    folder: Path,
    case: Case,
    mesh: Mesh,
    before: Mesh | None = None,
    finer: Mapping[str, int] = MappingProxyType({}),
) -> Index:
    """Index of one mesh; runs that the folder does not hold are made.

    `finer` as in `neighbours`.  Where the mesh has as many elements in a coordinate as the mesh
    `before`, that one's neighbours tell: in a sum of terms of one coordinate each the others do not
    matter.
    """
    triples = {}
    meshes = (mesh, before or mesh)
    for own, first in zip(*(neighbours(case, one, finer) for one in meshes), strict=True):
        same = own.numbers == first.numbers
        of, middle = (first, meshes[1]) if same else (own, mesh)
        run = simulate(folder, case, middle, RATIOS)
        runs = [_beside(folder, case, of.coarse, run), run, _beside(folder, case, of.fine, run)]
        triples[of.name] = (of.numbers, runs)
    return index(triples)


def _beside(folder: Path, case: Case, mesh: Mesh, own: Response) -> Response:
    """Run of a neighbour of the mesh of a run; nothing but NaN if it is not followed at all."""
    if followed(case, mesh) > 0.0:
        return simulate(folder, case, mesh, RATIOS)
    return replace(own, force=np.nan * own.force, displacement=np.nan * own.displacement)


def total(shares: dict[str, Share], measure: Literal["index", "first_order"]) -> Array:
    """(n_step,) sum of a measure over the coordinates."""
    return np.asarray(np.sum([getattr(part, measure) for part in shares.values()], axis=0))


def table_of(folder: Path, case: Case, mesh: Mesh) -> str:
    """Lines of Markdown of one mesh."""
    before = BEFORE.get(str(case)) if mesh == fitting(case) else None
    return table(study(folder, case, mesh, before))


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


def figures(folder: Path, cases: Sequence[Case] = CASES) -> dict[str, Any]:
    """Sums and shares of force (%) and field (mm) by contact and increment.

    Of the fitting meshes; of the mesh before, if there is one, under the case and its numbers; with
    the finer meshes of `LESS_FINE` under the case, their coordinates and numbers.
    """
    found: dict[str, dict[str, Any]] = {}
    for case in cases:
        name, mesh, before = str(case), fitting(case), BEFORE.get(str(case))
        rows: dict[str, tuple[Mesh, Mesh | None, Mapping[str, int]]] = {name: (mesh, before, {})}
        if before:
            rows[f"{name}, {name_of(before.cells)}"] = (before, None, {})
        if finer := LESS_FINE.get(name):
            to = ", ".join(f"{axis} to {number}" for axis, number in finer.items())
            rows[f"{name}, {to}"] = (mesh, before, finer)
        for label, (one, first, finer) in rows.items():
            of = study(folder, case, one, first, finer)
            print(f"{label}: {one}\n{table(of)}", flush=True)
            for key, value in _row(one, of).items():
                found.setdefault(key, {})[label] = value
    return found


def _row(mesh: Mesh, of: Index) -> dict[str, Any]:
    """What the figures say of one mesh."""
    row: dict[str, Any] = {"directional_mesh": [*mesh.numbers]}
    for what, unit, shares in (("force", "percent", of.force), ("field", "mm", of.field)):
        key = f"{what}_directional"
        row[f"{key}_{unit}"] = _by_travel(total(shares, "index"))
        row[f"{key}_order_1_{unit}"] = _by_travel(total(shares, "first_order"))
        row[f"{key}_shares_{unit}"] = {k: _by_travel(v.index) for k, v in shares.items()}
        row[f"{key}_orders"] = {k: _by_travel(v.order) for k, v in shares.items()}
    return row


def _by_travel(values: Array) -> dict[str, float | None]:
    """None where no mesh tells."""
    known = [None if np.isnan(v) else float(v) for v in values]
    return dict(zip(map(str, TRAVEL), known, strict=True))
