"""`StuckPatch` solved by CalculiX with element C3D20R, see `benchmarks.calculix`.

The test writes the input deck and reads the reactions.
"""

from __future__ import annotations

import time

import numpy as np

from benchmarks.calculix import (
    available,
    bricks,
    element_lines,
    node_lines,
    node_set_lines,
    not_solved,
    rubber_lines,
    run,
    total_forces,
)
from benchmarks.stuck_patch import SYMMETRY_FACTOR, PatchRun, StuckPatch

__all__ = ["available", "deck", "press"]

MAX_CUTS = 100
"""increments that ccx may take in a step when it has to cut it"""


def deck(case: StuckPatch) -> str:
    """Input of CalculiX: a static step an increment, each prints the pressed nodes' reaction."""
    positions, nodes = bricks(case.mesh())
    fixed, pressed = case.fixed(positions)
    glued = fixed.all(axis=1) & ~pressed
    lines = [*node_lines(positions), *element_lines("C3D20R", "BLOCK", nodes)]
    for name, members in (
        ("BASE", glued),
        ("PRESSED", pressed),
        ("MIDDLEX", fixed[:, 0] & ~glued & ~pressed),
        ("MIDDLEZ", fixed[:, 2] & ~glued & ~pressed),
    ):
        lines += node_set_lines(name, np.flatnonzero(members).tolist())
    lines += rubber_lines(case.constants, case.bulk, "BLOCK")
    lines += ["*BOUNDARY", "BASE, 1, 3", "MIDDLEX, 1", "MIDDLEZ, 3", "PRESSED, 1", "PRESSED, 3"]
    for travel in case.travel:
        lines += [f"*STEP, NLGEOM, INC={MAX_CUTS}", "*STATIC, SOLVER=SPOOLES", "1., 1."]
        down = case.prescribed(positions, travel)[:, 1]
        lines += ["*BOUNDARY"]
        lines += [f"{i + 1}, 2, 2, {down[i]:.12e}" for i in np.flatnonzero(pressed)]
        lines += ["*NODE PRINT, NSET=PRESSED, TOTALS=ONLY", "RF", "*END STEP"]
    return "\n".join(lines) + "\n"


def press(case: StuckPatch) -> PatchRun:
    """Solve with ccx on one thread, to its own tolerances.

    Raises RuntimeError when ccx fails, with the last lines that it printed.
    """
    started = time.perf_counter()
    solved = run(deck(case))
    force = total_forces(solved)
    if force.size < len(case.travel):
        raise not_solved(solved, len(case.travel))
    positions, _ = bricks(case.mesh())
    fixed, _ = case.fixed(positions)
    return PatchRun(
        code=f"CalculiX {solved.version} C3D20R",
        n_unknowns=int(positions.size - fixed.sum()),
        force=-SYMMETRY_FACTOR * force,
        seconds=time.perf_counter() - started,
        n_iterations=solved.n_iterations,
    )
