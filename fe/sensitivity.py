"""Derivatives of an equilibrium in parameters by its converged tangent, direct and adjoint.

At equilibrium the residual R(u, theta, memory(theta)) vanishes, so K du = -(dR at fixed u), where
that includes what the memory of contact carries from earlier steps: exact for the discrete,
path-dependent scheme.  The adjoint replaces one solve for each parameter by one for each scalar,
K' lambda = dq/du; what the memory carries is then still taken forward step by step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fe.contact_memory import ContactMemory
from fe.directions import Directions
from fe.linear_solver import SymmetricSolver
from fe.newton_problem import NewtonProblem
from fe.parameters import Parameters
from fe.potential import Assembly, Potential
from fe.surface_slopes import SurfaceSlopes

Array = npt.NDArray[np.float64]

ACCURACY = 1e-9
"""of a solution with friction, its residual relative to the load"""

Objective = Callable[[float, Array, float], tuple[Array, float]]
"""(travel mm, u (n_node, 3) mm, pin force N) -> derivatives of a scalar: (in u (n_node, 3), in the
pin force)"""


class Partials(NamedTuple):
    """Derivatives at fixed displacement."""

    residual: Array
    """(n_free, n_p) of the gradient of the potential, N per unit"""
    force: Array
    """(n_p,) of the pin force, N per unit"""


class Gradient(NamedTuple):
    """Total derivatives of one state."""

    u: Array
    """(n_node, 3, n_p) mm per unit"""
    force: Array
    """(n_p,) of the pin force of the modelled part, N per unit"""


class Tangent:
    """Solves with the tangent of the potential's last `assemble`, friction's coupling included."""

    def __init__(self, potential: NewtonProblem[Any], solver: SymmetricSolver) -> None:
        self._potential = potential
        self._solver = solver

    def solve(self, b: Array, *, transposed: bool = False) -> Array:
        """Solution for b (n_free,) or (n_free, k) N, mm.

        Without friction the solver must hold the tangent's factor.  With it NaN where the residual
        of one mix of the columns is above `ACCURACY`, relative.  Columns of zeros cost nothing.
        """
        if b.ndim == 1:
            return self._solve(b, transposed)
        loaded = b.any(axis=0)
        if loaded.all():
            return self._solve(b, transposed)
        x = np.zeros(b.shape)
        if loaded.any():
            x[:, loaded] = self._solve(b.T[loaded].T, transposed)  # columns, as solvers take them
        return x

    def _solve(self, b: Array, transposed: bool) -> Array:
        if not self._potential.has_friction:
            return self._solver.solve(b)
        matrix = self._potential.coupled_tangent()
        x = self._solver.solve_general(matrix, b, transposed=transposed)
        n, whole = len(b), matrix.sparse()
        mix = np.cos(np.arange(b.reshape(n, -1).shape[1]))
        one, load = (part.reshape(n, -1) @ mix for part in (x, b))
        missed = (whole.T if transposed else whole) @ one - load
        good = np.linalg.norm(missed) <= ACCURACY * np.linalg.norm(load)
        return x if good else np.full(x.shape, np.nan)


def partials(
    potential: Potential,
    u: Array,
    travel: float,
    memory: ContactMemory,
    parameters: Parameters[SurfaceSlopes],
    along: Directions,
) -> Partials:
    """Derivatives at fixed u (n_node, 3) mm and travel, mm, by material, mesh and contact.

    `along` is what the parameters take the inner forces along.
    """
    if not parameters.names:
        return Partials(np.zeros((potential.n_unknowns, 0)), np.zeros(0))
    residual, force = potential.contact_partials(u, travel, memory, parameters.surface)
    parameters.add_inner(residual, potential.inner_partials(u, along))
    return Partials(residual, force)


def direct(
    potential: NewtonProblem[Any], tangent: Tangent, assembly: Assembly, at: Partials
) -> Gradient:
    """Derivatives of displacement and pin force by one solve for each parameter."""
    if at.force.size == 0:
        return Gradient(np.zeros((*potential.zero_state()[0].shape, 0)), at.force)
    free = tangent.solve(-at.residual)
    force = assembly.pin_force_by_u @ free + at.force
    return Gradient(potential.expand(free), force)


def adjoint(
    potential: NewtonProblem[Any],
    tangent: Tangent,
    assembly: Assembly,
    at: Partials,
    by_u: Array,
    by_force: float,
) -> Array:
    """(n_p,) derivative of a scalar by one transposed solve.

    `by_u` (n_node, 3) and `by_force` are its derivatives in displacement and pin force.
    """
    load = potential.restrict(by_u) + by_force * assembly.pin_force_by_u
    multiplier = tangent.solve(load, transposed=True)
    gradient: Array = by_force * at.force - multiplier @ at.residual
    return gradient
