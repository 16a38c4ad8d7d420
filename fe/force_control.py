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
from fe.positive_numbers import as_numbers
from fe.potential import Assembly

Array = npt.NDArray[np.float64]

Control = Literal["travel", "force"]

MAX_TRIALS = 30
JUMP = 1e-9
"""mm of travel between a force that is too small and one that is too large"""
LEAST_TRAVEL = 1e-5
"""mm, below which the energy of a block is lost in rounding"""
FALL = 0.999
"""force relative to that of the step before, below which the force is said to fall"""


JUMPS = "the force jumps past the wanted one"
HOLDS_MORE = "what has stuck holds more than the wanted force"
"""of a force too close to that of the step before: points that touch get their hold in steps"""
SLIVER = 0.1
"""of a step: with so much more of it a wanted force is met, and no short step is left before it"""


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


class Way(NamedTuple):
    """How steps are made and what they lead to."""

    aim: Callable[[Start, float], tuple[Array, Array]]
    """predicts (u, p) at a travel (mm) from a start whose tangent is factorised"""
    attempt: Callable[[tuple[Array, Array], float], Equilibrium]
    """finds the equilibrium at a travel (mm) from what was predicted"""
    accept: Callable[[Found], Start]
    """takes an equilibrium whose tangent is factorised for the next step's start"""
    restore: Callable[[Start], Start]
    """assembles and factorises a start again"""
    control: Control
    tolerance: float
    """to which a wanted force is met, relative"""
    limit: float = np.inf
    """travel, mm, at which nothing is left of the specimen"""


def keep_targets(model: Any) -> None:
    """Make a frozen model's travels (mm) and forces (N) floats; raise ValueError for wrong ones.

    One of them is given, a tuple of finite numbers above 0 that increase. Travels below
    `LEAST_TRAVEL` are refused, as there the energy that the solver goes down on is rounding.
    Numbers of other kinds are made floats: single precision would go into the steps.
    """
    for name in ("travel", "force"):
        values = getattr(model, name)
        numbers = as_numbers(values)
        if not isinstance(values, tuple) or numbers is None or numbers.ndim != 1:
            raise ValueError(
                f"{name}: expected a tuple of numbers, such as (0.5, 1.0), found {values!r}"
            )
        object.__setattr__(model, name, tuple(numbers.tolist()))
    travel, force = model.travel, model.force
    if travel and force:
        raise ValueError(
            f"force: expected travels or forces, found travel={travel} and force={force}"
        )
    name, values, unit = ("force", force, "N") if force else ("travel", travel, "mm")
    found = np.asarray(values)
    finite = found.size > 0 and np.isfinite(found).all()
    if not (finite and found[0] > 0.0 and (np.diff(found) > 0.0).all()):
        raise ValueError(f"{name}: expected increasing {name}s above 0 {unit}, found {values}")
    if not force and found[0] < LEAST_TRAVEL:
        raise ValueError(
            f"travel: expected travels of at least {LEAST_TRAVEL:g} mm, found {found[0]:g} mm"
        )


def step_to_travel(
    solver: SymmetricSolver, way: Way, here: Start, travel: float, target: float
) -> Found:
    """The equilibrium at `travel` (mm) on the way to the travel `target`."""
    found = way.attempt(way.aim(here, travel), travel)
    negative = solver.factorise(found.assembly.data) if found.converged else 0
    return Found(found, travel, negative, travel >= target)


def step_to_force(
    potential: NewtonProblem[Any],
    solver: SymmetricSolver,
    way: Way,
    here: Start,
    far: float,
    target: float,
) -> Found:
    """The equilibrium with the force `target` (N of the modelled part), or that at the travel `far`
    (mm) where the force there is smaller, by more than a little more travel would bring.

    Every trial starts as a step to its travel would, and so finds the same: where something snaps,
    equilibria are not unique.  Where the force falls, or jumps past the wanted one, the equilibrium
    is one that did not converge.
    """
    held = here.assembly
    before = held.pin_force if held is not None else 0.0
    if held is not None and abs(before - target) <= way.tolerance * target:
        met = Equilibrium(here.u, here.p, held, True, "", 0)  # within that of the last one
        return Found(met, here.travel, solver.factorise(held.data), True)
    low, high = here.travel, np.inf
    first = _newton(potential, solver, here, target)[0]  # by the factor of here, which aim may lose
    if held is not None and first <= here.travel:
        return _refused(Equilibrium(here.u, here.p, held, False, "", 0), here.travel, HOLDS_MORE)
    u, p = way.aim(here, far)
    span, travel = far - here.travel, min(far, first)
    for _ in range(MAX_TRIALS):
        part = (travel - here.travel) / span
        start = here.u + part * (u - here.u), here.p + part * (p - here.p)
        found = way.attempt(start, travel)
        if not found.converged:
            return Found(found, travel, 0, False)
        at = Start(found.u, found.p, found.assembly, travel, solver.factorise(found.assembly.data))
        force = found.assembly.pin_force
        if abs(force - target) <= way.tolerance * target:
            return Found(found, travel, at.negative, True)
        better, slope = _newton(potential, solver, at, target)
        if force < target:
            if not slope > 0.0 or force < FALL * before:
                return _refused(found, travel, "the force falls")
            if travel >= far:
                if not (better < way.limit and better - here.travel <= (1.0 + SLIVER) * span):
                    return Found(found, travel, at.negative, False)
                far = better
            low = travel
        else:
            high = travel
        if high - low < JUMP:
            reason = JUMPS if low > here.travel else f"{JUMPS}, or {HOLDS_MORE}"
            return _refused(found, travel, reason)
        travel = min(far, better)
        if not low < travel < high:
            travel = 0.5 * (low + high)
    return _refused(found, travel, "the force was not met")


def _refused(found: Equilibrium, travel: float, reason: str) -> Found:
    return Found(replace(found, converged=False, reason=reason), travel, 0, False)


def _newton(
    potential: NewtonProblem[Any], solver: SymmetricSolver, at: Start, target: float
) -> tuple[float, float]:
    """Travel (mm) where the tangent at `at` meets the force `target` (N), and its slope (N/mm).

    inf where it meets none.
    """
    if at.assembly is None:
        return np.inf, np.inf
    slope = travel_slope(potential, solver, at.assembly)[1]
    if not slope > 0.0:
        return np.inf, slope
    return at.travel + (target - at.assembly.pin_force) / slope, slope


def travel_slope(
    potential: NewtonProblem[Any], solver: SymmetricSolver, assembly: Assembly
) -> tuple[Array, float]:
    """Along the travel at fixed parameters: (d free unknowns (n_free,), dF N/mm).

    `assembly` is the last one assembled, and its tangent is factorised.
    """
    free = solve_coupled(potential, solver, -assembly.by_travel)
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
