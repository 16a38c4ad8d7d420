"""Derivatives of an equilibrium in parameters by its converged tangent, direct and adjoint.

At equilibrium the residual R(u, theta, memory(theta)) vanishes, so K du = -(dR at fixed u), where
that includes what the memory of contact carries from earlier steps: exact for the discrete,
path-dependent scheme.  The adjoint replaces one solve for each parameter by one for each scalar,
K' lambda = dq/du; what the memory carries is then still taken forward step by step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.contact_memory import ContactMemory
from fe.linear_solver import SymmetricSolver
from fe.parameters import Parameters
from fe.potential import Assembly, Potential
from fe.whole_tangent import WholeTangent

Array = npt.NDArray[np.float64]

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
    """Solves with the converged tangent: the symmetric factor, or with friction its own."""

    def __init__(self, potential: Potential, solver: SymmetricSolver) -> None:
        problem = potential.problem
        self._potential = potential
        self._solver = solver
        self._whole: WholeTangent | None = None
        if potential.has_friction:
            self._whole = WholeTangent(problem.pattern, problem.faces.nodes)

    def take(self, assembly: Assembly) -> None:
        """Make the last `assemble` of the potential, factorised by the solver, the tangent."""
        if self._whole is not None:
            self._whole.factorise(assembly.data, self._potential.coupling)

    def solve(self, b: Array, *, transposed: bool = False) -> Array:
        """Solution for b (n_free,) or (n_free, k) N, mm."""
        if self._whole is not None:
            return self._whole.solve(b, transposed=transposed)
        return self._solver.solve(b)

    def close(self) -> None:
        """Release MKL's memory."""
        if self._whole is not None:
            self._whole.close()


def partials(
    potential: Potential, u: Array, travel: float, memory: ContactMemory, parameters: Parameters
) -> Partials:
    """Derivatives at fixed u (n_node, 3) mm and travel, mm, by material, mesh and contact."""
    residual, force = potential.contact_partials(u, travel, memory, parameters.surface)
    inner = potential.inner_partials(u, parameters.directions(potential.problem.material))
    changing, moving = parameters.changing, parameters.moving
    residual[:, changing] += inner[:, : changing.size]
    residual += np.outer(inner[:, changing.size], parameters.bulk)
    residual[:, moving] += inner[:, changing.size + 1 :]
    return Partials(residual, force)


def direct(potential: Potential, tangent: Tangent, assembly: Assembly, at: Partials) -> Gradient:
    """Derivatives of displacement and pin force by one solve for each parameter."""
    if at.force.size == 0:
        return Gradient(np.zeros((*potential.problem.elements.positions.shape, 0)), at.force)
    free = tangent.solve(-at.residual)
    force = assembly.pin_force_by_u @ free + at.force
    return Gradient(np.stack([potential.expand(column) for column in free.T], axis=2), force)


def adjoint(
    potential: Potential,
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
