"""The case that every code can solve: a glued block whose glued top is pressed down.

A quarter of the thesis' block stands glued on its base.  Either its top within half a pin width of
the middle is glued to a rigid flat that moves straight down, with a sharp edge at which the
solution is singular and every code converges slowly in the mesh; or its whole top is glued and
pressed into a smooth dimple.  No contact, so FElupe and CalculiX can solve it as well.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from skfem import MeshHex

from benchmarks.dirichlet import DirichletProblem, Table
from fe.discretisation import elements

Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

SYMMETRY_FACTOR = 4.0
"""a quarter is modelled"""


@dataclass(frozen=True)
class StuckPatch:
    """Quarter of a glued block, lengths in mm."""

    cells: tuple[int, int, int, int]
    """numbers of elements in x under the footprint, in x beside it, in y, in z"""
    travel: tuple[float, ...]
    """mm, increasing: the load steps, the same in every code"""
    constants: tuple[float, float, float] = (0.0075, 0.0075, 0.0)
    """C10, C01, C11, MPa"""
    bulk: float = 6.0
    """MPa; U = bulk / 2 (J - 1)^2"""
    width: float = 5.0
    depth: float = 5.0
    height: float = 2.5
    footprint: float = 2.0
    dimple: bool = False
    """press the whole top into a dimple instead of a footprint"""
    grading: float = 1.0
    """1 is uniform; above, elements shrink as a power towards the singular edges"""
    distortion: float = 0.0
    """largest move of an inner mesh vertex, as a fraction of the mean element size"""

    def mesh(self) -> MeshHex:
        """Hexahedra with a mesh line along the footprint's edge."""
        inner, outer, ny, nz = self.cells
        towards_end = [1.0 - (1.0 - np.linspace(0, 1, n + 1)) ** self.grading for n in (inner, nz)]
        from_start = np.linspace(0, 1, outer + 1) ** self.grading
        s = np.linspace(-1.0, 1.0, ny + 1)
        x = np.concatenate(
            [
                self.footprint * towards_end[0],
                self.footprint + (self.width - self.footprint) * from_start[1:],
            ]
        )
        y = self.height * 0.5 * (1.0 + np.sign(s) * (1.0 - (1.0 - np.abs(s)) ** self.grading))
        mesh = MeshHex.init_tensor(x, y, self.depth * towards_end[1])
        if self.distortion == 0.0:
            return mesh
        size = np.array([[self.width], [self.height], [self.depth]])
        inside = np.all((mesh.p > 1e-9) & (mesh.p < size - 1e-9), axis=0)
        count = np.array([[inner + outer], [ny], [nz]])
        move = np.random.default_rng(0).uniform(-1.0, 1.0, (3, int(inside.sum())))
        p = mesh.p.copy()
        p[:, inside] += self.distortion * (size / count) * move
        return MeshHex(p, mesh.t)

    def fixed(self, positions: Array) -> tuple[BoolArray, BoolArray]:
        """Prescribed unknowns (n_node, 3), and the pressed nodes (n_node,) among them."""
        x, y, z = positions.T
        pressed = (y > self.height - 1e-9) & (self.dimple | (x < self.footprint + 1e-9))
        fixed = np.zeros(positions.shape, dtype=bool)
        fixed[x < 1e-9, 0] = True
        fixed[z < 1e-9, 2] = True
        fixed[(y < 1e-9) | pressed] = True
        return fixed, pressed

    def prescribed(self, positions: Array, travel: float) -> Array:
        """(n_node, 3) displacement of the prescribed unknowns at a travel, zero elsewhere, mm."""
        _, pressed = self.fixed(positions)
        u = np.zeros(positions.shape)
        u[pressed, 1] = -travel
        if self.dimple:
            angle = 0.5 * np.pi * positions[pressed][:, [0, 2]] / np.array([self.width, self.depth])
            u[pressed, 1] *= np.prod(np.cos(angle) ** 2, axis=1)
        return u


@dataclass(frozen=True)
class PatchRun:
    """What one code made of the case."""

    code: str
    n_unknowns: int
    """free displacements"""
    force: Array
    """(n_step,) of the whole block, N, positive in compression"""
    seconds: float
    """mesh and matrix structure included, imports and compilation not"""
    n_iterations: int

    def error_percent(self, reference: Array) -> float:
        """Largest difference of the force from a reference (n_step,), % of that step's."""
        return float(100.0 * np.abs(self.force / reference - 1.0).max())


def press(case: StuckPatch, table: Table = elements, code: str = "softcal Q2/P1") -> PatchRun:
    """Solve with the product's assembly and factorisation, by default with its elements.

    Raises ArithmeticError when an increment does not converge.
    """
    started = time.perf_counter()
    problem = DirichletProblem(case.mesh(), np.array(case.constants), case.bulk, table)
    positions = problem.elements.positions
    fixed, pressed = case.fixed(positions)
    problem.prescribe(fixed)
    try:
        reactions = [problem.solve(case.prescribed(positions, t)) for t in case.travel]
    finally:
        problem.close()
    return PatchRun(
        code=code,
        n_unknowns=int((~fixed).sum()),
        force=np.array([-SYMMETRY_FACTOR * r[pressed, 1].sum() for r in reactions]),
        seconds=time.perf_counter() - started,
        n_iterations=problem.n_factorisations,
    )


def uniform(case: StuckPatch, n: int) -> StuckPatch:
    """The case on n x 2n x 2n elements as in the thesis' Table 3.7 (n along the height)."""
    return replace(case, cells=(round(0.8 * n), 2 * n - round(0.8 * n), n, 2 * n))
