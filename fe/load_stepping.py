"""March the pin from 0 to the asked travels, with predictor, step control and sensitivities."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fe.contact_memory import ContactMemory, slide_anchors, tie_touching, touches
from fe.linear_solver import SymmetricSolver
from fe.newton import Equilibrium, NewtonOptions, descent_direction, equilibrate
from fe.parameters import Parameters
from fe.potential import Assembly, Potential
from fe.sensitivity import Gradient, Objective, Tangent, adjoint, direct, partials

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class StepOptions:
    """Sizes of the load steps, mm of pin travel."""

    first: float = 0.01
    largest: float = 0.1
    smallest: float = 1e-3


@dataclass(frozen=True)
class TravelState:
    """Converged solution at one asked travel (of the modelled part, not of the whole sample)."""

    travel: float
    """mm"""
    u: Array
    """(n_node, 3) mm"""
    u_gradient: Array
    """(n_node, 3, n_p) du/d parameter, mm; n_p = 0 where an objective's gradient was asked"""
    pin_force: float
    """N"""
    force_gradient: Array
    """(n_p,) dF/d parameter, N; (0,) where an objective's gradient was asked"""
    energy: float
    """stored energy with the contact's, N mm"""
    friction_work: float
    """energy that friction has taken up to here, N mm"""
    negative_pivots: int
    objective_gradient: Array
    """(n_p,) of the objective, (0,) without one"""


@dataclass
class March:
    """Outcome of a march: filled as it goes (state)."""

    reached: float = 0.0
    reason: str = ""
    n_steps: int = 0
    n_cuts: int = 0


def march(
    potential: Potential,
    solver: SymmetricSolver,
    memory: ContactMemory,
    targets: Sequence[float],
    outcome: March,
    *,
    parameters: Parameters,
    stick_to_pin: bool,
    stick_to_floor: bool,
    steps: StepOptions,
    newton: NewtonOptions,
    objective: Objective | None = None,
) -> Iterator[TravelState]:
    """Yield the solution at each target travel (mm, increasing) until one cannot be reached.

    Sensitivities are in `parameters`, of all displacements or, by the adjoint, of an `objective`;
    they are taken where the memory of contact or the caller needs them.  `stick_to_pin` and
    `stick_to_floor` tie points to what they touch at the end of each step.  What happened is left
    in `outcome`: the travel reached and, when the march stopped early, why.
    """
    tangent = Tangent(potential, solver)
    history = History(memory, parameters, (stick_to_pin, stick_to_floor), objective)
    try:
        yield from _march(potential, solver, tangent, history, targets, outcome, steps, newton)
    finally:
        tangent.close()


@dataclass(frozen=True)
class History:
    """What steps remember and how that depends on the parameters."""

    memory: ContactMemory
    parameters: Parameters
    stick: tuple[bool, bool]
    """whether points that touch pin and floor are tied to them from then on"""
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
    u, p = potential.zero_state()
    step = steps.first
    assembly: Assembly | None = None
    negative = 0
    friction_work = 0.0
    for target in targets:
        while outcome.reached < target:
            travel = _next_travel(outcome.reached, step, target)
            advance = travel - outcome.reached
            start = _predict(
                potential, solver, assembly, u, p, advance, travel, memory, newton, negative
            )
            found = equilibrate(potential, solver, *start, travel, memory, newton)
            if not found.converged:
                outcome.n_cuts += 1
                step = advance / 2.0
                if assembly is not None:  # the predictor needs the factor of the last good state
                    assembly = potential.assemble(u, p, outcome.reached, memory)
                    negative = solver.factorise(assembly.data)
                if step < steps.smallest:
                    outcome.reason = f"{found.reason} at a travel of {travel:.4f} mm"
                    return
                continue
            u, p, assembly = found.u, found.p, found.assembly
            negative = solver.factorise(found.assembly.data)
            wanted = travel == target
            state = _accept(
                potential, tangent, found, travel, history, negative, friction_work, wanted
            )
            friction_work = state.friction_work
            outcome.reached = travel
            outcome.n_steps += 1
            step = min(steps.largest, step * _growth(found.iterations))
        yield state


def _accept(
    potential: Potential,
    tangent: Tangent,
    found: Equilibrium,
    travel: float,
    history: History,
    negative: int,
    friction_work: float,
    wanted: bool,
) -> TravelState:
    """State of the equilibrium `found`, whose tangent is factorised; updates the memory.

    Its gradients are empty where neither the caller (`wanted`) nor the memory need them.
    """
    problem, u, memory = potential.problem, found.u, history.memory
    slopes = history.parameters.surface
    touching = touches(u, problem.faces, memory.tied, travel, problem.pin, *history.stick)
    remembers = potential.has_friction or touching.any()
    gradient = Gradient(np.zeros((*u.shape, 0)), np.zeros(0))
    by_objective = np.zeros(0)
    if remembers or wanted:
        at = partials(potential, u, travel, memory, history.parameters)
        tangent.take(found.assembly)
        if remembers or history.objective is None:
            gradient = direct(potential, tangent, found.assembly, at)
        if wanted and history.objective is not None:
            by = history.objective(travel, u, found.assembly.pin_force)
            by_objective = adjoint(potential, tangent, found.assembly, at, *by)
    energy = potential.energy(u, travel, memory)
    state = (memory, problem.faces, u, gradient.u, travel, problem.pin)
    if potential.has_friction:
        friction_work += slide_anchors(*state, problem.friction, slopes)
    if touching.any():
        tie_touching(*state, touching, slopes)
    return TravelState(
        travel,
        u,
        gradient.u,
        found.assembly.pin_force,
        gradient.force,
        energy,
        friction_work,
        negative,
        by_objective,
    )


def _next_travel(reached: float, step: float, target: float) -> float:
    """Equal steps to the target, so that no sliver of a step is left before it."""
    remaining = target - reached
    n = int(np.ceil(remaining / step - 1e-6))
    return target if n <= 1 else reached + remaining / n


def _growth(iterations: int) -> float:
    if iterations <= 6:
        return 1.5
    return 1.1 if iterations < 12 else 0.8


def _predict(
    potential: Potential,
    solver: SymmetricSolver,
    assembly: Assembly | None,
    u: Array,
    p: Array,
    advance: float,
    travel: float,
    memory: ContactMemory,
    newton: NewtonOptions,
    negative: int,
) -> tuple[Array, Array]:
    """Tangent predictor from the last equilibrium, shortened until no element turns inside out."""
    if assembly is None:
        return u, p
    load = assembly.gradient + assembly.by_travel * advance
    du = potential.expand(descent_direction(potential, solver, load, newton, negative))
    dp = potential.pressure_step(du)
    fraction = 1.0
    for _ in range(6):
        if np.isfinite(potential.energy(u + fraction * du, travel, memory)):
            return u + fraction * du, p + fraction * dp
        fraction *= 0.5
    return u, p
