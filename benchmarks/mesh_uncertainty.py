"""Uncertainty of the fitting meshes by least squares over four or more meshes, by pin and contact.

Force by force, and the front-face field as one quantity (`benchmarks.grid_uncertainty`): its 840
points and three components share an order, and the bound is of the RMS that the aim is stated in.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from benchmarks.grid_uncertainty import FEWEST, interval, mesh_size, uncertainty
from benchmarks.mesh_convergence import RATIOS, TRAVEL, Case, Mesh, fitting, simulate
from fe import BlockPin, Contact, Response
from fe.specimens.block_pin_mesh import block_mesh

Array = npt.NDArray[np.float64]

_RUBBING = ((10, 5, 3), (12, 6, 3), (14, 7, 3), (16, 8, 4))
MESHES: dict[str, tuple[tuple[int, int, int], ...]] = {
    "stick": ((8, 8, 4), (10, 10, 5), (12, 12, 6), (14, 14, 7), (16, 16, 8), (28, 20, 7)),
    "slide": ((8, 4, 2), *_RUBBING, (18, 9, 4)),
    "friction 0.3": _RUBBING,
}
"""coarse to fine, by case"""
CASES = (Case("bar", "stick"), Case("bar", "slide"), Case("bar", 0.3))


class Bounds(NamedTuple):
    """Of one mesh at the travels, each (n_step,)."""

    force: Array
    """%, of the mesh's force"""
    force_order: Array
    field: Array
    """mm, RMS over points and components"""
    field_order: Array
    force_interval: Array
    """%, with order 1 to 2"""
    field_interval: Array
    """mm"""


def bounds(case: Case, meshes: Sequence[Mesh], runs: Sequence[Response], mesh: int) -> Bounds:
    """Uncertainty of one of the meshes from all of them.

    Raises ValueError for fewer than four, and for a run that stopped before the last travel.
    """
    for one, run in zip(meshes, runs, strict=True):
        if not np.isfinite(run.force).all():
            raise ValueError(f"runs: expected all travels, found {run.reached:g} mm of {one}")
    h = np.array([size(case, one) for one in meshes])
    force = np.array([run.force for run in runs])
    fields = np.array([run.displacement for run in runs])
    by_force = uncertainty(force, h, mesh)
    flat = [field.reshape(len(runs), -1) for field in np.moveaxis(fields, 1, 0)]
    by_field = [uncertainty(field, h, mesh, together=True) for field in flat]
    return Bounds(
        100.0 * by_force.u / force[mesh],
        by_force.order,
        np.concatenate([one.u for one in by_field]),
        np.concatenate([one.order for one in by_field]),
        100.0 * interval(force, h, mesh) / force[mesh],
        np.concatenate([interval(field, h, mesh, together=True) for field in flat]),
    )


def size(case: Case, mesh: Mesh) -> float:
    """Representative size, mm; in plane strain of the one layer of elements."""
    specimen = BlockPin(pin=case.pin)
    contact = Contact(case.interface, case.interface)
    elements = block_mesh(specimen, "quarter", mesh.cells, contact).nelements
    area = specimen.width * specimen.height / 2.0
    if case.plane_strain:
        return mesh_size(area, elements, dimensions=2)
    return mesh_size(area * specimen.depth / 2.0, elements)


def table(case: Case, meshes: Sequence[Mesh], runs: Sequence[Response]) -> str:
    """Lines of Markdown: bounds of every mesh, and the orders, which they share."""
    if len(meshes) < FEWEST:
        return ""
    heads = [*(f"force {d} %" for d in TRAVEL), *(f"field {d} mm" for d in TRAVEL)]
    lines = ["| bounds | " + " | ".join(heads) + " |", "|---" * (len(heads) + 1) + "|"]
    found = [bounds(case, meshes, runs, i) for i in range(len(meshes))]
    for mesh, of in zip(meshes, found, strict=True):
        lines.append(_line(f"{mesh}: free order", of.force, of.field))
        lines.append(_line(f"{mesh}: order 1 to 2", of.force_interval, of.field_interval))
    orders = [f"{p:.1f}" for p in (*found[0].force_order, *found[0].field_order)]
    return "\n".join([*lines, "| free order | " + " | ".join(orders) + " |"])


def _line(name: str, force: Array, field: Array) -> str:
    return f"| {name} | " + " | ".join([*(f"{u:.2f}" for u in force), *(f"{u:.4f}" for u in field)])


def figures(folder: Path) -> dict[str, Any]:
    """Bounds of force (%) and field (mm) of the fitting mesh by contact and increment; orders."""
    found: dict[str, dict[str, Any]] = {
        name: {}
        for name in (
            "force_uncertainty_percent",
            "force_uncertainty_order",
            "field_uncertainty_mm",
            "field_uncertainty_order",
            "force_interval_percent",
            "field_interval_mm",
            "uncertainty_of_mesh",
            "uncertainty_from_meshes",
        )
    }
    for case in CASES:
        name, own = str(case), fitting(case)
        cells = MESHES[name]
        meshes = [Mesh(one, own.step) for one in (*cells, *({own.cells} - {*cells}))]
        runs = [simulate(folder, case, mesh, RATIOS) for mesh in meshes]
        of = bounds(case, meshes, runs, meshes.index(own))
        found["uncertainty_of_mesh"][name] = [*own.numbers]
        found["uncertainty_from_meshes"][name] = [[*mesh.numbers] for mesh in meshes]
        for key, values in zip(list(found)[:6], of, strict=True):
            found[key][name] = dict(zip(map(str, TRAVEL), values.tolist(), strict=True))
    return found
