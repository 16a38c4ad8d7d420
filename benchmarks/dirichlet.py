"""Prescribed displacements instead of contact: the product's kernels under plain Newton.

What other codes can solve as well, and what a manufactured solution needs.  The only place of the
benchmarks and cross-code tests that knows how the element kernels are called.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from skfem import Basis, MeshHex

from fe.discretisation import Pattern, add_entries, elements, pattern
from fe.linear_solver import SymmetricSolver
from fe.materials import material
from fe.weak_form import Elements, ElementSystem, element_system, empty_system

Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

Table = Callable[[MeshHex], tuple[Elements, Basis]]
"""elements of a mesh, and the scikit-fem basis they come from"""

TOLERANCE = 1e-8
"""residual norm over the norm of the reactions, the same in every code where it can be set"""


class DirichletProblem:
    """A body whose displacement is prescribed in places; holds the last solution (state).

    `constants` are C10, C01, C11 and `bulk` the bulk modulus, MPa; `table` makes the elements.
    """

    def __init__(
        self, mesh: MeshHex, constants: Array, bulk: float, table: Table = elements
    ) -> None:
        self.elements: Elements
        self.basis: Basis
        self.elements, self.basis = table(mesh)
        self.kernel = material("mooney-rivlin-3", constants, bulk).kernel()
        self.bulk = bulk
        self.u = np.zeros(self.elements.positions.shape)
        self.p = np.zeros((self.elements.nodes.shape[0], self.elements.psi.shape[1]))
        self.system: ElementSystem = empty_system(self.elements)
        self.n_factorisations = 0
        self._fixed = np.zeros(self.u.size, dtype=bool)
        self._pattern: Pattern | None = None
        self._solver: SymmetricSolver | None = None

    def prescribe(self, fixed: BoolArray) -> None:
        """Say which unknowns (n_node, 3) are prescribed, and analyse the matrix structure."""
        self.close()
        self._fixed = fixed.ravel()
        no_faces = np.zeros((0, 9), dtype=np.int64)
        self._pattern = pattern(self.elements.nodes, no_faces, self._fixed)
        self._solver = SymmetricSolver(self._pattern.indptr, self._pattern.indices)

    def close(self) -> None:
        """Release the memory of the factorisation."""
        if self._solver is not None:
            self._solver.close()

    def residual(self) -> Array:
        """(n_node, 3) internal nodal forces at the present state, N; fills the element tangents.

        Raises ArithmeticError when an element is turned inside out.
        """
        energy, _ = element_system(self.u, self.p, self.elements, self.kernel, True, self.system)
        if not np.isfinite(energy):
            raise ArithmeticError("an element turned inside out")
        return self._sum(self.system.residual)

    def factorise(self) -> SymmetricSolver:
        """Assemble and factorise the tangent of the last `residual`."""
        if self._pattern is None or self._solver is None:
            raise RuntimeError("prescribe displacements first")
        data = np.zeros(self._pattern.indices.size)
        add_entries(self.system.tangent, self._pattern.element_slots, data)
        self._solver.factorise(data)
        self.n_factorisations += 1
        return self._solver

    def solve(
        self,
        prescribed: Array,
        load: Array | float = 0.0,
        *,
        tolerance: float = TOLERANCE,
        max_iterations: int = 25,
    ) -> Array:
        """Equilibrium under displacements `prescribed` (n_node, 3), mm, and nodal `load`, N.

        Values of `prescribed` at free unknowns are ignored.  Returns the reactions (n_node, 3), N,
        zero at free unknowns to the tolerance.  Raises ArithmeticError without convergence.
        """
        fixed, free = self._fixed, ~self._fixed
        move = np.zeros_like(self.u)
        move.ravel()[fixed] = (prescribed - self.u).ravel()[fixed]
        unbalanced = self.residual() - load
        for _ in range(max_iterations):
            right = (unbalanced + self._by_move(move)).ravel()[free]
            du = move.copy()
            du.ravel()[free] = self.factorise().solve(-right)
            self.p = self.p + self._pressure_step(du)
            self.u = self.u + du
            move[:] = 0.0
            unbalanced = self.residual() - load
            norm = np.linalg.norm(unbalanced.ravel()[free])
            if norm <= tolerance * np.linalg.norm(unbalanced.ravel()[fixed]):
                return unbalanced
        raise ArithmeticError(f"no equilibrium after {max_iterations} iterations")

    def _sum(self, values: Array) -> Array:
        """(n_node, 3) sum of element vectors (n_elem, n_a, 3)."""
        index = 3 * self.elements.nodes[..., None] + np.arange(3)
        total = np.bincount(index.ravel(), values.ravel(), minlength=self.u.size)
        return total.reshape(-1, 3)

    def _by_move(self, move: Array) -> Array:
        """(n_node, 3) change of the residual with a displacement (n_node, 3)."""
        local = move[self.elements.nodes]
        moved = np.flatnonzero(np.abs(local).max(axis=(1, 2)) > 0.0)
        change = np.zeros(local.shape)
        change[moved] = np.einsum("eaikb,ebk->eai", self.system.tangent[moved], local[moved])
        return self._sum(change)

    def _pressure_step(self, du: Array) -> Array:
        """Pressure increment (n_elem, n_p), MPa, that belongs to du (n_node, 3)."""
        change = np.einsum("emai,eai->em", self.system.coupling, du[self.elements.nodes])
        change += self.system.constraint
        step: Array = self.bulk * np.einsum("emn,en->em", self.elements.mass_inverse, change)
        return step
