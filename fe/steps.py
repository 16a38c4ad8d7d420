"""Steps to the asked travels or forces: their sizes, when one fails, and what became of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fe.force_control import Found, Start, Way, step_to_force, step_to_travel
from fe.linear_solver import SymmetricSolver
from fe.newton_problem import NewtonProblem
from fe.positive_numbers import positive_numbers
from fe.progress import Progress, StepReport
from fe.response import Status
from fe.singular_tangent import SingularTangentError

LEAP = 2.0
"""nodal displacement beyond the predicted one, over the step's travel, that is a jump: from rest,
where nothing is predicted, nodes move about as far as the pin"""
MOST_STEPS = 300
"""to one asked force: a force beyond what the law can carry would be approached for ever"""


@dataclass(frozen=True)
class StepOptions:
    """Sizes of the load steps, mm of pin travel."""

    first: float = 0.01
    largest: float = 0.05
    """longer ones end on another path with friction, tie what sticks late, and snap more often"""
    smallest: float = 1e-3
    """at most an eighth of the others: a step that fails is halved"""

    def __post_init__(self) -> None:
        positive_numbers(self)
        # shorter where a step is to be shorter: there must be room to halve it
        least = min(self.smallest, self.first / 8.0, self.largest / 8.0)
        object.__setattr__(self, "smallest", least)


@dataclass
class March:
    """Outcome of a march: filled as it goes (state)."""

    reached: float = 0.0
    reason: str = ""
    n_steps: int = 0
    n_iterations: int = 0
    """of the accepted steps"""
    n_cuts: int = 0
    largest_force: float = 0.0
    """of the modelled part in accepted steps, N"""
    good_until: float | None = None
    """travel of the last step before the solution may have left the wanted branch, mm"""
    left_by: Status | None = None
    """how, if it did"""
    warnings: dict[str, str] = field(default_factory=dict)
    """what may be wrong with what was reached, by kind"""
    n_unstable: int = 0
    """accepted steps with negative pivots, asked for or not"""
    unstable_from: float | None = None
    """travel of the first of them, mm"""
    listen: Progress | None = None
    """hears of each accepted step, forces those of the modelled part"""

    def accept(self, found: Found) -> None:
        """Count a step that ended there."""
        at = found.equilibrium
        self.reached = found.travel
        self.n_steps += 1
        self.n_iterations += at.iterations
        self.largest_force = max(self.largest_force, at.assembly.pin_force)
        if found.negative > 0:
            self.n_unstable += 1
            if self.unstable_from is None:
                self.unstable_from = found.travel
        if self.listen is not None:
            report = StepReport(found.travel, at.assembly.pin_force, at.iterations, found.negative)
            self.listen(report)

    def stop(self, reason: str, travel: float) -> None:
        """Say why no further step is made."""
        self.reason = f"{reason} at a travel of {travel:.4f} mm"

    def fall(self, found: Found) -> None:
        """Note that the force fell in a step that is about to be accepted."""
        self._leave(Status.FORCE_FELL)
        self.warn(
            "fall",
            f"the force falls at a travel of {found.travel:.4f} mm: another branch of "
            "equilibria, real or of the mesh, or a material that softens",
        )

    def jump(self, found: Found, *, leaves: bool) -> None:
        """Note a jump past unstable states in a step that is about to be accepted, if it has one.

        It `leaves` the wanted branch where no row of material can have snapped past an edge.
        """
        far = found.equilibrium.jump
        if not far > LEAP * (found.travel - self.reached):
            return
        why = "material snaps past the pin's edge, or the block bends into another shape"
        if leaves:
            self._leave(Status.JUMPED)
            why = "as the path before it turned unstable"
        self.warn(
            "jump",
            f"the solution jumps by {far:.3g} mm on the way to a travel of {found.travel:.4f} mm"
            f"{',' if leaves else ':'} {why}",
        )

    def leave_branch(self, found: Found) -> None:
        """Note a step about to be accepted that is on another branch than the wanted one."""
        self._leave(Status.JUMPED)
        self.warn(
            "branch",
            f"the solution leaves the wanted branch of equilibria, which has turned unstable, on "
            f"the way to a travel of {found.travel:.4f} mm",
        )

    def _leave(self, how: Status) -> None:
        if self.good_until is None:
            self.good_until, self.left_by = self.reached, how

    def warn(self, kind: str, warning: str, *, latest: bool = False) -> None:
        """Keep the first warning of each kind, or the latest of one that grows."""
        if latest or kind not in self.warnings:
            self.warnings[kind] = warning


def stride(
    potential: NewtonProblem[Any],
    solver: SymmetricSolver,
    way: Way,
    here: Start,
    targets: Sequence[float],
    steps: StepOptions,
    outcome: March,
) -> Iterator[float]:
    """Step from `here` to each target and yield it there, until one cannot be reached.

    Steps that do not converge are halved; a force gets `MOST_STEPS`.  What happened is left in
    `outcome`.
    """
    step, failed = steps.first, False
    for target in targets:
        arrived, by_force = False, way.control == "force"
        last = outcome.n_steps + MOST_STEPS
        while not arrived:
            if by_force and outcome.n_steps >= last:
                outcome.stop(f"the force was not met in {MOST_STEPS} steps", here.travel)
                return
            far = here.travel + step if by_force else _next_travel(here.travel, step, target)
            if by_force and not far < way.limit:
                far = 0.5 * (here.travel + way.limit)
                if far - here.travel < steps.smallest:
                    outcome.stop("nothing is left to compress, and the force is not met", far)
                    return
            try:
                if failed:
                    here = way.restore(here)  # the predictor needs its factor
                if by_force:
                    found = step_to_force(potential, solver, way, here, far, target)
                else:
                    found = step_to_travel(solver, way, here, far, target)
                reason, at = found.equilibrium.reason, found.travel
                failed = not found.equilibrium.converged
                if not failed:
                    here, arrived = way.accept(found), found.arrived
                    outcome.accept(found)
                    step = min(steps.largest, step * _growth(found.equilibrium.iterations))
                    continue
            except SingularTangentError as error:
                failed, reason, at = True, f"the tangent is singular ({error})", far
            outcome.n_cuts += 1
            step = (far - here.travel) / 2.0
            if step < steps.smallest:
                outcome.stop(reason, at)
                return
        yield target


def _next_travel(reached: float, step: float, target: float) -> float:
    """Equal steps to the target, so that no sliver of a step is left before it."""
    remaining = target - reached
    n = int(np.ceil(remaining / step - 1e-6))
    return target if n <= 1 else reached + remaining / n


def _growth(iterations: int) -> float:
    if iterations <= 6:
        return 1.5
    return 1.1 if iterations < 12 else 0.8
