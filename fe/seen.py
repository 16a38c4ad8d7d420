"""What is seen of a specimen's solved states: its `Response`, and scalars of it by the adjoint."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from fe.ending import ending
from fe.field_motion import FieldMotion
from fe.force_control import Control
from fe.linear_solver import installed_library
from fe.response import XYZ, Response
from fe.sensitivity import Objective
from fe.steps import March

Array = npt.NDArray[np.float64]

FieldObjective = Callable[[int, Array, float], tuple[Array, float]]
"""(step, displacement (n_point, 3) mm, force N) -> derivatives of a scalar in these two"""


class State(Protocol):
    """A solved state of the modelled part."""

    @property
    def travel(self) -> float:
        """Travel, mm."""
        ...

    @property
    def u(self) -> Array:
        """(n_node, 3) mm."""
        ...

    @property
    def u_gradient(self) -> Array:
        """(n_node, 3, n_p) mm per unit of the parameter."""
        ...

    @property
    def pin_force(self) -> float:
        """Force along the travel, N."""
        ...

    @property
    def force_gradient(self) -> Array:
        """(n_p,) N per unit."""
        ...

    @property
    def travel_gradient(self) -> Array:
        """(n_p,) mm per unit."""
        ...

    @property
    def negative_pivots(self) -> int:
        """Of the tangent."""
        ...

    @property
    def objective_gradient(self) -> Array:
        """(n_p,) of an objective."""
        ...


class Seen(NamedTuple):
    """What is looked at."""

    targets: Array
    """(n_step,) travels, mm, or forces of the whole sample, N, that were asked"""
    control: Control
    """which of the two"""
    points: Array
    """(n_point, 2) mm"""
    probe: sp.csr_matrix
    """(n_point, n_node) nodal values to values at the points"""
    motion: FieldMotion
    factor: float
    """how many of the modelled parts the whole sample has"""
    names: tuple[str, ...]
    """of the parameters"""
    components: tuple[str, str, str] = XYZ
    """of the displacement"""


def response(
    states: Sequence[State], outcome: March, seen: Seen, n_factorisations: int, seconds: float
) -> Response:
    """Forces of the whole sample and the field at the points, with gradients in the names."""
    n_step, n_point, n_p = seen.targets.size, len(seen.points), len(seen.names)
    by_force = seen.control == "force"
    travel = np.full(n_step, np.nan) if by_force else seen.targets.copy()
    travel_gradient = np.full((n_step, n_p), np.nan) if by_force else np.zeros((0, 0))
    force = np.full(n_step, np.nan)
    displacement = np.full((n_step, n_point, 3), np.nan)
    force_gradient = np.full((n_step, n_p), np.nan)
    displacement_gradient = np.full((n_step, n_point, 3, n_p), np.nan)
    negative = np.full(n_step, -1, dtype=np.int64)
    for i, state in enumerate(states):
        travel[i] = state.travel
        if by_force:
            travel_gradient[i] = state.travel_gradient
        force[i] = seen.factor * state.pin_force
        force_gradient[i] = seen.factor * state.force_gradient
        displacement[i] = seen.probe @ state.u
        along = seen.probe @ state.u_gradient.reshape(len(state.u), 3 * n_p)
        displacement_gradient[i] = along.reshape(n_point, 3, n_p) + seen.motion.seen(state.u)
        negative[i] = state.negative_pivots
    end = ending(outcome, seen.control, seen.factor, complete=len(states) == n_step)
    return Response(
        travel=travel,
        force=force,
        displacement=displacement,
        force_gradient=force_gradient,
        displacement_gradient=displacement_gradient,
        reached=end.reached,
        status=end.status,
        message=end.message,
        negative_pivots=negative,
        n_factorisations=n_factorisations,
        seconds=seconds,
        points=seen.points,
        parameters=seen.names,
        solver=installed_library().name,
        travel_gradient=travel_gradient,
        n_steps=outcome.n_steps,
        n_iterations=outcome.n_iterations,
        components=seen.components,
    )


def objective_gradients(
    solve: Callable[[Objective], Sequence[State]], seen: Seen, objective: FieldObjective
) -> Array:
    """(n_step, n_p) derivatives of a scalar of each travel's response, by the adjoint.

    `solve` gives the states reached with the gradients of the objective that it is given.  NaN
    beyond them.  Raises ValueError where forces are asked instead of travels.
    """
    if seen.control == "force":
        raise ValueError(f"force: expected asked travels for the adjoint, found {seen.targets}")
    found = np.full((seen.targets.size, len(seen.names)), np.nan)
    explicit = {}

    def of_state(travel: float, u: Array, force: float) -> tuple[Array, float]:
        step = int(np.argmin(np.abs(seen.targets - travel)))  # asked again where a step is cut
        by_field, by_force = objective(step, seen.probe @ u, seen.factor * force)
        explicit[step] = np.einsum("pi,pij->j", by_field, seen.motion.seen(u))
        return seen.probe.T @ by_field, seen.factor * by_force

    for i, state in enumerate(solve(of_state)):
        found[i] = state.objective_gradient + explicit[i]
    return found
