"""Equilibrium at a fixed pin travel: u-p Newton with a line search on the potential.

Directions of negative curvature, counted by the factorisation's inertia, are flipped
(`fe.negative_curvature`), so the iteration goes down to a stable equilibrium instead of to the
nearest stationary point; where they are many, the tangent is shifted.  Without friction, of the
iterates of one step the first is factorised; later ones go on with that factor by conjugate
gradients, until these see negative curvature or get slow.  Modes that they do not meet are counted
where the iteration would end, and left if there are any.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from fe.linear_solver import SymmetricSolver
from fe.negative_curvature import flip_negative, shifted_direction
from fe.newton_problem import NewtonProblem
from fe.positive_numbers import positive_numbers
from fe.potential import Assembly
from fe.whole_step import WholeStep, is_nearer, whole_step

Array = npt.NDArray[np.float64]

Memory = TypeVar("Memory")


@dataclass(frozen=True)
class NewtonOptions:
    """Tolerances of the equilibrium iteration."""

    tolerance: float = 1e-5
    """residual norm relative to the norm of the contact forces; below 1e-11 rounding may keep it
    from being met. Where something rubs, what is left open differs from one response to the next:
    differences of responses need 1e-9, for parameters that they hardly depend on above all. The
    gradients of a response are no differences and need no less than this"""
    max_iterations: int = 100
    """generous: a snap of a node row past the fillet takes 30-60"""
    memory: int = 5
    """energies the non-monotone line search looks back on (Grippo et al. 1986)"""
    max_move: float = 0.15
    """largest nodal displacement of one iteration, mm"""
    max_negative_modes: int = 4
    """where there are more, Lanczos would cost more than it saves: without friction the tangent is
    shifted; with it they are left to the line search, as frozen friction has no energy that a way
    down would lead through"""
    near: float = 0.1
    """relative residual below which, with friction, a step that reduces it needs no line search"""
    reduction: float = 0.7
    """of the residual by such a step, at least"""
    inexact: float = 1e-4
    """relative residual to which directions with friction's coupling are solved for"""
    lagged: float = 1e-2
    """the same without friction, by the factor of an iterate before; less near the equilibrium"""

    def __post_init__(self) -> None:
        positive_numbers(self)
        if not self.tolerance < 1.0:
            raise ValueError(
                f"tolerance: expected a share of the acting forces below 1, found {self.tolerance}"
            )


@dataclass(frozen=True)
class Equilibrium:
    """Where the iteration ended."""

    u: Array
    """(n_node, 3) mm"""
    p: Array
    """(n_elem, n_p) MPa"""
    assembly: Assembly
    converged: bool
    reason: str
    """why it stopped, when it did not converge"""
    iterations: int
    jump: float = 0.0
    """largest nodal displacement from where the iteration began, mm, if it met negative curvature;
    else 0"""


def descent_direction(
    potential: NewtonProblem[Any],
    solver: SymmetricSolver,
    gradient: Array,
    options: NewtonOptions,
    negative: int,
    *,
    predicts: bool = False,
) -> Array:
    """Newton direction (n_free,) mm of the factorised tangent, negative modes flipped.

    Of a shifted tangent, which is factorised then, where these are more than `max_negative_modes`
    and nothing rubs.

    At a stable state with friction it is that of the whole tangent, if that is found and goes down.
    One that `predicts` the step after an equilibrium is by the factor that its derivatives made;
    without derivatives that factor is made here, so that a march has the same bits.
    """
    if negative == 0 and potential.has_friction:
        if predicts:
            coupled = solve_coupled(potential, solver, -gradient)
        else:
            whole = potential.coupled_tangent()
            coupled = solver.solve_near(whole, -gradient, options.inexact)
        if gradient @ coupled < 0.0:
            return coupled
    many = negative > options.max_negative_modes
    if many and not potential.has_friction:
        return shifted_direction(solver, -gradient)
    x = solver.solve(-gradient)
    if negative > 0 and not many:
        x = flip_negative(solver, x, -gradient, negative)
    return -x if gradient @ x > 0.0 else x


def solve_coupled(potential: NewtonProblem[Any], solver: SymmetricSolver, b: Array) -> Array:
    """Solve the whole tangent, friction's coupling included, for b (n_free,) or (n_free, k) N.

    Of the last `assemble`, which must be what is factorised in `solver` where nothing rubs.
    """
    if not potential.has_friction:
        return solver.solve(b)
    return solver.solve_general(potential.coupled_tangent(), b)


