"""SciPy's SLSQP and trust-constr behind the interface of `feasible_directions`."""

from __future__ import annotations

import warnings
from typing import Any, Literal

import numpy as np
from scipy.optimize import Bounds, NonlinearConstraint, minimize, nnls

from calib.optimize.minimum import Minimum, Settings, Status, minimum_of
from calib.optimize.problem import Array, Evaluations, Problem

WALL = 10.0
"""where the objective failed it counts as that of the start plus this many times (1 + its size):
these methods know no failure, and a far higher wall would spoil their line searches"""
MET = 1e3
"""times the tolerance of constraints, within which these methods meet them"""


def slsqp(problem: Problem, start: Array, settings: Settings | None = None) -> Minimum:
    """Sequential least squares (Kraft 1988). Raises ValueError for a start of another length."""
    return _run("SLSQP", problem, start, settings or Settings())


def trust_constr(problem: Problem, start: Array, settings: Settings | None = None) -> Minimum:
    """SciPy's trust-region interior point. Raises ValueError for a start of another length."""
    return _run("trust-constr", problem, start, settings or Settings())


def _run(
    method: Literal["SLSQP", "trust-constr"], problem: Problem, start: Array, settings: Settings
) -> Minimum:
    if start.shape != problem.lower.shape:
        raise ValueError(f"start: expected shape {problem.lower.shape}, got {start.shape}")
    ask = Evaluations(problem)
    x = problem.inside(np.asarray(start, dtype=np.float64))
    path = [x]
    first = ask.value(x)
    if not np.isfinite(first):
        return minimum_of(ask, path, Status.FAILED_START, 0)
    options: Any = {"maxiter": settings.max_iterations}
    options |= {"ftol": _change(settings, first)} if method == "SLSQP" else _radii(settings)

    best = first if _met(ask, x, settings) else np.inf

    def value(point: Array) -> float:
        """The objective inside the bounds; a wall where it fails. Keeps the path of the best."""
        nonlocal best
        inside = problem.inside(point)
        found = ask.value(inside)
        if not np.isfinite(found):
            return first + WALL * (1.0 + abs(first))
        if found < best and _met(ask, inside, settings):
            best = found
            path.append(inside)
        return found

    with warnings.catch_warnings():
        # Its quasi-Newton update warns where the gradient did not change; it then does nothing.
        warnings.simplefilter("ignore")
        result = minimize(
            value,
            x,
            jac=lambda point: ask.gradient(problem.inside(point)),
            method=method,
            bounds=Bounds(problem.lower, problem.upper, keep_feasible=True),
            constraints=_constraints(ask, method),
            options=options,
        )
    end = problem.inside(result.x)
    if not _met(ask, path[-1], settings):
        return minimum_of(ask, path, Status.INFEASIBLE, int(result.nit))
    # Where the method ends at a wall of failures, the best point seen is not its end.
    at_end = ask.value(end) <= ask.value(path[-1]) + 1e-6 * (1.0 + abs(best))
    done = {0} if method == "SLSQP" else {1, 2}
    if at_end and _met(ask, end, settings) and not np.array_equal(end, path[-1]):
        path.append(end)  # a point that violates a little more may have been a little lower
    if result.status in done and at_end:
        status = _how_settled(ask, start, path[-1], settings)
    elif result.nit >= settings.max_iterations:
        status = Status.MAX_ITERATIONS
    else:
        status = Status.BLOCKED
    return minimum_of(ask, path, status, int(result.nit))


def _how_settled(ask: Evaluations, start: Array, x: Array, settings: Settings) -> Status:
    """Whether the gradient that bounds and constraints leave is small (Karush, Kuhn and Tucker).

    These methods stop on a small change, too, and where no gradient is known.
    """
    problem = ask.problem
    size = float(np.linalg.norm(ask.gradient(problem.inside(start))))
    gradient = ask.gradient(x)
    normals = _active_normals(ask, x, settings)
    if problem.constraints is None or normals.size == 0:  # nnls crashes on no columns
        left = float(np.linalg.norm(problem.inside(x - gradient) - x))
    else:
        left = nnls(normals, -gradient)[1]
    if not ask.knows_slope:
        return Status.NO_GRADIENT
    is_small = left <= settings.kkt_tolerance * (1.0 + size)
    return Status.CONVERGED if is_small else Status.SMALL_CHANGE


def _active_normals(ask: Evaluations, x: Array, settings: Settings) -> Array:
    """(n, m) outward normals at x (n,) of the constraints and bounds that it lies on."""
    problem = ask.problem
    near = MET * settings.feasibility
    on = ask.constraints(x) >= -near
    unit = np.eye(x.size)
    lower, upper = x <= problem.lower + near, x >= problem.upper - near
    return np.concatenate([ask.jacobian(x)[on], -unit[lower], unit[upper]]).T


def _change(settings: Settings, value: float) -> float:
    """Change of the objective at which SLSQP stops."""
    given = max(settings.relative_change * abs(value), settings.absolute_change)
    return given or 1e-12


def _radii(settings: Settings) -> dict[str, float | int]:
    return {"gtol": 1e-2 * settings.kkt_tolerance, "xtol": 1e-12, "barrier_tol": 1e-10}


def _constraints(ask: Evaluations, method: str) -> Any:
    if ask.problem.constraints is None:
        return ()
    if method == "SLSQP":
        return {
            "type": "ineq",
            "fun": lambda x: -ask.constraints(x),
            "jac": lambda x: -ask.jacobian(x),
        }
    return NonlinearConstraint(ask.constraints, -np.inf, 0.0, jac=ask.jacobian)


def _met(ask: Evaluations, x: Array, settings: Settings) -> bool:
    """Whether the constraints hold as well as these methods make them."""
    worst = np.max(ask.constraints(x), initial=-np.inf)
    return bool(worst <= MET * settings.feasibility)
