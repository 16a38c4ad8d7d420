"""The thesis' own meshes pressed by our solver: n x 2n x 2n first-order bricks, one pressure each.

    python -m benchmarks.first_order_block 5 10 15 20 [--json FILE] [--fillet 0.3] [--travel MM ...]

The stuck bar of `benchmarks/thesis_meshes.py` to 1.4 mm on the uniform meshes of Table 3.7, whose
elements (eight nodes, mean dilatation) lock less than plain ones but are stiff in bending and, in
the compression under a pin, prone to modes of the size of an element.  The product has that element
for its bar of one element alone.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
import numpy.typing as npt
from skfem import Basis, ElementHex1, FacetBasis, MeshHex

from benchmarks.thesis_meshes import RATIOS, TABLE_3_7, TRAVEL, BarRun
from benchmarks.timing import median_seconds
from fe import BlockPin, BlockPinModel, Contact
from fe.contact import Faces
from fe.discretisation import first_order_elements, pattern
from fe.field_motion import field_probe
from fe.pin_surface import under_flat
from fe.specimens.block_pin_mesh import Discretisation
from fe.weak_form import Elements

Array = npt.NDArray[np.float64]

VOLUME_ORDER, FACE_ORDER = 2, 5
"""2 x 2 x 2 Gauss points an element; 3 x 3 a face, as dense as on the product's larger faces"""


class FirstOrderBlock(BlockPinModel):
    """The quarter block under a bar that sticks, of first-order elements; no sensitivities."""

    def mesh(self) -> MeshHex:
        """Uniform bricks."""
        block = self.specimen
        lengths = (block.width / 2.0, block.height, block.depth / 2.0)
        return MeshHex.init_tensor(
            *(np.linspace(0.0, a, int(n) + 1) for a, n in zip(lengths, self.cells, strict=True))
        )

    def discretise(self) -> Discretisation:
        """Tables of the mesh, contact faces, constraints and field points."""
        mesh, block = self.mesh(), self.specimen
        table, basis = bricks(mesh)
        at, least = table.positions, 1e-9 * block.height
        fixed = np.zeros(at.shape, dtype=bool)
        fixed[at[:, 0] < least, 0] = True
        fixed[at[:, 2] < least, 2] = True
        fixed[at[:, 1] < least] = True
        top = mesh.facets_satisfying(lambda x: abs(x[1] - block.height) < least)
        side = mesh.facets_satisfying(
            lambda x: (abs(x[0] - block.width / 2) < least) | (abs(x[2] - block.depth / 2) < least)
        )
        on_top = np.repeat([True, False], [top.size, side.size])
        met = _faces(mesh, np.concatenate([top, side]), ~on_top)
        pin = block.rigid_pin(1.0, 1.0, 1.0)
        points = self.points()
        front = np.column_stack([points, np.full(len(points), block.depth / 2.0)])
        return Discretisation(
            elements=table,
            faces=met,
            pattern=pattern(table.nodes, met.nodes, fixed.ravel()),
            glued=on_top[:, None] & under_flat(met.points, pin),
            probe=field_probe(basis, front),
        )


def bricks(mesh: MeshHex) -> tuple[Elements, Basis]:
    """Q1/P0 tables of a hexahedral mesh, and the scikit-fem basis they come from."""
    basis = Basis(mesh, ElementHex1(), intorder=VOLUME_ORDER)
    return first_order_elements(basis), basis


def _faces(mesh: MeshHex, facets: npt.NDArray[np.int64], floor: npt.NDArray[np.bool_]) -> Faces:
    basis = FacetBasis(mesh, ElementHex1(), facets=facets, intorder=FACE_ORDER)
    values = np.stack([np.asarray(phi[0]) for phi in basis.basis])
    local = np.stack([np.flatnonzero(column > 1e-12) for column in np.abs(values).max(axis=2).T])
    rows = np.arange(len(facets))[:, None]
    return Faces(
        nodes=np.ascontiguousarray(basis.element_dofs[local, rows], dtype=np.int64),
        shape=np.ascontiguousarray(values[local, rows].transpose(0, 2, 1)),
        weights=np.ascontiguousarray(basis.dx),
        points=np.ascontiguousarray(np.asarray(basis.global_coordinates()).transpose(1, 2, 0)),
        floor=floor,
        base=np.zeros(len(facets), dtype=bool),
    )


def press(n: int, fillet: float = 0.3, travel: tuple[float, ...] = TRAVEL) -> BarRun:
    """Time one march on n x 2n x 2n elements (n over the height); compiled before."""
    cells = (2 * n, n, 2 * n)
    model = FirstOrderBlock(
        BlockPin(pin_fillet=fillet), Contact("stick", "stick"), cells, travel, sensitivities=()
    )
    response, seconds = median_seconds(lambda: model(RATIOS), 1, warm=False)
    print(f"n = {n}: {response.message}", file=sys.stderr)
    return BarRun(
        cells=cells,
        n_unknowns=model.discretise().pattern.n_free,
        seconds=seconds,
        n_factorisations=response.n_factorisations,
        reached=response.reached,
        force=[float(f) for f in response.force],
    )


def main(arguments: list[str] | None = None) -> None:
    """Press the meshes asked for and print them beside the thesis' times."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.first_order_block", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("n", type=int, nargs="+", help="elements over the height")
    parser.add_argument("--fillet", type=float, default=0.3, help="of the pin's edge, mm")
    parser.add_argument("--travel", type=float, nargs="+", default=TRAVEL, help="mm")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    options = parser.parse_args(arguments)
    press(2, options.fillet, (0.1,))  # compile
    runs = []
    print("| n | unknowns | s | thesis, s | factorisations | good to, mm | forces, N |")
    print("|---|---|---|---|---|---|---|")
    for n in options.n:
        run = press(n, options.fillet, tuple(options.travel))
        kept = asdict(run) | {"force": [f if np.isfinite(f) else None for f in run.force]}
        runs.append({"n": n, "thesis_seconds": TABLE_3_7.get(n), **kept})
        forces = ", ".join(f"{f:.2f}" for f in run.force)
        print(
            f"| {n} | {run.n_unknowns} | {run.seconds:.1f} | {TABLE_3_7.get(n, '')} "
            f"| {run.n_factorisations} | {run.reached:g} | {forces} |",
            flush=True,
        )
        if options.json:
            options.json.write_text(json.dumps(runs, indent=2) + "\n")


if __name__ == "__main__":
    main()
