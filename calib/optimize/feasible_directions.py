"""The method of feasible directions for bounds and inequality constraints.

Every iterate is feasible once one was: steps go down and away from the constraints that are nearly
active (see `direction`), as long as the objective falls, the constraints hold and the objective
does not fail. The thickness within which a constraint counts as active shrinks as the descent does
(Vanderplaats 1984). The modified method remembers earlier iterations; here by a damped BFGS metric
(Powell 1978), without which it is steepest descent with its zigzag.
"""

from __future__ import annotations

import numpy as np

from calib.optimize.direction import Direction, find_direction
from calib.optimize.minimum import Minimum, Settings, Status, minimum_of
from calib.optimize.problem import Array, Evaluations, Problem

THICKNESS = 0.1
"""of a constraint that counts as active at the start, in its own unit"""
THINNEST = 1e-7
SHORTEST = 1e-10
ARMIJO = 1e-4
GROWTH = 2.0


def feasible_directions(
    problem: Problem, start: Array, settings: Settings | None = None
) -> Minimum:
    """Minimise from `start` (n,), moved into the bounds; a failure is a status.

    A start that violates constraints is first led back to where they hold. Steps to points where
    the objective fails are shortened. Raises ValueError for a start of another length.
    """
    if start.shape != problem.lower.shape:
        raise ValueError(f"start: expected shape {problem.lower.shape}, got {start.shape}")
    return _Search(problem, settings or Settings()).run(np.asarray(start, dtype=np.float64))


