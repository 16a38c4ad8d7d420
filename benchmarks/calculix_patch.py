"""`StuckPatch` solved by CalculiX (http://www.calculix.de, program ccx) with element C3D20R.

Twenty-node bricks with reduced integration: CalculiX has no mixed element for hyperelasticity, and
its eight-node brick locks.  The test writes the input deck and reads the reactions; ccx is looked
up on the PATH and is no dependency.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.stuck_patch import SYMMETRY_FACTOR, PatchRun, StuckPatch

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

PROGRAM = "ccx"
TIME_LIMIT = 600.0
"""s"""

MAX_CUTS = 100
"""increments that ccx may take in a step when it has to cut it"""
_VERTICES_FROM_SKFEM = [0, 3, 6, 2, 1, 5, 7, 4]
_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)]
_EDGES += [(0, 4), (1, 5), (2, 6), (3, 7)]
"""vertices of the edges whose middle nodes are 9 to 20 of C3D20R"""


def available() -> bool:
    """Whether ccx is installed."""
    return shutil.which(PROGRAM) is not None


def bricks(case: StuckPatch) -> tuple[Array, IntArray]:
    """Positions (n_node, 3), mm, and nodes (n_elem, 20) of C3D20R on the case's mesh."""
    mesh = case.mesh()
    vertices = mesh.t.T[:, _VERTICES_FROM_SKFEM]
    pairs = np.sort(vertices[:, _EDGES].reshape(-1, 2), axis=1)
    edges, number = np.unique(pairs, axis=0, return_inverse=True)
    middle = mesh.p.T[edges].mean(axis=1)
    numbered = mesh.p.shape[1] + number.reshape(len(vertices), 12)
    return np.vstack([mesh.p.T, middle]), np.hstack([vertices, numbered])


def deck(case: StuckPatch) -> str:
    """Input of CalculiX: a static step an increment, each prints the pressed nodes' reaction."""
    positions, nodes = bricks(case)
    fixed, pressed = case.fixed(positions)
    glued = fixed.all(axis=1) & ~pressed
    c10, c01, c11 = case.constants
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{i}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in enumerate(positions, 1)]
    lines += ["*ELEMENT, TYPE=C3D20R, ELSET=BLOCK"]
    for e, row in enumerate(nodes + 1, 1):
        lines += [f"{e}, " + ", ".join(map(str, row[:10])) + ","]
        lines += [", ".join(map(str, row[10:]))]
    for name, members in (
        ("BASE", glued),
        ("PRESSED", pressed),
        ("MIDDLEX", fixed[:, 0] & ~glued & ~pressed),
        ("MIDDLEZ", fixed[:, 2] & ~glued & ~pressed),
    ):
        lines += [f"*NSET, NSET={name}", *(f"{i}," for i in np.flatnonzero(members) + 1)]
    lines += ["*MATERIAL, NAME=SILICONE"]
    # U = sum C_ij (I1bar - 3)^i (I2bar - 3)^j + sum (J - 1)^2i / D_i; N = 2 for C11 only
    if c11 == 0.0:
        lines += ["*HYPERELASTIC, MOONEY-RIVLIN", f"{c10:.12e}, {c01:.12e}, {2.0 / case.bulk:.12e}"]
    else:
        lines += ["*HYPERELASTIC, POLYNOMIAL, N=2"]
        lines += [f"{c10:.12e}, {c01:.12e}, 0., {c11:.12e}, 0., {2.0 / case.bulk:.12e}, 1.e12"]
    lines += ["*SOLID SECTION, ELSET=BLOCK, MATERIAL=SILICONE"]
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
    with tempfile.TemporaryDirectory() as folder:
        job = Path(folder) / "patch"
        job.with_suffix(".inp").write_text(deck(case))
        environment = dict(os.environ, OMP_NUM_THREADS="1", CCX_NPROC_STIFFNESS="1")
        done = subprocess.run(
            [PROGRAM, "-i", "patch"],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=TIME_LIMIT,
            check=False,
        )
        printed = done.stdout
        results = job.with_suffix(".dat")
        force = _total_reactions(results.read_text() if results.exists() else "", len(case.travel))
    if force is None:
        tail = "\n".join(printed.splitlines()[-15:])
        raise RuntimeError(f"ccx did not solve all {len(case.travel)} increments:\n{tail}")
    positions, _ = bricks(case)
    fixed, _ = case.fixed(positions)
    return PatchRun(
        code=f"CalculiX {_version(printed)} C3D20R",
        n_unknowns=int(positions.size - fixed.sum()),
        force=-SYMMETRY_FACTOR * force,
        seconds=time.perf_counter() - started,
        n_iterations=printed.count(" iteration "),
    )


def _total_reactions(text: str, n_step: int) -> Array | None:
    """(n_step,) vertical reaction at the whole steps, N; None when some are missing."""
    at = {}
    lines = text.splitlines()
    for i, line in enumerate(lines):
        if line.strip().startswith("total force") and "and time" in line:
            when = float(line.split("time")[1])
            values = next(row.split() for row in lines[i + 1 :] if row.strip())
            at[round(when, 6)] = float(values[1])
    wanted = [float(k + 1) for k in range(n_step)]
    return np.array([at[t] for t in wanted]) if all(t in at for t in wanted) else None


def _version(printed: str) -> str:
    for line in printed.splitlines():
        if "CalculiX Version" in line:
            return line.split("Version")[1].split(",")[0].strip()
    return "of unknown version"
