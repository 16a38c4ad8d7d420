"""Force and field of the specimens without a pin on ever finer meshes, as Markdown tables.

    python -m benchmarks.specimen_convergence [tensile|bonded|slide|FRICTION] [r s]

The notched plate pulled to 50 % of its length, or the cylinder of 50 x 30 mm compressed to half its
height with bonded or sliding ends (a number is the coefficient of friction), at kappa = 1 MPa, one
thread.  Differences are from the finest mesh: force in %, field as RMS over the points in mm.
"""

from __future__ import annotations

import sys

import numpy as np

from fe import Cylinder, CylinderModel, NotchedPlate, Response, TensileModel

TENSILE_MESHES = ((3, 6, 1), (4, 8, 1), (6, 12, 2), (8, 16, 2), (12, 24, 3))
CYLINDER_MESHES = ((4, 3), (8, 6), (16, 12), (24, 18), (32, 24))


def models(name: str) -> list[TensileModel] | list[CylinderModel]:
    """The specimen on all its meshes, coarsest first."""
    if name == "tensile":
        return [TensileModel(NotchedPlate(), c, (3.0, 7.5, 15.0)) for c in TENSILE_MESHES]
    ends, friction = ("bonded", 0.0) if name == "bonded" else ("slide", 0.0)
    if name not in ("bonded", "slide"):
        friction = float(name)
    travel = (3.0, 9.0, 15.0)
    return [
        CylinderModel(Cylinder(), c, travel, "bonded" if ends == "bonded" else "slide", friction)
        for c in CYLINDER_MESHES
    ]


def report(run: Response, cells: tuple[int, ...]) -> str:
    """One row: forces, cost, stability."""
    forces = " | ".join(f"{f:.3f}" for f in run.force)
    name = " x ".join(map(str, cells))
    cost = f"{run.n_factorisations} | {run.seconds:.1f}"
    return f"| {name} | {forces} | {cost} | {int(run.negative_pivots.max())} |"


def main(arguments: list[str]) -> None:
    """Print the tables."""
    name = arguments[0] if arguments else "tensile"
    ratios = np.array([float(a) for a in arguments[1:3]] or [0.5, 0.05])
    print(f"{name}, r = {ratios[0]:g}, s = {ratios[1]:g}, kappa = 1 MPa\n")
    family = models(name)
    travel = family[0].travel
    print("| elements | " + " | ".join(f"F({d:g}) N" for d in travel), end=" | ")
    print("factorisations | s | pivots < 0 |\n|---|" + "---|" * (len(travel) + 3))
    runs = []
    for model in family:
        runs.append(model(ratios))
        print(report(runs[-1], model.cells), flush=True)
    print("\n| elements | " + " | ".join(f"force {d:g} %" for d in travel), end=" | ")
    print(" | ".join(f"field {d:g} mm" for d in travel) + " |")
    print("|---|" + "---|" * (2 * len(travel)))
    for model, run in zip(family[:-1], runs[:-1], strict=True):
        force = 100.0 * (run.force / runs[-1].force - 1.0)
        difference = run.displacement - runs[-1].displacement
        field = np.sqrt(np.mean(difference**2, axis=(1, 2)))
        values = [f"{v:+.3f}" for v in force] + [f"{v:.4f}" for v in field]
        print(f"| {' x '.join(map(str, model.cells))} | " + " | ".join(values) + " |")


if __name__ == "__main__":
    main(sys.argv[1:])
