"""The full Newton step with friction, which is taken where the residual falls."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from fe.linear_solver import SymmetricSolver
from fe.newton_problem import NewtonProblem
from fe.potential import Assembly

Array = npt.NDArray[np.float64]

Memory = TypeVar("Memory")


class WholeStep(NamedTuple):
    """A full Newton step with friction."""

    along: Array
    """(n_free,) mm"""
    du: Array
    """(n_node, 3) mm, `along` expanded"""
    dp: Array
    """(n_elem, n_p) MPa"""
    trial: Assembly | None
    """what was assembled where it leads, None where it is too long to be tried"""


def whole_step(
    potential: NewtonProblem[Memory],
    solver: SymmetricSolver,
    u: Array,
    p: Array,
    assembly: Assembly,
    travel: float,
    memory: Memory,
    *,
    inexact: float,
    max_move: float,
) -> WholeStep:
    """The full Newton step with friction from the state (u, p) of the last `assemble`.

    Its direction is solved for to a relative residual `inexact`; one that moves a node by
    `max_move` mm or more is not tried.
    """
    b = -assembly.gradient
    along = solver.solve_near(potential.coupled_tangent(), b, inexact)
    du = potential.expand(along)
    dp = potential.pressure_step(du)
    if not np.abs(du).max() < max_move:  # so is NaN
        return WholeStep(along, du, dp, None)
    return WholeStep(along, du, dp, potential.assemble(u + du, p + dp, travel, memory))


def is_nearer(trial: Assembly, here: Assembly, reduction: float) -> bool:
    """Whether a full step with friction is taken: the residual falls to `reduction` of what it was.

    Friction has no energy that decides, and where the frozen one has a maximum along the step, its
    descent and the thaw after it go round in circles.
    """
    reduced = np.linalg.norm(trial.gradient) < reduction * np.linalg.norm(here.gradient)
    return trial.smallest_J > 0.0 and bool(np.isfinite(trial.energy)) and bool(reduced)
