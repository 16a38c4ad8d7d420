"""A bounded, constrained problem, and its evaluations: counted, remembered, never fatal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class DifferenceSteps:
    """Steps of finite differences: the larger of relative * |x| and absolute, per variable.

    The thesis' optimiser (section 4.4.3) has 0.1 for both, central.
    Raises ValueError for steps that are not positive.
    """

    relative: float = 0.0
    absolute: float = 1e-6

    def __post_init__(self) -> None:
        if not (self.relative >= 0 and self.absolute > 0):
            raise ValueError(
                "relative, absolute: expected relative >= 0 and absolute > 0, got "
                f"{self.relative}, {self.absolute}"
            )

    def at(self, x: Array) -> Array:
        """(n,) steps at x (n,)."""
        steps: Array = np.maximum(self.relative * np.abs(x), self.absolute)
        return steps


@dataclass(frozen=True)
class Problem:
    """Minimise objective(x) subject to lower <= x <= upper and constraints(x) <= 0.

    A function that returns a number that is not finite has failed there (a solver that did not
    converge): the point is not admissible, as with the exit code of thesis section 4.4.2. Where
    no gradient is given, differences with `steps` are taken, central where the bounds allow.
    Raises ValueError for bounds that are no box.
    """

    objective: Callable[[Array], float]
    lower: Array
    """(n,) may be -inf"""
    upper: Array
    """(n,) may be inf"""
    gradient: Callable[[Array], Array] | None = None
    """(n,) of the objective"""
    constraints: Callable[[Array], Array] | None = None
    """(m,) values, feasible where none is above zero"""
    constraint_jacobian: Callable[[Array], Array] | None = None
    """(m, n)"""
    steps: DifferenceSteps = DifferenceSteps()

    def __post_init__(self) -> None:
        if self.lower.ndim != 1 or self.lower.shape != self.upper.shape:
            raise ValueError(
                f"lower, upper: expected two vectors of one length, got shapes "
                f"{self.lower.shape} and {self.upper.shape}"
            )
        if not np.all(self.lower < self.upper):
            raise ValueError(
                f"lower, upper: expected lower < upper, got {self.lower} and {self.upper}"
            )

    @property
    def n(self) -> int:
        """Number of variables."""
        return self.lower.size

    def inside(self, x: Array) -> Array:
        """The point of the box next to x (n,)."""
        clipped: Array = np.clip(x, self.lower, self.upper)
        return clipped


class Evaluations:
    """Values and slopes of a problem, counted; the same point is not asked twice in a row."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.n_objective = 0
        self.n_gradient = 0
        self.n_failed = 0
        self.knows_slope = True
        """whether all components of the last gradient were found"""
        self._last: tuple[bytes, float] | None = None

    def value(self, x: Array) -> float:
        """Objective at x (n,); infinite where it failed."""
        key = x.tobytes()
        if self._last is None or self._last[0] != key:
            self.n_objective += 1
            value = float(self.problem.objective(x))
            if not np.isfinite(value):
                self.n_failed += 1
                value = np.inf
            self._last = (key, value)
        return self._last[1]

    def constraints(self, x: Array) -> Array:
        """(m,) constraints at x (n,), infinite where they failed; empty when there are none."""
        if self.problem.constraints is None:
            return np.zeros(0)
        found = np.atleast_1d(np.asarray(self.problem.constraints(x), dtype=np.float64))
        return np.where(np.isfinite(found), found, np.inf)

    def gradient(self, x: Array) -> Array:
        """(n,) gradient at x (n,): given, or by differences; zero where nothing is known."""
        self.n_gradient += 1
        if self.problem.gradient is not None:
            found = np.asarray(self.problem.gradient(x), dtype=np.float64)
        else:
            found = self._differences(lambda y: np.array([self.value(y)]), x)[0]
        self.knows_slope = bool(np.isfinite(found).all())
        return np.where(np.isfinite(found), found, 0.0)

    def jacobian(self, x: Array) -> Array:
        """(m, n) of the constraints at x (n,); zero where nothing is known."""
        if self.problem.constraints is None:
            return np.zeros((0, x.size))
        if self.problem.constraint_jacobian is not None:
            found = np.asarray(self.problem.constraint_jacobian(x), dtype=np.float64)
        else:
            found = self._differences(self.constraints, x)
        return np.where(np.isfinite(found), found, 0.0)

    def _differences(self, function: Callable[[Array], Array], x: Array) -> Array:
        """(m, n) central differences; one-sided at a bound or where a side failed, NaN at both."""
        middle = function(x)
        columns = []
        for i, step in enumerate(self.problem.steps.at(x)):
            values, places = [], []
            for sign in (-1.0, 1.0):
                moved = x.copy()
                moved[i] += sign * step
                within = self.problem.lower[i] <= moved[i] <= self.problem.upper[i]
                side = function(moved) if within else np.full(middle.shape, np.inf)
                good = bool(np.isfinite(side).all())
                values.append(side if good else middle)
                places.append(moved[i] if good else x[i])
            width = places[1] - places[0]
            columns.append((values[1] - values[0]) / (width if width > 0 else np.nan))
        return np.stack(columns, axis=1)
