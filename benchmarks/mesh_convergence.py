"""Force and front-face field of the thesis specimen on ever finer meshes, as a Markdown table.

    python -m benchmarks.mesh_convergence [stick|slide|COEFFICIENT OF FRICTION] [r s]
        [--pin bar|round] [--cells 12x4x2 ...] [--step MM] [--plane-strain] [--directions]
        [--runs FOLDER]

Runs one mesh after the other in one process with one thread, at kappa = 1 MPa, and prints the
difference of each from the finest: force in %, field as RMS over the components at 840 points
in mm; the index of the last three; and the uncertainty of each from all of them, if there are four
(`benchmarks.mesh_uncertainty`).  Every run is kept in the folder, for both, under a name that
changes with the model and the code (`benchmarks.run_key`), and not repeated.  Meshes are those of
a design sample and of a fit and three similar ones, or the given `--cells`, the finest last; under
a round pin r12x8x2 are 12 rings, 8 layers and 2 elements along an eighth of the rim.  With
`--directions` it refines the mesh of a fit, or each of `--cells`, one coordinate at a time, and
prints the index of that (`benchmarks.directional_index`).
"""

from __future__ import annotations

import argparse
import time
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from benchmarks.meshes import FITTING_CELLS, SAMPLING_CELLS, Pin
from benchmarks.run_key import run_key
from fe import BlockPin, BlockPinModel, Contact, Response, Rings, load_response, save_response
from fe.specimens.block_pin import Cells, Interface
from fe.steps import StepOptions

Array = npt.NDArray[np.float64]

TRAVEL = (0.6, 0.8, 1.0, 1.2, 1.4)
RATIOS = np.array([0.5, 0.05])
"""(r, s) of every mesh, unless asked otherwise"""
RUNS = Path(__file__).resolve().parents[1] / "runs" / "verify-fe" / "gci"


FOLLOWED = {
    "friction 0.3, 16 x 16 x 4, 0.05": 1.0,
    "friction 0.3, 16 x 12 x 4, 0.05": 1.2,
    "friction 0.3, 20 x 10 x 5, 0.05": 1.0,
    "round, friction 0.3, 36 x 6 x 2, 0.05": 1.0,
    "round, friction 0.3, 9 x 12 x 2, 0.05": 0.0,
    "round, friction 0.3, 9 x 6 x 4, 0.05": 0.0,
}
"""mm: how far meshes are followed of which a later step was not found within minutes; 0 where
a mesh takes too long, or none of its runs has ended"""


class Mesh(NamedTuple):
    """Elements along x, y, z of the quarter, and the largest load step."""

    cells: Cells
    step: float
    """mm; stick is tied at the end of a step, so its size belongs to the discretisation"""

    def __str__(self) -> str:
        return f"{' x '.join(map(str, self.numbers))}, {self.step:g}"

    @property
    def numbers(self) -> tuple[int, ...]:
        """The numbers of elements; of rings those from core to side, over height, an eighth."""
        return astuple(self.cells) if isinstance(self.cells, Rings) else self.cells


class Case(NamedTuple):
    """What a study is of."""

    pin: Pin
    interface: Interface
    """the same on pin and base"""
    plane_strain: bool = False

    def __str__(self) -> str:
        """As in docs/verification/fe.json, where a bar has no name."""
        named = isinstance(self.interface, str)
        words = ["round"] if self.pin == "round" else []
        words += ["plane strain"] if self.plane_strain else []
        return ", ".join([*words, str(self.interface) if named else f"friction {self.interface:g}"])


GLUED = tuple(Mesh((4 * n, 4 * n, 2 * n), 0.05) for n in (2, 3, 4))
SLIDING = tuple(Mesh((4 * n, 2 * n, n), 0.05) for n in (2, 3, 4))
RUBBING = tuple(Mesh((4 * n, 2 * n, n), 0.05) for n in (3, 4, 5))
STUCK_TO_ROUND = tuple(Mesh(Rings(4 * n, 4 * n), 0.05) for n in (2, 3, 4))
UNDER_ROUND = tuple(Mesh(Rings(3 * n, 2 * n), 0.05) for n in (2, 3, 4))
RUBBING_ROUND = tuple(Mesh(Rings(6 * n, 2 * n), 0.05) for n in (1, 2, 3))
"""coarse to fine, similar to each other (of a bar with friction two elements along it have
lines of their own); rings in the section across the rim, with two elements along an eighth of
it on all"""


