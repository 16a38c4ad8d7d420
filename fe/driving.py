"""March a prescribed motion from 0 to the asked travels, with sensitivities.

The tangent predictor moves all nodes at once; fe.newton then finds the equilibrium at the travel.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fe.directions import Directions
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
from fe.parameters import Parameters
from fe.plate import PlateMemory, PlateSlopes, doubts, initial_memory, moved_anchors, no_slopes
from fe.progress import Progress
from fe.sensitivity import Objective, Tangent, adjoint, direct
from fe.steps import March, StepOptions, stride

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class DrivenState:
    """Converged solution at one asked travel, of the modelled part."""

    travel: float
    """mm"""
    u: Array
    """(n_node, 3) mm"""
    u_gradient: Array
    """(n_node, 3, n_p) du/d parameter, mm; (n_node, 3, 0) where an objective's gradient was asked
    and nothing rubs"""
    pin_force: float
    """dE/dtravel, N"""
    force_gradient: Array
    """(n_p,) N, 0 where the force was asked; (0,) where `u_gradient` is empty"""
    travel_gradient: Array
    """(n_p,) dtravel/d parameter, mm; 0 where the travel was asked"""
    energy: float
    """stored energy with that of contact, N mm"""
    negative_pivots: int
    objective_gradient: Array
    """(n_p,) of the objective, (0,) without one"""


class Solution(NamedTuple):
    """All states that a march reached."""

    states: list[DrivenState]
    outcome: March
    n_factorisations: int


class _Asked(NamedTuple):
    """What is wanted of each step."""

    parameters: Parameters[PlateSlopes | None]
    inner: Directions
    control: Control
    objective: Objective | None


def no_parameters(problem: DrivenProblem, material: Material) -> Parameters[PlateSlopes | None]:
    """For a march without sensitivities."""
    return Parameters(
        names=(),
        constants=np.zeros((0, len(material.constants))),
        bulk=np.zeros(0),
        motion=np.zeros((0, *problem.motion.shape)),
        surface=None if problem.plate is None else no_slopes(problem.plate.edges, 0),
    )


def solve(
    problem: DrivenProblem,
    material: Material,
    targets: Sequence[float],
    *,
    steps: StepOptions,
    newton: NewtonOptions,
    parameters: Parameters[PlateSlopes | None] | None = None,
    control: Control = "travel",
    objective: Objective | None = None,
    listen: Progress | None = None,
) -> Solution:
    """States at the targets (increasing) up to the one that cannot be reached.

    Targets are travels, mm, or with `control` "force" forces of the modelled part, N.
    `listen` hears of each accepted step.  Sensitivities are in `parameters`, none when not given,
    of all displacements or, by the adjoint, of an `objective` at asked travels.
    """
    solver = SymmetricSolver(problem.pattern.indptr, problem.pattern.indices)
    outcome = March(listen=listen)
    along = no_parameters(problem, material) if parameters is None else parameters
    asked = _Asked(along, along.directions(material, problem.elements), control, objective)
    potential = DrivenPotential(problem, material)
    try:
        states = list(drive(potential, solver, targets, outcome, asked, steps, newton))
        return Solution(states, outcome, solver.n_factorisations)
    finally:
        solver.close()


def drive(
    potential: DrivenPotential,
    solver: SymmetricSolver,
    targets: Sequence[float],
    outcome: March,
    asked: _Asked,
    steps: StepOptions,
    newton: NewtonOptions,
) -> Iterator[DrivenState]:
    """Yield the solution at each target; what happened is left in `outcome`.

    Also whether the force fell: compressed mixed elements can leave the wanted solution for one of
    their own that is stable.
    """
    plate, slopes = potential.problem.plate, asked.parameters.surface
    memory: PlateMemory | None = None
    if plate is not None and slopes is not None:
        memory = initial_memory(plate, slopes)
    state: DrivenState | None = None
    tangent = Tangent(potential, solver)

    def aim(start: Start, travel: float) -> tuple[Array, Array]:
        return _predict(potential, solver, start, travel, newton)

    def attempt(start: tuple[Array, Array], travel: float) -> Equilibrium:
        return equilibrate(potential, solver, *start, travel, memory, newton)

    def accept(found: Found) -> Start:
        """Keep a converged step; the start of the next one, anchors renewed where it rubs."""
        nonlocal memory, state
        reached = _state(potential, solver, tangent, found, memory, asked, state)
        start, drawn = found.as_start(), memory
        if potential.has_friction and plate is not None and slopes is not None:
            assert memory is not None
            limits = found.equilibrium.assembly.frame
            pressed = limits.ends > 0.0, limits.edges > 0.0
            drawn = moved_anchors(plate, slopes, memory, pressed, reached.u, reached.u_gradient)
            start = refreshed(start, drawn)
        # Whatever was singular has raised by now: the step is tried again from the old memory.
        before = 0.0 if state is None else state.pin_force
        _warn_of(potential.problem, found, before, reached, outcome)
        state, memory = reached, drawn
        return start

    def restore(start: Start) -> Start:
        return refreshed(start, memory)

    def refreshed(start: Start, anchors: PlateMemory | None) -> Start:
        assembly = potential.assemble(start.u, start.p, start.travel, anchors)
        return start._replace(assembly=assembly, negative=solver.factorise(assembly.data))

    here = restore(Start(*potential.zero_state(), None, 0.0, 0))
    limit = np.inf if plate is None else plate.height / plate.speed
    way = Way(aim, attempt, accept, restore, asked.control, newton.tolerance, limit)
    for _ in stride(potential, solver, way, here, targets, steps, outcome):
        assert state is not None
        yield state


def _warn_of(
    problem: DrivenProblem, found: Found, before: float, reached: DrivenState, outcome: March
) -> None:
    """Note what is to be told of a step about to be accepted.

    A force that falls, a jump, another branch, a side deep in the plate, lost derivatives.

    `before` is the force of the last one, N.
    """
    if reached.pin_force < FALL * before:
        outcome.fall(found)
    outcome.jump(found, leaves=True)
    if problem.on_branch is not None and not problem.on_branch(reached.u):
        outcome.leave_branch(found)
    if found.arrived and problem.plate is not None:
        for kind, doubt in doubts(problem.plate, reached.u, found.travel):
            outcome.warn(kind, doubt)
    if not np.isfinite(reached.force_gradient).all():
        lost = f"no derivatives from a travel of {found.travel:.4f} mm on"
        outcome.warn("derivatives", lost)


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


def _state(
    potential: DrivenPotential,
    solver: SymmetricSolver,
    tangent: Tangent,
    found: Found,
    memory: PlateMemory | None,
    asked: _Asked,
    before: DrivenState | None,
) -> DrivenState:
    """The solution with its derivatives from the factorised tangent; `before` is the last one's.

    They are taken where the caller asks for them, and with friction for the sake of its anchors.
    """
    at, travel, along = found.equilibrium, found.travel, asked.parameters
    n_p = len(along.names)
    moved = np.zeros(n_p) if before is None else before.travel_gradient
    gradient = Sensitivity(np.zeros((*at.u.shape, 0)), np.zeros(0), moved)
    by_objective = np.zeros(0)
    if potential.has_friction or found.arrived:
        partials = potential.partials(at.u, travel, memory, at.assembly, along, asked.inner)
        prescribed = potential.problem.motion[..., None] * -along.zeroes.astype(np.float64)
        if potential.has_friction or asked.objective is None:
            fixed = direct(potential, tangent, at.assembly, partials)
            gradient = Sensitivity(fixed.u + prescribed, fixed.force, moved)
            if asked.control == "force":
                free, slope = travel_slope(potential, solver, at.assembly)
                u_slope = potential.expand(free) + potential.problem.motion
                gradient = at_moving_travel(gradient, u_slope, slope, moved, meets=found.arrived)
        if found.arrived and asked.objective is not None:
            by_u, by_force = asked.objective(travel, at.u, at.assembly.pin_force)
            by_objective = adjoint(potential, tangent, at.assembly, partials, by_u, by_force)
            by_objective = by_objective + np.einsum("ni,nij->j", by_u, prescribed)
    return DrivenState(
        travel=travel,
        u=at.u,
        u_gradient=gradient.u,
        pin_force=at.assembly.pin_force,
        force_gradient=gradient.force,
        travel_gradient=gradient.travel,
        energy=at.assembly.energy,
        negative_pivots=found.negative,
        objective_gradient=by_objective,
    )
