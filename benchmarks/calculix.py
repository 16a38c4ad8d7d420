"""CalculiX (http://www.calculix.de, program ccx): parts of an input deck, and a run of one.

Blocks are of C3D20R, twenty-node bricks with reduced integration: CalculiX has no mixed element for
hyperelasticity, and its eight-node brick locks.  ccx is looked up on the PATH and is no dependency.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from skfem import MeshHex

Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

PROGRAM = "ccx"
TIME_LIMIT = 3600.0
"""s"""
_VERTICES_FROM_SKFEM = [0, 3, 6, 2, 1, 5, 7, 4]
_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)]
_EDGES += [(0, 4), (1, 5), (2, 6), (3, 7)]
"""vertices of the edges whose middle nodes are 9 to 20 of C3D20R"""


class Solved(NamedTuple):
    """What ccx left."""

    printed: str
    """on its terminal"""
    results: str
    """its .dat file"""

    @property
    def version(self) -> str:
        """That ccx says it is of."""
        for line in self.printed.splitlines():
            if "CalculiX Version" in line:
                return line.split("Version")[1].split(",")[0].strip()
        return "of unknown version"

    @property
    def n_iterations(self) -> int:
        """Of all increments."""
        return self.printed.count(" iteration ")


def available() -> bool:
    """Whether ccx is installed."""
    return shutil.which(PROGRAM) is not None


def bricks(mesh: MeshHex) -> tuple[Array, IntArray]:
    """Positions (n_node, 3), mm, and nodes (n_elem, 20) of C3D20R on a mesh of hexahedra."""
    vertices = mesh.t.T[:, _VERTICES_FROM_SKFEM]
    pairs = np.sort(vertices[:, _EDGES].reshape(-1, 2), axis=1)
    edges, number = np.unique(pairs, axis=0, return_inverse=True)
    middle = mesh.p.T[edges].mean(axis=1)
    numbered = mesh.p.shape[1] + number.reshape(len(vertices), 12)
    return np.vstack([mesh.p.T, middle]), np.hstack([vertices, numbered])


def node_lines(positions: Array) -> list[str]:
    """All nodes of a deck, counted from 1."""
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{i}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in enumerate(positions, 1)]
    return lines


def element_lines(kind: str, name: str, nodes: IntArray, first: int = 1) -> list[str]:
    """Elements of a kind as a set of a name; nodes (n_elem, n_a) counted from 0."""
    lines = [f"*ELEMENT, TYPE={kind}, ELSET={name}"]
    for e, row in enumerate(nodes + 1, first):
        lines += [f"{e}, " + ", ".join(map(str, row[:10])) + ("," if row.size > 10 else "")]
        if row.size > 10:
            lines += [", ".join(map(str, row[10:]))]
    return lines


def node_set_lines(name: str, nodes: Iterable[int]) -> list[str]:
    """A set of nodes counted from 0."""
    return [f"*NSET, NSET={name}", *(f"{node + 1}," for node in nodes)]


def rubber_lines(constants: tuple[float, float, float], bulk: float, name: str) -> list[str]:
    """C10, C01, C11 and bulk modulus (MPa) for a set of elements."""
    c10, c01, c11 = constants
    lines = ["*MATERIAL, NAME=SILICONE"]
    # U = sum C_ij (I1bar - 3)^i (I2bar - 3)^j + sum (J - 1)^2i / D_i; N = 2 for C11 only
    if c11 == 0.0:
        lines += ["*HYPERELASTIC, MOONEY-RIVLIN", f"{c10:.12e}, {c01:.12e}, {2.0 / bulk:.12e}"]
    else:
        lines += ["*HYPERELASTIC, POLYNOMIAL, N=2"]
        lines += [f"{c10:.12e}, {c01:.12e}, 0., {c11:.12e}, 0., {2.0 / bulk:.12e}, 1.e12"]
    return [*lines, f"*SOLID SECTION, ELSET={name}, MATERIAL=SILICONE"]


def run(deck: str) -> Solved:
    """Solve a deck with ccx on one thread, to its own tolerances."""
    with tempfile.TemporaryDirectory() as folder:
        job = Path(folder) / "job"
        job.with_suffix(".inp").write_text(deck)
        environment = dict(os.environ, OMP_NUM_THREADS="1", CCX_NPROC_STIFFNESS="1")
        done = subprocess.run(
            [PROGRAM, "-i", "job"],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=TIME_LIMIT,
            check=False,
        )
        results = job.with_suffix(".dat")
        return Solved(done.stdout, results.read_text() if results.exists() else "")


def total_forces(solved: Solved) -> Array:
    """(n,) vertical reaction at the whole steps that were solved, N."""
    at = {}
    lines = solved.results.splitlines()
    for i, line in enumerate(lines):
        if line.strip().startswith("total force") and "and time" in line:
            when = float(line.split("time")[1])
            values = next(row.split() for row in lines[i + 1 :] if row.strip())
            at[round(when, 6)] = float(values[1])
    found = []
    while (step := float(len(found) + 1)) in at:
        found.append(at[step])
    return np.array(found)


def not_solved(solved: Solved, n_step: int) -> RuntimeError:
    """That ccx stopped before `n_step` increments, with the last lines that it printed."""
    tail = "\n".join(solved.printed.splitlines()[-15:])
    return RuntimeError(f"ccx did not solve all {n_step} increments:\n{tail}")


def displacements(solved: Solved, n_step: int, nodes: IntArray) -> Array:
    """(n_step, n, 3) mm of nodes (n,) counted from 0, at the whole steps."""
    found: dict[float, dict[int, list[float]]] = {}
    rows: dict[int, list[float]] = {}
    for line in solved.results.splitlines():
        if line.strip().startswith("displacements") and "and time" in line:
            rows = found.setdefault(round(float(line.split("time")[1]), 6), {})
        elif line.strip().startswith("total force"):
            rows = {}
        elif len(parts := line.split()) == 4:
            rows[int(parts[0]) - 1] = [float(part) for part in parts[1:]]
    return np.array([[found[float(k + 1)][n] for n in nodes] for k in range(n_step)])