def similar(case: Case) -> tuple[Mesh, ...]:
    """Three meshes of the index, coarse to fine."""
    if case.pin == "round":
        touch = {"stick": STUCK_TO_ROUND, "slide": UNDER_ROUND}
        return touch.get(str(case.interface), RUBBING_ROUND)
    return {"stick": GLUED, "slide": SLIDING}.get(str(case.interface), RUBBING)


def sampling(case: Case) -> Mesh:
    """Mesh of a design sample."""
    return Mesh(SAMPLING_CELLS[_row(case)], 0.05)


def fitting(case: Case) -> Mesh:
    """Mesh of a fit."""
    return Mesh(FITTING_CELLS[_row(case)], 0.05)


def _row(case: Case) -> str:
    touch = {"stick": "stick", "slide": "frictionless"}.get(str(case.interface), "friction")
    return f"{case.pin}, {touch}"


def followed(case: Case, mesh: Mesh) -> float:
    """Travel to which a mesh is followed, mm."""
    return FOLLOWED.get(f"{case}, {mesh}", TRAVEL[-1])


def simulate(folder: Path, case: Case, mesh: Mesh, ratios: Array) -> Response:
    """The thesis specimen, the same interface on pin and base, from the folder if it is there.

    `seconds` of the response are of the processor, not of the clock.  A mesh that is not followed
    to the last travel has NaN there.
    """
    contact = Contact(case.interface, case.interface)
    steps = StepOptions(largest=mesh.step)
    last = followed(case, mesh) or TRAVEL[-1]  # who asks for a mesh that takes long, gets it
    model = BlockPinModel(
        BlockPin(pin=case.pin),
        contact,
        mesh.cells,
        tuple(travel for travel in TRAVEL if travel <= last),
        steps=steps,
        plane_strain=case.plane_strain,
    )
    words = [str(case), "x".join(map(str, mesh.numbers)), *(f"{v:g}" for v in ratios)]
    path = folder / f"{'-'.join(words).replace(', ', '-').replace(' ', '-')}-{run_key(model)}.npz"
    if path.exists():
        return _to_the_end(load_response(path))
    start = time.process_time()
    response = replace(model(ratios), seconds=time.process_time() - start)
    folder.mkdir(parents=True, exist_ok=True)
    save_response(path, response)
    return _to_the_end(response)


def _to_the_end(run: Response) -> Response:
    """All travels; NaN where the run was not to go."""
    missing = len(TRAVEL) - len(run.travel)

    def longer(values: npt.NDArray[Any], fill: float = np.nan) -> npt.NDArray[Any]:
        return np.pad(values, [(0, missing)] + [(0, 0)] * (values.ndim - 1), constant_values=fill)

    return replace(
        run,
        travel=np.array(TRAVEL),
        force=longer(run.force),
        displacement=longer(run.displacement),
        force_gradient=longer(run.force_gradient),
        displacement_gradient=longer(run.displacement_gradient),
        negative_pivots=longer(run.negative_pivots, 0),
    )


def field_difference(one: Response, other: Response) -> Array:
    """(n_step,) RMS over points and components of the difference of two fields, mm."""
    found: Array = np.sqrt(np.mean((one.displacement - other.displacement) ** 2, axis=(1, 2)))
    return found


