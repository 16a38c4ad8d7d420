"""March a prescribed motion from 0 to the asked travels, with sensitivities in the material.

The tangent predictor moves all nodes at once; fe.newton then finds the equilibrium at the travel.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from fe.driven import DrivenPotential, DrivenProblem
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
from fe.materials.material import Material
from fe.newton import Equilibrium, NewtonOptions, descent_direction, equilibrate
from fe.plate import PlateMemory, initial_memory, renewed_anchors, renewed_limits
from fe.progress import Progress
from fe.steps import March, StepOptions, stride

Array = npt.NDArray[np.float64]

FRICTION_TOLERANCE = 1e-3
"""change of the friction limits between passes, relative to their norm"""
FRICTION_PASSES = 20


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
    """(n_direction,) N; NaN with friction, 0 where the force was asked"""
    travel_gradient: Array
    """(n_direction,) dtravel along the directions, mm; NaN with friction, 0 where the travel was
    asked"""
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
    control: Control = "travel",
    listen: Progress | None = None,
) -> Solution:
    """States at the targets (increasing) up to the one that cannot be reached.

    Targets are travels, mm, or with `control` "force" forces of the modelled part, N.
    `listen` hears of each accepted step.
    `directions` (n_direction, n_constant + 1) are the changes of constants and bulk modulus along
    which derivatives are taken.
    """
    solver = SymmetricSolver(problem.pattern.indptr, problem.pattern.indices)
    outcome = March(listen=listen)
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
                control=control,
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
    control: Control,
) -> Iterator[DrivenState]:
    """Yield the solution at each target; what happened is left in `outcome`.

    Also whether the force fell: compressed mixed elements can leave the wanted solution for one of
    their own that is stable.
    """
    plate = potential.problem.plate
    memory = renewed = None if plate is None else initial_memory(plate)
    rubs = plate is not None and plate.friction > 0.0
    state: DrivenState | None = None
    force = 0.0

    def aim(start: Start, travel: float) -> tuple[Array, Array]:
        return _predict(potential, solver, start, travel, newton)

    def attempt(start: tuple[Array, Array], travel: float) -> Equilibrium:
        nonlocal renewed
        found, renewed = _equilibrate(potential, solver, start, travel, memory, newton)
        return found

    def accept(found: Found) -> Start:
        nonlocal memory, state, force
        now = found.equilibrium.assembly.pin_force
        if now < FALL * force:
            outcome.fall(found)
        force, memory = now, renewed
        state = _state(potential, solver, found, directions, state, control)
        return restore(found.as_start()) if rubs else found.as_start()

    def restore(start: Start) -> Start:
        assembly = potential.assemble(start.u, start.p, start.travel, memory)
        return start._replace(assembly=assembly, negative=solver.factorise(assembly.data))

    here = restore(Start(*potential.zero_state(), None, 0.0, 0))
    # a force that friction has a part in is not settled further than friction is
    tolerance = FRICTION_TOLERANCE if rubs else newton.tolerance
    way = Way(aim, attempt, accept, restore, control, tolerance)
    for _ in stride(potential, solver, way, here, targets, steps, outcome):
        assert state is not None
        yield state


def _predict(
    potential: DrivenPotential,
    solver: SymmetricSolver,
    start: Start,
    travel: float,
    newton: NewtonOptions,
) -> tuple[Array, Array]:
    """Tangent predictor from the last equilibrium."""
    assembly, advance = start.assembly, travel - start.travel
    if assembly is None:
        return start.u, start.p
    load = assembly.gradient + assembly.by_travel * advance
    free = descent_direction(potential, solver, load, newton, start.negative)
    du = potential.expand(free) + advance * potential.problem.motion
    return start.u + du, start.p + potential.pressure_step(du)


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
    found: Found,
    directions: Array,
    before: DrivenState | None,
    control: Control,
) -> DrivenState:
    """The solution with its derivatives from the factorised tangent; `before` is the last one's."""
    at, travel = found.equilibrium, found.travel
    n = len(directions)
    plate = potential.problem.plate
    if plate is not None and plate.friction > 0.0:
        unknown = np.full(n, np.nan)
        gradient = Sensitivity(np.full((*at.u.shape, n), np.nan), unknown, unknown)
    else:
        slopes, direct = potential.force_slopes(at.u, travel, directions)
        free = solver.solve(-slopes)
        columns = [potential.expand(column) for column in free.T]
        by_force = at.assembly.by_travel @ free + direct
        gradient = Sensitivity(np.stack(columns, axis=2), by_force, np.zeros(n))
        if control == "force":
            moved = gradient.travel if before is None else before.travel_gradient
            along, slope = travel_slope(potential, solver, at.assembly)
            u_slope = potential.expand(along) + potential.problem.motion
            gradient = at_moving_travel(gradient, u_slope, slope, moved, meets=found.arrived)
    return DrivenState(
        travel=travel,
        u=at.u,
        u_gradient=gradient.u,
        force=at.assembly.pin_force,
        force_gradient=gradient.force,
        travel_gradient=gradient.travel,
        energy=at.assembly.energy,
        negative_pivots=found.negative,
    )