def equilibrate(
    potential: NewtonProblem[Memory],
    solver: SymmetricSolver,
    u: Array,
    p: Array,
    travel: float,
    memory: Memory,
    options: NewtonOptions,
) -> Equilibrium:
    """Find the equilibrium at `travel` (mm) from the start (u, p)."""
    recent: deque[float] = deque(maxlen=options.memory)
    negative, lagged = -1, False  # not counted yet
    began, unstable = u, False
    assembly = potential.assemble(u, p, travel, memory)
    for iteration in range(options.max_iterations):
        if not (assembly.smallest_J > 0.0 and np.isfinite(assembly.energy)):
            return Equilibrium(u, p, assembly, False, "an element turned inside out", iteration)
        norm = float(np.linalg.norm(assembly.gradient))
        if not np.isfinite(norm):
            return Equilibrium(u, p, assembly, False, "forces are no numbers any more", iteration)
        settled = norm <= options.tolerance * assembly.force_scale
        if settled and not (lagged and norm > 0.0 and solver.factorise(assembly.data) > 0):
            jump = float(np.abs(u - began).max()) if unstable else 0.0
            return Equilibrium(u, p, assembly, True, "", iteration, jump)
        near = potential.has_friction and norm <= options.near * assembly.force_scale
        along = whole = None
        if negative == 0 and not potential.has_friction and not settled:
            enough = min(options.lagged, norm / assembly.force_scale)  # slow near the end else
            along = solver.solve_positive(assembly.data, -assembly.gradient, enough)
        lagged = along is not None
        if along is None and not (near and negative == 0):  # else it was 0 at the iterate before
            negative = solver.factorise(assembly.data)
        if near and negative == 0:
            whole = whole_step(
                potential, solver, u, p, assembly, travel, memory,
                inexact=options.inexact, max_move=options.max_move,
            )  # fmt: skip
            if whole.trial is not None and is_nearer(whole.trial, assembly, options.reduction):
                u, p, assembly = u + whole.du, p + whole.dp, whole.trial
                recent.clear()
                continue
            negative = solver.factorise(assembly.data)
            if negative == 0 and assembly.gradient @ whole.along < 0.0:
                along = whole.along
            else:
                whole = None
                potential.assemble(u, p, travel, memory)  # what the solves below are of
        if along is None:
            along = descent_direction(potential, solver, assembly.gradient, options, negative)
        unstable = unstable or negative > 0
        here = u, p, assembly
        moved = _descend(potential, along, here, travel, memory, recent, negative, options, whole)
        if isinstance(moved, str):
            why = "" if settled else f"{moved} {_left_open(norm, assembly, options)}"
            return Equilibrium(u, p, assembly, settled, why, iteration)
        u, p, assembly = moved
    return Equilibrium(
        u, p, assembly, False, "the iteration did not settle", options.max_iterations
    )


def _left_open(norm: float, assembly: Assembly, options: NewtonOptions) -> str:
    """What a residual of this norm (N) leaves open, beside what was asked."""
    share = norm / max(assembly.force_scale, np.finfo(float).tiny)
    return f"(residual {share:.1e} of the contact forces, tolerance {options.tolerance:g})"


def _descend(
    potential: NewtonProblem[Memory],
    along: Array,
    here: tuple[Array, Array, Assembly],
    travel: float,
    memory: Memory,
    recent: deque[float],
    negative: int,
    options: NewtonOptions,
    tried: WholeStep | None,
) -> tuple[Array, Array, Assembly] | str:
    """One step with a line search from (u, p, assembly) to the next, or why there is none.

    `along` (n_free,) mm is its direction, `negative` the negative pivots behind it, `recent`
    the energies looked back on, to which that of here is added.  What was `tried` is that
    direction's whole step: where it was assembled, that was the last `assemble`.
    """
    u, p, assembly = here
    du = potential.expand(along) if tried is None else tried.du
    if not np.isfinite(du).all():
        return "the tangent is singular"
    recent.append(assembly.energy)
    slope = float(np.sum(du.ravel()[potential.problem.pattern.number >= 0] * assembly.gradient))
    reference = max(recent) if negative == 0 else assembly.energy
    dp = potential.pressure_step(du) if tried is None else tried.dp
    if assembly.frame is None and negative == 0 and np.abs(du).max() <= options.max_move:
        # all but a few such steps are accepted whole: the energy comes with the next tangent
        whole = potential.assemble(u + du, p + dp, travel, memory)
        if _goes_down(whole.energy, reference, 1.0, slope):
            return u + du, p + dp, whole
        potential.assemble(u, p, travel, memory)  # what pressure steps are of
    fraction = _line_search(
        potential,
        u,
        du,
        travel,
        memory,
        assembly.frame,
        reference,
        slope,
        negative > 0,
        options,
    )
    if fraction == 0.0:
        return "no descent along the step"
    u = u + fraction * du
    ordinary = 0.2 <= fraction <= 1.0
    p = p + fraction * dp if ordinary else potential.consistent_pressure(u)
    before = assembly.frame
    if fraction == 1.0 and tried is not None and tried.trial is not None:
        assembly = tried.trial
    else:
        assembly = potential.assemble(u, p, travel, memory)
    if before is not None:  # energies looked back on: as if frozen where we are now
        shift = assembly.energy - potential.energy(u, travel, memory, before)
        for i, energy in enumerate(recent):
            recent[i] = energy + shift
    return u, p, assembly


def _goes_down(energy: float, reference: float, fraction: float, slope: float) -> bool:
    """Whether the energy (N mm) at a fraction of a step is low enough (Armijo), to rounding.

    `slope` (N mm) is the derivative of the energy by the fraction, `reference` what it starts from.
    """
    return energy <= reference + 1e-4 * fraction * slope + 1e-12 * abs(reference)


def _line_search(
    potential: NewtonProblem[Memory],
    u: Array,
    du: Array,
    travel: float,
    memory: Memory,
    frame: Any,
    reference: float,
    slope: float,
    indefinite: bool,
    options: NewtonOptions,
) -> float:
    """Accepted fraction of du, 0 when none is; longer than 1 only along negative curvature."""
    largest = float(np.abs(du).max())
    fraction = min(1.0, options.max_move / max(largest, 1e-300))
    shortened = False
    for _ in range(12):
        energy = potential.energy(u + fraction * du, travel, memory, frame)
        if _goes_down(energy, reference, fraction, slope):
            break
        fraction *= 0.5
        shortened = True
    else:
        return 0.0
    if indefinite and not shortened:
        while 2.0 * fraction * largest < options.max_move:
            further = potential.energy(u + 2.0 * fraction * du, travel, memory, frame)
            if not further < energy:
                break
            fraction, energy = 2.0 * fraction, further
    return fraction
