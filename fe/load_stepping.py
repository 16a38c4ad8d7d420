"""March the pin from 0 to the asked travels, with predictor, step control and sensitivities."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fe.contact_memory import ContactMemory, slide_anchors, tie_touching
from fe.linear_solver import SymmetricSolver
from fe.material_parameters import MaterialParameters
from fe.newton import (
    Equilibrium,
    NewtonOptions,
    descent_direction,
    equilibrate,
    solve_coupled,
)
from fe.potential import Assembly, Potential

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
    """(n_node, 3, n_p) du/d parameter of the material, mm; with friction also, last, in the
    coefficients of pin and base (the column of one that is 0 is 0)"""
    pin_force: float
    """N"""
    force_gradient: Array
    """(n_p,) dF/d parameter of the material, N; with friction also in the coefficients of pin and
    base"""
    energy: float
    """stored energy with the contact's, N mm"""
    friction_work: float
    """energy that friction has taken up to here, N mm"""
    negative_pivots: int


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
    parameters: MaterialParameters,
    stick_to_pin: bool,
    stick_to_floor: bool,
    steps: StepOptions,
    newton: NewtonOptions,
) -> Iterator[TravelState]:
    """Yield the solution at each target travel (mm, increasing) until one cannot be reached.

    Sensitivities are in `parameters` and, with friction, its coefficients.  `stick_to_pin` and
    `stick_to_floor` tie points to what they touch at the end of each step.  What happened is left
    in `outcome`: the travel reached and, when the march stopped early, why.
    """
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
            stick = (stick_to_pin, stick_to_floor)
            state = _accept(
                potential, solver, found, travel, memory, parameters, stick, friction_work
            )
            negative, friction_work = state.negative_pivots, state.friction_work
            outcome.reached = travel
            outcome.n_steps += 1
            step = min(steps.largest, step * _growth(found.iterations))
        yield state


def _accept(
    potential: Potential,
    solver: SymmetricSolver,
    found: Equilibrium,
    travel: float,
    memory: ContactMemory,
    parameters: MaterialParameters,
    stick: tuple[bool, bool],
    friction_work: float,
) -> TravelState:
    """State of the equilibrium `found`; leaves its factor in `solver` and updates `memory`.

    `stick` says whether points that touch pin and floor are tied to them from now on.
    """
    problem, u = potential.problem, found.u
    negative = solver.factorise(found.assembly.data)
    u_gradient, force_gradient = _sensitivity(potential, solver, found, travel, memory, parameters)
    energy = potential.energy(u, travel, memory)
    state = (memory, problem.faces, u, u_gradient, travel, problem.pin)
    if potential.has_friction:
        friction_work += slide_anchors(*state, problem.friction)
    if any(stick):
        tie_touching(*state, to_pin=stick[0], to_floor=stick[1])
    return TravelState(
        travel,
        u,
        u_gradient,
        found.assembly.pin_force,
        force_gradient,
        energy,
        friction_work,
        negative,
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


def _sensitivity(
    potential: Potential,
    solver: SymmetricSolver,
    found: Equilibrium,
    travel: float,
    memory: ContactMemory,
    parameters: MaterialParameters,
) -> tuple[Array, Array]:
    """du/d parameter (n_node, 3, n_p) mm and dF/d parameter (n_p,) N of the modelled part.

    From the factor of the last assembled tangent.  Exact for the discrete, path-dependent scheme:
    slip and stick anchors carry their own derivatives from step to step.
    """
    rhs, direct = potential.memory_gradient(found.u, travel, memory)
    n_material = len(parameters.names)
    rhs[:, :n_material] += _material_gradient(potential, found.u, parameters)
    direct[:n_material] += found.assembly.pin_force * parameters.stiffness
    free = solve_coupled(potential, solver, -rhs)
    force = found.assembly.pin_force_by_u @ free + direct
    columns = [potential.expand(free[:, j]) for j in range(free.shape[1])]
    return np.stack(columns, axis=2), force


def _material_gradient(potential: Potential, u: Array, parameters: MaterialParameters) -> Array:
    """(n_free, n_p) derivative of the gradient in the material's parameters at fixed u, N.

    Of the last `assemble`; forces of contact are linear in its stiffness.
    """
    moving = parameters.constants.any(axis=1)
    columns = np.zeros((potential.n_unknowns, len(parameters.names)))
    columns[:, moving] = potential.constants_gradient(u, parameters.constants[moving])
    if parameters.bulk.any():
        columns += np.outer(potential.bulk_gradient(u), parameters.bulk)
    if parameters.stiffness.any():
        columns += np.outer(potential.penalty_gradient(), parameters.stiffness)
    return columns
