"""March the pin from 0 to the asked travels, with predictor, step control and sensitivities."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fe.contact_memory import ContactMemory, slide_anchors, tie_touching
from fe.directions import Directions
from fe.force_control import (
    FALL,
    Control,
    Found,
    Sensitivity,
    Start,
    Way,
    at_moving_travel,
    travel_slope,
)
from fe.linear_solver import SymmetricSolver
from fe.newton import Equilibrium, NewtonOptions, descent_direction, equilibrate
from fe.parameters import Parameters
from fe.pin_contact import COMPLIANCE, doubts
from fe.potential import Potential
from fe.sensitivity import Gradient, Objective, Tangent, adjoint, direct, partials
from fe.steps import March, StepOptions, stride
from fe.surface_slopes import SurfaceSlopes
from fe.ties import Stick

Array = npt.NDArray[np.float64]

SHORT = 1e-3
"""mm of travel below which a step does not tell how the force grows"""


@dataclass(frozen=True)
class TravelState:
    """Converged solution at one asked travel (of the modelled part, not of the whole sample)."""

    travel: float
    """mm"""
    u: Array
    """(n_node, 3) mm"""
    u_gradient: Array
    """(n_node, 3, n_p) du/d parameter, mm, at the asked travel or the asked force;
    (n_node, 3, 0) where an objective's gradient was asked"""
    pin_force: float
    """N"""
    force_gradient: Array
    """(n_p,) dF/d parameter, N, 0 where the force was asked; (0,) where an objective's gradient
    was asked"""
    travel_gradient: Array
    """(n_p,) dtravel/d parameter, mm; 0 where the travel was asked"""
    energy: float
    """stored energy with the contact's, N mm"""
    friction_work: float
    """energy that friction has taken up to here, N mm"""
    negative_pivots: int
    objective_gradient: Array
    """(n_p,) of the objective, (0,) without one"""


def march(
    potential: Potential,
    solver: SymmetricSolver,
    memory: ContactMemory,
    targets: Sequence[float],
    outcome: March,
    *,
    parameters: Parameters[SurfaceSlopes],
    stick: Stick,
    steps: StepOptions,
    newton: NewtonOptions,
    control: Control = "travel",
    objective: Objective | None = None,
) -> Iterator[TravelState]:
    """Yield the solution at each target (increasing) until one cannot be reached.

    Targets are travels, mm, or with `control` "force" forces of the modelled part, N.
    Sensitivities are in `parameters`, of all displacements or, by the adjoint, of an `objective`
    at asked travels; they are taken where the memory of contact or the caller needs them.
    What happened is left in `outcome`: the travel reached and, when the march stopped early, why.
    """
    tangent = Tangent(potential, solver)
    inner = parameters.directions(potential.problem.material, potential.problem.elements)
    history = History(memory, parameters, inner, stick, control, objective)
    yield from _march(potential, solver, tangent, history, targets, outcome, steps, newton)


@dataclass(frozen=True)
class History:
    """What steps remember and how that depends on the parameters."""

    memory: ContactMemory
    parameters: Parameters[SurfaceSlopes]
    inner: Directions
    """what the parameters take the forces of the solid along"""
    stick: Stick
    control: Control
    objective: Objective | None


def _march(
    potential: Potential,
    solver: SymmetricSolver,
    tangent: Tangent,
    history: History,
    targets: Sequence[float],
    outcome: March,
    steps: StepOptions,
    newton: NewtonOptions,
) -> Iterator[TravelState]:
    memory = history.memory
    state: TravelState | None = None
    growth = 0.0

    def aim(start: Start, travel: float) -> tuple[Array, Array]:
        return _predict(potential, solver, start, travel, memory, newton)

    def attempt(start: tuple[Array, Array], travel: float) -> Equilibrium:
        return equilibrate(potential, solver, *start, travel, memory, newton)

    def accept(found: Found) -> Start:
        """Keep a converged step: its state and warnings; the start of the next one."""
        nonlocal state, growth
        before = state
        state = _accept(potential, solver, tangent, found, history, before)
        growth = _growth(before, found, state, growth)
        if before is not None and state.pin_force < FALL * before.pin_force:
            outcome.warn(
                "fall",
                f"the force falls at a travel of {found.travel:.4f} mm: material snaps past the "
                "pin's edge, or the block bends into another shape",
            )
        outcome.jump(found, leaves=False)
        if found.arrived:
            problem = potential.problem
            contact = (problem.faces, memory.ties.kind, found.travel, problem.pin)
            for kind, doubt in doubts(state.u, *contact, growth):
                outcome.warn(kind, doubt, latest=kind == COMPLIANCE)
        if not np.isfinite(state.force_gradient).all():
            lost = f"no derivatives from a travel of {found.travel:.4f} mm on"
            outcome.warn("derivatives", lost)
        return found.as_start()

    def restore(start: Start) -> Start:
        if start.assembly is None:
            return start
        assembly = potential.assemble(start.u, start.p, start.travel, memory)
        return start._replace(assembly=assembly, negative=solver.factorise(assembly.data))

    here = Start(*potential.zero_state(), None, 0.0, 0)
    limit = potential.problem.pin.height
    way = Way(aim, attempt, accept, restore, history.control, newton.tolerance, limit)
    for _ in stride(potential, solver, way, here, targets, steps, outcome):
        assert state is not None
        yield state


