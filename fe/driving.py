"""March a prescribed motion from 0 to the asked travels, with sensitivities in the material.

The tangent predictor moves all nodes at once; fe.newton then finds the equilibrium at the travel.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from fe.driven import DrivenPotential, DrivenProblem
from fe.linear_solver import SymmetricSolver
from fe.load_stepping import March, StepOptions
from fe.materials.material import Material
from fe.newton import Equilibrium, NewtonOptions, descent_direction, equilibrate
from fe.plate import PlateMemory, initial_memory, renewed_anchors, renewed_limits

Array = npt.NDArray[np.float64]

FRICTION_TOLERANCE = 1e-3
"""change of the friction limits between passes, relative to their norm"""
FRICTION_PASSES = 20
FALL = 0.999
"""force relative to that of the step before, below which the force is said to fall"""


@dataclass(frozen=True)
class DrivenState:
    """Converged solution at one asked travel, of the modelled part."""

    travel: float
    """mm"""
    u: Array
    """(n_node, 3) mm"""
    u_gradient: Array
    """(n_node, 3, n_direction) du along the directions, mm; NaN with friction"""
    force: float
    """dE/dtravel, N"""
    force_gradient: Array
    """(n_direction,) N; NaN with friction"""
    energy: float
    """stored energy with that of contact, N mm"""
    negative_pivots: int


@dataclass(frozen=True)
class Solution:
    """All states that a march reached."""

    states: list[DrivenState]
    outcome: March
    n_factorisations: int


def solve(
    problem: DrivenProblem,
    material: Material,
    targets: Sequence[float],
    *,
    directions: Array,
    steps: StepOptions,
    newton: NewtonOptions,
) -> Solution:
    """States at the target travels (mm, increasing) up to the one that cannot be reached.

    `directions` (n_direction, n_constant + 1) are the changes of constants and bulk modulus along
    which derivatives are taken.
    """
    solver = SymmetricSolver(problem.pattern.indptr, problem.pattern.indices)
    outcome = March()
    try:
        states = list(
            drive(
                DrivenPotential(problem, material),
                solver,
                targets,
                outcome,
                directions=directions,
                steps=steps,
                newton=newton,
            )
        )
        return Solution(states, outcome, solver.n_factorisations)
    finally:
        solver.close()


def drive(
    potential: DrivenPotential,
    solver: SymmetricSolver,
    targets: Sequence[float],
    outcome: March,
    *,
    directions: Array,
    steps: StepOptions,
    newton: NewtonOptions,
) -> Iterator[DrivenState]:
    """Yield the solution at each target; what happened is left in `outcome`.

    Its `reason` also tells of a force that falls: compressed mixed elements can leave the wanted
    solution for one of their own that is stable.
    """
    plate = potential.problem.plate
    memory = None if plate is None else initial_memory(plate)
    u, p = potential.zero_state()
    assembly = potential.assemble(u, p, 0.0, memory)
    negative = solver.factorise(assembly.data)
    step = steps.first
    for target in targets:
        while outcome.reached < target:
            remaining = target - outcome.reached
            n = max(1, int(np.ceil(remaining / step - 1e-6)))
            travel = target if n == 1 else outcome.reached + remaining / n
            advance = travel - outcome.reached
            load = assembly.gradient + assembly.by_travel * advance
            free = descent_direction(potential, solver, load, newton, negative)
            du = potential.expand(free) + advance * potential.problem.motion
            start = u + du, p + potential.pressure_step(du)
            found, renewed = _equilibrate(potential, solver, start, travel, memory, newton)
            if not found.converged:
                outcome.n_cuts += 1
                step = advance / 2.0
                if step < steps.smallest:
                    outcome.reason = f"{found.reason} at a travel of {travel:.4f} mm"
                    return
                assembly = potential.assemble(u, p, outcome.reached, memory)
                negative = solver.factorise(assembly.data)
                continue
            u, p = found.u, found.p
            memory = renewed
            if found.assembly.pin_force < FALL * assembly.pin_force:
                outcome.reason = outcome.reason or _fall(travel)
            assembly = potential.assemble(u, p, travel, memory)
            negative = solver.factorise(assembly.data)
            outcome.reached = travel
            outcome.n_steps += 1
            step = min(steps.largest, step * (1.5 if found.iterations <= 6 else 0.8))
        yield _state(potential, solver, found, negative, target, directions)


def _fall(travel: float) -> str:
    return (
        f"the force falls at a travel of {travel:.4f} mm: another branch of equilibria, real or of "
        "the mesh, or a material that softens"
    )


def _equilibrate(
    potential: DrivenPotential,
    solver: SymmetricSolver,
    start: tuple[Array, Array],
    travel: float,
    memory: PlateMemory | None,
    newton: NewtonOptions,
) -> tuple[Equilibrium, PlateMemory | None]:
    """Equilibrium at `travel`, friction limits renewed until they settle; the memory after it."""
    u, p = start
    plate = potential.problem.plate
    modulus = potential.solid.material.shear_modulus
    iterations = 0
    for _ in range(FRICTION_PASSES):
        found = equilibrate(potential, solver, u, p, travel, memory, newton)
        iterations += found.iterations
        if not found.converged or plate is None or memory is None or plate.friction == 0.0:
            return found, memory
        u, p = found.u, found.p
        ends = potential.end_forces(u, p, travel, memory)
        renewed = renewed_limits(plate, memory, u, travel, modulus, ends)
        before = np.concatenate([memory.end_limit, memory.edge_limit.ravel()])
        after = np.concatenate([renewed.end_limit, renewed.edge_limit.ravel()])
        settled = np.linalg.norm(after - before) <= FRICTION_TOLERANCE * np.linalg.norm(after)
        memory = renewed
        if settled:
            return found, renewed_anchors(plate, memory, u)
    return replace(found, converged=False, reason="the friction did not settle"), memory


def _state(
    potential: DrivenPotential,
    solver: SymmetricSolver,
    found: Equilibrium,
    negative: int,
    travel: float,
    directions: Array,
) -> DrivenState:
    """The solution with its derivatives from the factorised tangent."""
    assembly = found.assembly
    n = len(directions)
    plate = potential.problem.plate
    if plate is not None and plate.friction > 0.0:
        u_gradient, force_gradient = np.full((*found.u.shape, n), np.nan), np.full(n, np.nan)
    else:
        slopes, direct = potential.force_slopes(found.u, travel, directions)
        free = solver.solve(-slopes)
        force_gradient = assembly.by_travel @ free + direct
        u_gradient = np.stack([potential.expand(column) for column in free.T], axis=2)
    return DrivenState(
        travel=travel,
        u=found.u,
        u_gradient=u_gradient,
        force=assembly.pin_force,
        force_gradient=force_gradient,
        energy=assembly.energy,
        negative_pivots=negative,
    )