class _Search:
    """State of one minimisation: path, metric, thickness of the constraints."""

    def __init__(self, problem: Problem, settings: Settings) -> None:
        self._problem = problem
        self._settings = settings
        self._ask = Evaluations(problem)
        self._metric = np.eye(problem.n)
        self._fresh = True
        self._thickness = THICKNESS
        self._near = np.zeros(0, dtype=np.bool_)
        self._path: list[Array] = []

    def run(self, start: Array) -> Minimum:
        """Lead back, then go down until a rule ends it."""
        x = self._problem.inside(start)
        self._path.append(x)
        if not np.isfinite(self._ask.value(x)):
            return self._end(Status.FAILED_START)
        back = self._lead_back(x)
        if back is None:
            return self._end(Status.INFEASIBLE)
        return self._end(self._descend(back))

    def _end(self, status: Status) -> Minimum:
        return minimum_of(self._ask, self._path, status, len(self._path) - 1)

    @property
    def _left(self) -> int:
        return self._settings.max_iterations - (len(self._path) - 1)

    def _descend(self, x: Array) -> Status:
        small = 0
        gradient = self._ask.gradient(x)
        tolerance = self._settings.kkt_tolerance * (1.0 + float(np.linalg.norm(gradient)))
        while self._left > 0:
            value = self._ask.value(x)
            jacobian = self._ask.jacobian(x)
            direction = self._direction(x, gradient, jacobian, tolerance)
            if direction is None:
                return Status.CONVERGED if self._ask.knows_slope else Status.NO_GRADIENT
            moved = self._line_search(x, value, gradient, direction)
            if moved is None:
                if not self._fresh:  # a metric learnt elsewhere may be to blame
                    self._metric, self._fresh = np.eye(x.size), True
                    continue
                if self._thickness > THINNEST and len(self._ask.constraints(x)):
                    self._thickness = max(0.1 * self._thickness, THINNEST)
                    continue
                return Status.BLOCKED
            new_gradient = self._ask.gradient(moved)
            self._learn(x, moved, gradient, new_gradient, jacobian, direction)
            change = value - self._ask.value(moved)
            self._path.append(moved)
            small = small + 1 if self._is_small(change, value) else 0
            if small >= self._settings.n_small:
                return Status.SMALL_CHANGE
            x, gradient = moved, new_gradient
        return Status.MAX_ITERATIONS

    def _is_small(self, change: float, value: float) -> bool:
        rules = self._settings
        relative = change <= rules.relative_change * abs(value) and rules.relative_change > 0
        absolute = change <= rules.absolute_change and rules.absolute_change > 0
        return relative or absolute

    def _direction(
        self, x: Array, gradient: Array, jacobian: Array, tolerance: float
    ) -> Direction | None:
        """A direction that leads down by more than the tolerance, or None at a KKT point."""
        while True:
            rows, push = self._rows(x, gradient, jacobian)
            found = find_direction(rows, push, self._metric)
            # In the plain metric, whatever was learnt: |d| is the projected gradient.
            plain = find_direction(rows, push, np.eye(x.size))
            if np.linalg.norm(plain.d) > tolerance and found.slope > 0:
                self._thickness = max(min(self._thickness, found.slope), THINNEST)
                return found
            if self._thickness <= THINNEST or not len(jacobian):
                return None
            self._thickness = max(0.1 * self._thickness, THINNEST)

    def _rows(self, x: Array, gradient: Array, jacobian: Array) -> tuple[Array, Array]:
        """Gradients that must not grow, objective first, and their push-off factors.

        A constraint is pushed off by (1 + g / thickness)^2: not at all at the edge of its
        thickness, fully where it is active; a linear bound may be slid along.
        """
        values = self._ask.constraints(x)
        near = values > -self._thickness
        size = np.linalg.norm(jacobian, axis=1)
        near &= size > 0
        self._near = near
        push = (1.0 + np.minimum(values[near], 0.0) / self._thickness) ** 2
        scale = np.linalg.norm(gradient) / size[near] if near.any() else size[near]
        at_low, at_high = x <= self._problem.lower, x >= self._problem.upper
        unit = np.eye(x.size)
        rows = [gradient[None], jacobian[near] * scale[:, None], -unit[at_low], unit[at_high]]
        n_bounds = int(at_low.sum() + at_high.sum())
        return np.concatenate(rows), np.concatenate([[1.0], push, np.zeros(n_bounds)])

    def _line_search(
        self, x: Array, value: float, gradient: Array, direction: Direction
    ) -> Array | None:
        """An admissible better point along the direction: halved, or doubled while it pays."""
        d = direction.d
        step = 1.0
        best: Array | None = None
        best_value = value
        while step * np.abs(d).max() > SHORTEST * (1.0 + np.abs(x).max()):
            moved = self._problem.inside(x + step * d)
            reached = self._admissible_value(moved)
            promised = min(ARMIJO * float(gradient @ (moved - x)), 0.0)
            if reached < best_value and reached <= value + promised:
                best, best_value = moved, reached
                if not self._fresh:
                    return best
                step *= GROWTH
                continue
            if best is not None:
                return best
            step *= 0.5
        return best

    def _admissible_value(self, x: Array) -> float:
        """Objective where all constraints hold, else infinite."""
        if np.max(self._ask.constraints(x), initial=-np.inf) > self._settings.feasibility:
            return np.inf
        return self._ask.value(x)

    def _learn(
        self,
        x: Array,
        moved: Array,
        gradient: Array,
        new_gradient: Array,
        jacobian: Array,
        direction: Direction,
    ) -> None:
        """Damped BFGS update with the change of the Lagrangian's gradient."""
        step = moved - x
        change = new_gradient - gradient
        if len(jacobian) and direction.multipliers[0] > 1e-8:
            change = change + self._curvature_of_constraints(x, moved, gradient, direction)
        curved = self._metric @ step
        along = float(step @ curved)
        if along <= 0.0:
            return
        if self._fresh:  # the size of the first metric is that of the curvature seen
            ratio = float(change @ change) / max(float(step @ change), 1e-300)
            if step @ change > 0 and np.isfinite(ratio):
                self._metric = np.eye(x.size) * ratio
                curved = self._metric @ step
                along = float(step @ curved)
        gained = float(step @ change)
        mix = 1.0 if gained >= 0.2 * along else 0.8 * along / (along - gained)
        change = mix * change + (1.0 - mix) * curved
        updated = (
            self._metric
            - np.outer(curved, curved) / along
            + np.outer(change, change) / float(step @ change)
        )
        if np.isfinite(updated).all() and np.linalg.eigvalsh(updated).min() > 0:
            self._metric, self._fresh = updated, False

    def _curvature_of_constraints(
        self, x: Array, moved: Array, gradient: Array, direction: Direction
    ) -> Array:
        """Change of the near constraints' gradients, weighted as in the Lagrangian."""
        before, after = self._ask.jacobian(x), self._ask.jacobian(moved)
        # those of the direction's multipliers: the thickness may have changed since
        near, size = self._near, np.linalg.norm(before, axis=1)
        weights = direction.multipliers[1 : 1 + int(near.sum())] / direction.multipliers[0]
        scale = np.linalg.norm(gradient) / size[near]
        total: Array = (weights * scale) @ (after - before)[near]
        return total

    def _lead_back(self, x: Array) -> Array | None:
        """A feasible point from x: steps that push off the violated constraints."""
        settings = self._settings
        while True:
            values = self._ask.constraints(x)
            worst = float(np.max(values, initial=-np.inf))
            if worst <= settings.feasibility:
                return x
            if self._left <= 0 or not np.isfinite(worst):
                return None
            moved = self._step_back(x, values, worst)
            if moved is None:
                return None
            self._path.append(moved)
            x = moved

    def _step_back(self, x: Array, values: Array, worst: float) -> Array | None:
        """A point with a smaller violation, with a finite objective, along one direction."""
        jacobian = self._ask.jacobian(x)
        size = np.linalg.norm(jacobian, axis=1)
        violated = (values > 0.5 * worst) & (size > 0)
        if not violated.any():
            return None
        at_low, at_high = x <= self._problem.lower, x >= self._problem.upper
        unit = np.eye(x.size)
        rows = np.concatenate(
            [jacobian[violated] / size[violated][:, None], -unit[at_low], unit[at_high]]
        )
        push = np.concatenate(
            [np.ones(violated.sum()), np.zeros(int(at_low.sum() + at_high.sum()))]
        )
        d = find_direction(rows, push, np.eye(x.size)).d
        fall = -(jacobian[violated] @ d)
        if not np.all(fall > 0):
            return None
        # A little beyond where the linear constraints would hold, for they are seldom linear.
        step = 1.1 * float(np.max(values[violated] / fall))
        while step * np.abs(d).max() > SHORTEST * (1.0 + np.abs(x).max()):
            moved = self._problem.inside(x + step * d)
            new_worst = float(np.max(self._ask.constraints(moved)))
            if new_worst < worst and np.isfinite(self._ask.value(moved)):
                return moved
            step *= 0.5
        return None