def _growth(before: TravelState | None, found: Found, state: TravelState, last: float) -> float:
    """Growth of the force by the travel since the state before, over the force, 1/mm.

    It stays the `last` where the step says little of it: a short one, whose force is what sticking
    adds after the step before, and one past unstable states.
    """
    if before is None or found.equilibrium.jump > 0.0:
        return last
    step, gained = state.travel - before.travel, state.pin_force - before.pin_force
    if step < SHORT or not gained > 0.0:
        return last
    return gained / step / state.pin_force


def _accept(
    potential: Potential,
    solver: SymmetricSolver,
    tangent: Tangent,
    found: Found,
    history: History,
    before: TravelState | None,
) -> TravelState:
    """State of the equilibrium `found`, whose tangent is factorised; updates the memory.

    Its gradients are empty where neither the caller nor the memory need them.  `before` is the
    state of the step before.
    """
    problem, memory = potential.problem, history.memory
    u, travel, assembly = found.equilibrium.u, found.travel, found.equilibrium.assembly
    slopes = history.parameters.surface
    sticks = any(history.stick)
    remembers = potential.has_friction or sticks
    moved = np.zeros(slopes.height.size) if before is None else before.travel_gradient
    gradient = Gradient(np.zeros((*u.shape, 0)), np.zeros(0))
    by_objective = np.zeros(0)
    if remembers or found.arrived:
        at = partials(potential, u, travel, memory, history.parameters, history.inner)
        if remembers or history.objective is None:
            gradient = direct(potential, tangent, assembly, at)
            if history.control == "force":
                gradient, moved = _at_moving_travel(potential, solver, found, gradient, moved)
        if found.arrived and history.objective is not None:
            by = history.objective(travel, u, assembly.pin_force)
            by_objective = adjoint(potential, tangent, assembly, at, *by)
    energy = potential.energy(u, travel, memory)
    state = (memory, problem.faces, u, gradient.u, travel, problem.pin)
    # a pin that goes down further by a parameter is one that starts lower
    seen = slopes._replace(height=slopes.height - moved)
    friction_work = 0.0 if before is None else before.friction_work
    if potential.has_friction:
        friction_work += slide_anchors(*state, problem.friction, seen)
    if sticks:
        tie_touching(*state, history.stick, slopes, moved)
    return TravelState(
        travel,
        u,
        gradient.u,
        assembly.pin_force,
        gradient.force,
        moved,
        energy,
        friction_work,
        found.negative,
        by_objective,
    )


def _at_moving_travel(
    potential: Potential, solver: SymmetricSolver, found: Found, fixed: Gradient, before: Array
) -> tuple[Gradient, Array]:
    """Derivatives of a step to a force, and those of its travel, from those at fixed travel."""
    free, slope = travel_slope(potential, solver, found.equilibrium.assembly)
    at_travel = Sensitivity(fixed.u, fixed.force, before)
    u_slope = potential.expand(free)
    moved = at_moving_travel(at_travel, u_slope, slope, before, meets=found.arrived)
    return Gradient(moved.u, moved.force), moved.travel


def _predict(
    potential: Potential,
    solver: SymmetricSolver,
    start: Start,
    travel: float,
    memory: ContactMemory,
    newton: NewtonOptions,
) -> tuple[Array, Array]:
    """Tangent predictor from the last equilibrium, shortened until no element turns inside out."""
    u, p, assembly = start.u, start.p, start.assembly
    if assembly is None:
        return u, p
    load = assembly.gradient + assembly.by_travel * (travel - start.travel)
    free = descent_direction(potential, solver, load, newton, start.negative, predicts=True)
    du = potential.expand(free)
    dp = potential.pressure_step(du)
    fraction = 1.0
    for _ in range(6):
        if np.isfinite(potential.energy(u + fraction * du, travel, memory)):
            return u + fraction * du, p + fraction * dp
        fraction *= 0.5
    return u, p
