"""What a minimiser is told and what it returns: a status, never a crash."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from calib.optimize.problem import Array, Evaluations


class Status(StrEnum):
    """How a minimisation ended; the value is the sentence."""

    CONVERGED = "no feasible direction leads down: a Karush-Kuhn-Tucker point"
    SMALL_CHANGE = "the objective no longer changed by more than the tolerances"
    MAX_ITERATIONS = "stopped at the largest number of iterations"
    BLOCKED = "no step along the direction found was better"
    INFEASIBLE = "no point that meets the constraints was found"
    NO_GRADIENT = "a component of the gradient could not be found"
    FAILED_START = "the objective failed at the start"


@dataclass(frozen=True)
class Settings:
    """When to stop. Defaults are for exact gradients; `THESIS` are those of thesis 4.4.3.

    Raises ValueError for impossible numbers.
    """

    max_iterations: int = 200
    relative_change: float = 0.0
    """of the objective over one iteration"""
    absolute_change: float = 0.0
    n_small: int = 1
    """iterations in a row with changes that small, which end the search"""
    kkt_tolerance: float = 1e-6
    """of the projected gradient, relative to 1 + |gradient at the start|"""
    feasibility: float = 1e-8
    """largest value of a constraint that still counts as met"""

    def __post_init__(self) -> None:
        if self.max_iterations < 1 or self.n_small < 1:
            raise ValueError(
                "max_iterations, n_small: expected 1 or more, got "
                f"{self.max_iterations}, {self.n_small}"
            )


THESIS = Settings(
    max_iterations=15, relative_change=1e-4, absolute_change=1e-6, n_small=6, kkt_tolerance=1e-9
)
"""15 iterations, six small changes in a row; 1^-4 and 1^-6 there are read as 1e-4 and 1e-6"""


@dataclass(frozen=True)
class Minimum:
    """The best admissible point found."""

    x: Array
    """(n,)"""
    value: float
    """infinite where the objective failed at the start"""
    violation: float
    """largest constraint, 0 where all are met"""
    status: Status
    n_iterations: int
    n_objective: int
    """evaluations, those of differences included"""
    n_failed: int
    """evaluations that gave no finite number"""
    path: Array
    """(n_iterations + 1, n) points from the start on; the last is x"""

    @property
    def success(self) -> bool:
        """Whether a stopping rule was met."""
        return self.status in (Status.CONVERGED, Status.SMALL_CHANGE)

    @property
    def message(self) -> str:
        """The status as a sentence."""
        return str(self.status)


def minimum_of(
    evaluations: Evaluations, path: list[Array], status: Status, n_iterations: int
) -> Minimum:
    """The last point of a path as a result."""
    x = path[-1]
    worst = float(np.max(evaluations.constraints(x), initial=0.0))
    return Minimum(
        x=x,
        value=evaluations.value(x),
        violation=max(worst, 0.0),
        status=status,
        n_iterations=n_iterations,
        n_objective=evaluations.n_objective,
        n_failed=evaluations.n_failed,
        path=np.array(path),
    )
