"""Force and front-face field of the thesis specimen on ever finer meshes, as a Markdown table.

    python -m benchmarks.mesh_convergence [stick|slide|COEFFICIENT OF FRICTION] [r s]

Runs one mesh after the other in one process with one thread, at kappa = 1 MPa, and prints the
difference of each from the finest: force in %, field as RMS over the 840 points in mm.
"""

from __future__ import annotations

import sys
import time
from typing import cast

import numpy as np

from fe import BlockPin, BlockPinModel, Contact, Response
from fe.specimens.block_pin import Interface

TRAVEL = (0.6, 0.8, 1.0, 1.2, 1.4)
MESHES = ((8, 4, 2), (12, 4, 2), (16, 5, 2), (22, 7, 2), (24, 8, 3), (32, 10, 3))


def solve(interface: Interface, cells: tuple[int, int, int], ratios: np.ndarray) -> Response:
    """The thesis specimen with the same interface on pin and base."""
    model = BlockPinModel(BlockPin(), Contact(interface, interface), cells, TRAVEL)
    return model(ratios)


def main(arguments: list[str]) -> None:
    """Print the table."""
    contact = arguments[0] if arguments else "slide"
    interface = cast(Interface, contact if contact in ("stick", "slide") else float(contact))
    ratios = np.array([float(a) for a in arguments[1:3]] or [0.5, 0.05])
    print(f"{interface}, r = {ratios[0]:g}, s = {ratios[1]:g}, kappa = 1 MPa\n")
    print("| elements | " + " | ".join(f"F({d}) N" for d in TRAVEL) + " | s | pivots < 0 |")
    print("|---|" + "---|" * (len(TRAVEL) + 2))
    runs = []
    for cells in MESHES:
        start = time.perf_counter()
        run = solve(interface, cells, ratios)
        runs.append(run)
        forces = " | ".join(f"{f:.2f}" for f in run.force)
        seconds = time.perf_counter() - start
        name = " x ".join(map(str, cells))
        print(
            f"| {name} | {forces} | {seconds:.0f} | {int(run.negative_pivots.max())} |", flush=True
        )
    finest = runs[-1]
    print("\n| elements | " + " | ".join(f"force {d} %" for d in TRAVEL), end=" | ")
    print(" | ".join(f"field {d} mm" for d in TRAVEL) + " |")
    print("|---|" + "---|" * (2 * len(TRAVEL)))
    for cells, run in zip(MESHES[:-1], runs[:-1], strict=True):
        force = 100.0 * (run.force / finest.force - 1.0)
        field = np.sqrt(np.mean((run.displacement - finest.displacement) ** 2, axis=(1, 2)))
        values = [f"{v:+.2f}" for v in force] + [f"{v:.4f}" for v in field]
        print(f"| {' x '.join(map(str, cells))} | " + " | ".join(values) + " |")


if __name__ == "__main__":
    main(sys.argv[1:])