def main(arguments: list[str] | None = None) -> None:
    """Print the tables."""
    from benchmarks.directional_index import table_of as directions  # which needs this module
    from benchmarks.mesh_uncertainty import table  # which does too

    options = _options(arguments)
    named = options.interface in ("stick", "slide")
    interface = cast(Interface, options.interface if named else float(options.interface))
    case = Case(options.pin, interface, options.plane_strain)
    ratios = np.array(options.ratios)
    family = similar(case)
    single = (sampling(case), fitting(case))
    meshes = [*(mesh for mesh in single if mesh not in family), *family]
    if options.cells:
        meshes = [Mesh(cells, options.step) for cells in options.cells]
    if options.directions:
        for mesh in meshes if options.cells else [fitting(case)]:
            print(f"{case}, {mesh}\n{directions(options.runs, case, mesh)}", flush=True)
        return
    print(f"{case}, r = {ratios[0]:g}, s = {ratios[1]:g}, kappa = 1 MPa\n")
    print("| elements, step mm | " + " | ".join(f"F({d}) N" for d in TRAVEL), end=" | ")
    print("s | pivots < 0 |\n" + "|---" * (len(TRAVEL) + 3) + "|")
    runs = []
    for mesh in meshes:
        run = simulate(options.runs, case, mesh, ratios)
        runs.append(run)
        forces = " | ".join(f"{f:.2f}" for f in run.force)
        negative = int(run.negative_pivots.max())
        print(f"| {mesh} | {forces} | {run.seconds:.0f} | {negative} |", flush=True)
    _print_differences(meshes, runs)
    if len(runs) >= 3:
        _print_index(meshes[-3:], runs[-3:])
    print("\n" + table(case, meshes, runs))


def _print_index(meshes: list[Mesh], runs: list[Response]) -> None:
    """Grid convergence index of the last three, taken as similar."""
    from benchmarks.grid_convergence import grid_index, index_percent  # which needs this module

    size = np.array([1.0 / mesh.numbers[0] for mesh in meshes])[::-1]
    force = np.array([run.force for run in runs])[::-1]
    e21, e32 = field_difference(runs[1], runs[2]), field_difference(runs[0], runs[1])
    by_force = [index_percent(f, size) for f in force.T]
    by_field = [grid_index(a, b, size)[0] for a, b in zip(e21, e32, strict=True)]
    print("\nindex: force % " + " | ".join(f"{index:.2f}" for index, _ in by_force), end="; ")
    print("order " + " | ".join(f"{order:.1f}" for _, order in by_force), end="; ")
    print("field mm " + " | ".join(f"{index:.4f}" for index in by_field))


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="benchmarks.mesh_convergence")
    parser.add_argument("interface", nargs="?", default="slide")
    parser.add_argument("ratios", nargs="*", type=float, default=RATIOS.tolist(), metavar="r s")
    parser.add_argument("--pin", choices=("bar", "round"), default="bar")
    parser.add_argument("--cells", nargs="+", type=_cells, metavar="12x4x2")
    parser.add_argument("--step", type=float, default=0.05, help="largest, mm, of --cells")
    parser.add_argument("--plane-strain", action="store_true", help="--cells with one along z")
    parser.add_argument("--directions", action="store_true", help="one coordinate at a time")
    parser.add_argument("--runs", type=Path, default=RUNS)
    return parser.parse_args(arguments)


def _cells(text: str) -> Cells:
    one, two, three = (int(n) for n in text.removeprefix("r").split("x"))
    return Rings(one, two, three) if text.startswith("r") else (one, two, three)


def _print_differences(meshes: list[Mesh], runs: list[Response]) -> None:
    """Table of the differences from the last."""
    print("\n| elements, step mm | " + " | ".join(f"force {d} %" for d in TRAVEL), end=" | ")
    print(" | ".join(f"field {d} mm" for d in TRAVEL) + " |")
    print("|---" * (2 * len(TRAVEL) + 1) + "|")
    for mesh, run in zip(meshes[:-1], runs[:-1], strict=True):
        force = 100.0 * (run.force / runs[-1].force - 1.0)
        field = field_difference(run, runs[-1])
        values = [f"{v:+.2f}" for v in force] + [f"{v:.4f}" for v in field]
        print(f"| {mesh} | " + " | ".join(values) + " |")


if __name__ == "__main__":
    main()
