"""Equilibrium at a fixed pin travel: u-p Newton with a line search on the potential.

Directions of negative curvature, counted by the factorisation's inertia, are found by Lanczos
with the same factor and flipped (saddle-free Newton, Dauphin et al. 2014), so the iteration goes
down to a stable equilibrium instead of to the nearest stationary point.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh, gmres

from fe.friction import Frame
from fe.linear_solver import SymmetricSolver
from fe.newton_problem import NewtonProblem
from fe.potential import Assembly

Array = npt.NDArray[np.float64]

Memory = TypeVar("Memory")


@dataclass(frozen=True)
class NewtonOptions:
    """Tolerances of the equilibrium iteration."""

    tolerance: float = 1e-5
    """residual norm relative to the norm of the contact forces"""
    max_iterations: int = 100
    """generous: a snap of a node row past the fillet takes 30-60"""
    memory: int = 5
    """energies the non-monotone line search looks back on (Grippo et al. 1986)"""
    max_move: float = 0.15
    """largest nodal displacement of one iteration, mm"""
    max_negative_modes: int = 4
    """more are left to the line search: Lanczos would cost more than it saves"""
    near: float = 0.1
    """relative residual below which, with friction, a step that reduces it needs no line search"""
    reduction: float = 0.7
    """of the residual by such a step, at least"""
    coupling_tolerance: float = 1e-5
    """relative accuracy with which a step takes in the unsymmetric tangent of friction; with 1e-2
    the error in the stiff direction of contact costs more iterations than it saves solves"""


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


def descent_direction(
    potential: NewtonProblem[Any],
    solver: SymmetricSolver,
    gradient: Array,
    options: NewtonOptions,
    negative: int,
) -> Array:
    """Newton direction (n_free,) mm of the factorised tangent, negative modes flipped.

    At a stable state with friction it is that of the whole tangent, if that is found and goes down.
    """
    x = solver.solve(-gradient)
    if 0 < negative <= options.max_negative_modes:
        modes = _negative_modes(potential.n_unknowns, solver, negative)
        x = x - 2.0 * modes @ (modes.T @ x)
    if negative == 0 and potential.has_friction:
        coupled = solve_coupled(potential, solver, -gradient, options.coupling_tolerance)
        if gradient @ coupled < 0.0:
            return coupled
    return -x if gradient @ x > 0.0 else x


def solve_coupled(
    potential: NewtonProblem[Any], solver: SymmetricSolver, b: Array, tolerance: float
) -> Array:
    """Solve the whole tangent, friction's coupling included, for b (n_free,) or (n_free, k) N.

    GMRES on the stacked columns with the factorised symmetric part as preconditioner; of the last
    `assemble`.  NaN where that does not reach the relative `tolerance`.
    """
    start = solver.solve(b)
    if not potential.has_friction:
        return start

    def preconditioned(x: Array) -> Array:
        columns = x.reshape(start.shape)
        return (columns + solver.solve(potential.couple(columns))).ravel()

    x, n_missed = gmres(
        LinearOperator((start.size, start.size), matvec=preconditioned, dtype=np.float64),
        start.ravel(),
        rtol=tolerance,
        restart=60,
        maxiter=5,
    )
    return np.asarray(x).reshape(start.shape) if n_missed == 0 else np.full(start.shape, np.nan)


def _negative_modes(n: int, solver: SymmetricSolver, count: int) -> Array:
    """(n, m) orthonormal eigenvectors of the negative eigenvalues, m <= count."""
    inverse = LinearOperator((n, n), matvec=solver.solve, dtype=np.float64)
    start = np.random.default_rng(0).standard_normal(n)
    size = min(n - 1, max(2 * count + 6, 12))
    try:
        values, vectors = eigsh(
            solver.matrix,
            k=count,
            sigma=0.0,
            which="SA",
            OPinv=inverse,
            v0=start,
            tol=5e-2,
            maxiter=8,
            ncv=size,
        )
    except ArpackError:
        return np.zeros((n, 0))
    return np.asarray(vectors[:, values < 0.0])


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
    assembly = potential.assemble(u, p, travel, memory)
    for iteration in range(options.max_iterations):
        if not assembly.smallest_J > 0.0:
            return Equilibrium(u, p, assembly, False, "an element turned inside out", iteration)
        norm = float(np.linalg.norm(assembly.gradient))
        if norm <= options.tolerance * assembly.force_scale:
            return Equilibrium(u, p, assembly, True, "", iteration)
        negative = solver.factorise(assembly.data)
        near = negative == 0 and norm <= options.near * assembly.force_scale
        if potential.has_friction and near:
            nearer = _nearer(potential, solver, u, p, assembly, travel, memory, options)
            if nearer is not None:
                u, p, assembly = nearer
                recent.clear()
                continue
        du = potential.expand(
            descent_direction(potential, solver, assembly.gradient, options, negative)
        )
        if not np.isfinite(du).all():
            return Equilibrium(u, p, assembly, False, "the tangent is singular", iteration)
        recent.append(assembly.energy)
        slope = float(np.sum(du.ravel()[potential.problem.pattern.number >= 0] * assembly.gradient))
        reference = max(recent) if negative == 0 else assembly.energy
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
            return Equilibrium(u, p, assembly, False, "no descent along the step", iteration)
        dp = potential.pressure_step(du)
        u = u + fraction * du
        ordinary = 0.2 <= fraction <= 1.0
        p = p + fraction * dp if ordinary else potential.consistent_pressure(u)
        before = assembly.frame
        assembly = potential.assemble(u, p, travel, memory)
        if before is not None:  # energies looked back on: as if frozen where we are now
            shift = assembly.energy - potential.energy(u, travel, memory, before)
            recent = deque((e + shift for e in recent), maxlen=options.memory)
    return Equilibrium(
        u, p, assembly, False, "the iteration did not settle", options.max_iterations
    )


def _nearer(
    potential: NewtonProblem[Memory],
    solver: SymmetricSolver,
    u: Array,
    p: Array,
    assembly: Assembly,
    travel: float,
    memory: Memory,
    options: NewtonOptions,
) -> tuple[Array, Array, Assembly] | None:
    """Full Newton step with friction, if it reduces the residual: (u, p, assembly) there, or None.

    Friction has no energy that decides, and where the frozen one has a maximum along the step, its
    descent and the thaw after it go round in circles.
    """
    b = -assembly.gradient
    du = potential.expand(solve_coupled(potential, solver, b, options.coupling_tolerance))
    if not np.abs(du).max() < options.max_move:  # so is NaN
        return None
    dp = potential.pressure_step(du)
    trial = potential.assemble(u + du, p + dp, travel, memory)
    reduced = np.linalg.norm(trial.gradient) < options.reduction * np.linalg.norm(b)
    if trial.smallest_J > 0.0 and reduced:
        return u + du, p + dp, trial
    potential.assemble(u, p, travel, memory)  # what the solves below are of
    return None


def _line_search(
    potential: NewtonProblem[Memory],
    u: Array,
    du: Array,
    travel: float,
    memory: Memory,
    frame: Frame | None,
    reference: float,
    slope: float,
    indefinite: bool,
    options: NewtonOptions,
) -> float:
    """Accepted fraction of du, 0 when none is; longer than 1 only along negative curvature."""
    largest = float(np.abs(du).max())
    fraction = min(1.0, options.max_move / max(largest, 1e-300))
    slack = 1e-12 * abs(reference)
    shortened = False
    for _ in range(12):
        energy = potential.energy(u + fraction * du, travel, memory, frame)
        if energy <= reference + 1e-4 * fraction * slope + slack:
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
