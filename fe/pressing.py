"""A discretised body under a pin, marched from travel 0 to what is asked."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.contact_memory import initial_memory
from fe.force_control import Control
from fe.linear_solver import SymmetricSolver
from fe.load_stepping import TravelState, march
from fe.newton import NewtonOptions
from fe.parameters import Parameters, at_rest
from fe.potential import Potential, Problem
from fe.progress import Progress
from fe.sensitivity import Objective
from fe.steps import March, StepOptions
from fe.surface_slopes import SurfaceSlopes
from fe.ties import Stick


class Pressed(NamedTuple):
    """What is pressed and how."""

    problem: Problem
    glued: npt.NDArray[np.bool_]
    """(n_face, n_q) points that are tied to the pin from the start"""
    stick: Stick
    targets: tuple[float, ...]
    """travels, mm, or forces of the modelled part, N"""
    control: Control
    """which of the two"""
    steps: StepOptions
    newton: NewtonOptions
    doubt: str = ""
    """what may be wrong with all that is found"""


def press(
    pressed: Pressed,
    along: Parameters[SurfaceSlopes],
    objective: Objective | None,
    listen: Progress | None,
) -> tuple[list[TravelState], March, int]:
    """States at the targets reached, outcome, number of factorisations; see `fe.load_stepping`."""
    problem = pressed.problem
    memory = initial_memory(
        problem.faces, pressed.glued, problem.pin, along.surface, at_rest(along)
    )
    solver = SymmetricSolver(problem.pattern.indptr, problem.pattern.indices)
    outcome = March(listen=listen)
    if pressed.doubt:
        outcome.warn("doubt", pressed.doubt)
    try:
        states = list(
            march(
                Potential(problem),
                solver,
                memory,
                pressed.targets,
                outcome,
                parameters=along,
                stick=pressed.stick,
                steps=pressed.steps,
                newton=pressed.newton,
                control=pressed.control,
                objective=objective,
            )
        )
    finally:
        solver.close()
    return states, outcome, solver.n_factorisations
