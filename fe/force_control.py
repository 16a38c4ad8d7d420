"""Steps to a wanted force instead of a wanted travel, and what depends on what at that force.

The solver goes on in travel.  Where the force passes the wanted one within a step, the travel with
that force is sought from the same memory of contact, which only an accepted step changes: Newton on
force(travel) with the slope of the converged tangent, kept within a bracket.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from fe.linear_solver import SymmetricSolver
from fe.newton import Equilibrium, solve_coupled
from fe.newton_problem import NewtonProblem
from fe.potential import Assembly

Array = npt.NDArray[np.float64]

Control = Literal["travel", "force"]

SLOPE_TOLERANCE = 1e-8
"""relative residual of the linear systems that friction makes unsymmetric"""
MAX_TRIALS = 30
FALL = 0.99
"""force relative to that of the step before, below which the force is said to fall: points that
are tied where they touch lose a little of their penalty, so it is not 1"""


class Start(NamedTuple):
    """A converged state from which a step goes."""

    u: Array
    """(n_node, 3) mm"""
    p: Array
    """(n_elem, n_p) MPa"""
    assembly: Assembly | None
    """None at rest; its tangent is the one that is factorised"""
    travel: float
    """mm"""
    negative: int
    """negative pivots"""


class Found(NamedTuple):
    """Where a step ended, accepted or not."""

    equilibrium: Equilibrium
    travel: float
    """mm"""
    negative: int
    """negative pivots of its tangent, which is factorised; 0 where it did not converge"""
    arrived: bool
    """whether this is the wanted travel or force"""

    def as_start(self) -> Start:
        """The next step's."""
        at = self.equilibrium
        return Start(at.u, at.p, at.assembly, self.travel, self.negative)


class Goal(NamedTuple):
    """A wanted force."""

    force: float
    """N, of the modelled part"""
    tolerance: float
    """relative"""


Attempt = Callable[[Start, float], Equilibrium]
"""equilibrium at a travel (mm), predicted from a start"""


def check_targets(travel: tuple[float, ...], force: tuple[float, ...]) -> None:
    """Raise ValueError unless one of travels (mm) and forces (N) is given, above 0, increasing."""
    if travel and force:
        raise ValueError(
            f"force: expected travels or forces, found travel={travel} and force={force}"
        )
    name, values, unit = ("force", force, "N") if force else ("travel", travel, "mm")
    found = np.asarray(values)
    if found.size == 0 or not found[0] > 0.0 or not (np.diff(found) > 0.0).all():
        raise ValueError(f"{name}: expected increasing {name}s above 0 {unit}, found {values}")


def step_to_travel(
    solver: SymmetricSolver, attempt: Attempt, here: Start, travel: float, target: float
) -> Found:
    """The equilibrium at `travel` (mm) on the way to the travel `target`."""
    found = attempt(here, travel)
    negative = solver.factorise(found.assembly.data) if found.converged else 0
    return Found(found, travel, negative, travel >= target)


def step_to_force(
    potential: NewtonProblem[Any],
    solver: SymmetricSolver,
    attempt: Attempt,
    here: Start,
    far: float,
    goal: Goal,
) -> Found:
    """The equilibrium with the wanted force, or at the travel `far` (mm) where that is smaller.

    Where the force falls instead, the equilibrium is one that did not converge.
    """
    target = goal.force
    before = here.assembly.pin_force if here.assembly is not None else 0.0
    low, high, at = here.travel, np.inf, here
    travel = min(far, _newton(potential, solver, here, target))
    for _ in range(MAX_TRIALS):
        found = attempt(at, travel)
        if not found.converged:
            return Found(found, travel, 0, False)
        negative = solver.factorise(found.assembly.data)
        at = Start(found.u, found.p, found.assembly, travel, negative)
        force = found.assembly.pin_force
        if abs(force - target) <= goal.tolerance * target:
            return Found(found, travel, negative, True)
        if force < target:
            slope = travel_slope(potential, solver, found.assembly)[1]
            if not slope > 0.0 or force < FALL * before:
                return _refused(found, travel, "the force falls")
            if travel >= far:
                return Found(found, travel, negative, False)
            low = travel
        else:
            high = travel
        travel = min(far, _newton(potential, solver, at, target))
        if not low < travel < high:
            travel = 0.5 * (low + high)
    return _refused(found, travel, "the force was not met")


def _refused(found: Equilibrium, travel: float, reason: str) -> Found:
    return Found(replace(found, converged=False, reason=reason), travel, 0, False)


def _newton(
    potential: NewtonProblem[Any], solver: SymmetricSolver, at: Start, target: float
) -> float:
    """Travel (mm) where the tangent at `at` meets the force `target` (N); inf where none does."""
    if at.assembly is None:
        return np.inf
    slope = travel_slope(potential, solver, at.assembly)[1]
    return at.travel + (target - at.assembly.pin_force) / slope if slope > 0.0 else np.inf


def travel_slope(
    potential: NewtonProblem[Any], solver: SymmetricSolver, assembly: Assembly
) -> tuple[Array, float]:
    """Along the travel at fixed parameters: (d free unknowns (n_free,), dF N/mm).

    `assembly` is the last one assembled, and its tangent is factorised.
    """
    free = solve_coupled(potential, solver, -assembly.by_travel, SLOPE_TOLERANCE)
    return free, float(assembly.pin_force_by_travel + assembly.pin_force_by_u @ free)


class Sensitivity(NamedTuple):
    """Derivatives of a state in the n_p parameters."""

    u: Array
    """(n_node, 3, n_p) mm"""
    force: Array
    """(n_p,) N"""
    travel: Array
    """(n_p,) mm, 0 where the travel is prescribed"""


def at_moving_travel(
    fixed: Sensitivity, u_slope: Array, force_slope: float, before: Array, *, meets: bool
) -> Sensitivity:
    """Derivatives of a step whose travel depends on the parameters, from those at fixed travel.

    `u_slope` (n_node, 3) and `force_slope` (N/mm) are derivatives in the travel.  A step that
    `meets` the wanted force keeps that force; the others are made of travels counted from the last
    that did, whose derivative `before` (n_p,) they share.
    """
    travel = -fixed.force / force_slope if meets else before
    force = np.zeros_like(fixed.force) if meets else fixed.force + force_slope * travel
    return Sensitivity(fixed.u + u_slope[..., None] * travel, force, travel)
