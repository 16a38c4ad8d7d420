"""March the pin from 0 to the asked travels, with predictor, step control and sensitivities."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fe.contact import ContactMemory, tie_touching
from fe.linear_solver import SymmetricSolver
from fe.newton import Equilibrium, NewtonOptions, descent_direction, equilibrate
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
    """(n_node, 3, 2) du/d(r, s), mm"""
    pin_force: float
    """N"""
    force_gradient: Array
    """(2,) dF/d(r, s), N"""
    energy: float
    """stored energy with the contact's, N mm"""
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
    stick: bool,
    steps: StepOptions,
    newton: NewtonOptions,
) -> Iterator[TravelState]:
    """Yield the solution at each target travel (mm, increasing) until one cannot be reached.

    `stick` ties points to what they touch at the end of each step.  What happened is left in
    `outcome`: the travel reached and, when the march stopped early, why.
    """
    u, p = potential.zero_state()
    step = steps.first
    assembly: Assembly | None = None
    negative = 0
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
            negative = solver.factorise(assembly.data)
            u_gradient, force_gradient = _sensitivity(potential, solver, found, memory)
            state = TravelState(
                travel,
                u,
                u_gradient,
                assembly.pin_force,
                force_gradient,
                assembly.energy,
                negative,
            )
            if stick:
                tie_touching(
                    memory, potential.problem.faces, u, u_gradient, travel, potential.problem.pin
                )
            outcome.reached = travel
            outcome.n_steps += 1
            step = min(steps.largest, step * _growth(found.iterations))
        yield state


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
    potential: Potential, solver: SymmetricSolver, found: Equilibrium, memory: ContactMemory
) -> tuple[Array, Array]:
    """du/d(r, s) (n_node, 3, 2) mm and dF/d(r, s) (2,) N of the modelled part, from the factor."""
    anchors, direct = potential.anchor_gradient(memory)
    rhs = potential.ratio_gradient(found.u) + anchors
    free = solver.solve(-rhs)
    force = found.assembly.by_travel @ free + direct
    columns = [potential.expand(free[:, j]) for j in range(free.shape[1])]
    return np.stack(columns, axis=2), force
