"""Constrained minimisers on problems with known Karush-Kuhn-Tucker points."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import rosen, rosen_der

from calib.optimize import (
    METHODS,
    DifferenceSteps,
    Problem,
    Settings,
    Status,
    best_of,
    feasible_directions,
    multistart,
)
from calib.optimize.direction import find_direction

INF = np.inf


def rosen_suzuki() -> Problem:
    """Rosen and Suzuki 1965 (Hock-Schittkowski 43): minimum -44 at (0, 1, 2, -1)."""

    def objective(x: np.ndarray) -> float:
        a, b, c, d = x
        return a**2 + b**2 + 2 * c**2 + d**2 - 5 * a - 5 * b - 21 * c + 7 * d

    def constraints(x: np.ndarray) -> np.ndarray:
        a, b, c, d = x
        return np.array(
            [
                a**2 + b**2 + c**2 + d**2 + a - b + c - d - 8,
                a**2 + 2 * b**2 + c**2 + 2 * d**2 - a - d - 10,
                2 * a**2 + b**2 + c**2 + 2 * a - b - d - 5,
            ]
        )

    return Problem(
        objective,
        np.full(4, -INF),
        np.full(4, INF),
        gradient=lambda x: np.array([2 * x[0] - 5, 2 * x[1] - 5, 4 * x[2] - 21, 2 * x[3] + 7]),
        constraints=constraints,
        constraint_jacobian=lambda x: np.array(
            [
                [2 * x[0] + 1, 2 * x[1] - 1, 2 * x[2] + 1, 2 * x[3] - 1],
                [2 * x[0] - 1, 4 * x[1], 2 * x[2], 4 * x[3] - 1],
                [4 * x[0] + 2, 2 * x[1] - 1, 2 * x[2], -1],
            ]
        ),
    )


def hs35() -> Problem:
    """Hock-Schittkowski 35 (Beale): minimum 1/9 at (4/3, 7/9, 4/9), x >= 0."""

    def objective(x: np.ndarray) -> float:
        a, b, c = x
        linear = 9 - 8 * a - 6 * b - 4 * c
        return linear + 2 * a * a + 2 * b * b + c * c + 2 * a * b + 2 * a * c

    return Problem(
        objective,
        np.zeros(3),
        np.full(3, INF),
        constraints=lambda x: np.array([x[0] + x[1] + 2 * x[2] - 3]),
    )


def hs76() -> Problem:
    """Hock-Schittkowski 76: minimum -4.681818 at (0.2727, 2.0909, 0, 0.5455), x >= 0."""

    def objective(x: np.ndarray) -> float:
        a, b, c, d = x
        square = a**2 + 0.5 * b**2 + c**2 + 0.5 * d**2
        return square - a * c + c * d - a - 3 * b + c - d

    return Problem(
        objective,
        np.zeros(4),
        np.full(4, INF),
        constraints=lambda x: np.array(
            [
                x[0] + 2 * x[1] + x[2] + x[3] - 5,
                3 * x[0] + x[1] + 2 * x[2] - x[3] - 4,
                1.5 - x[1] - 4 * x[2],
            ]
        ),
    )


def bounded_rosenbrock() -> Problem:
    """Rosenbrock's valley cut by x1 <= 0.5: minimum 0.25 at (0.5, 0.25)."""
    return Problem(rosen, np.array([-2.0, -2.0]), np.array([0.5, 2.0]), gradient=rosen_der)


CASES = {
    "rosen-suzuki": (rosen_suzuki, [0.0, 0, 0, 0], [0, 1, 2, -1], -44.0),
    "hs35": (hs35, [0.5, 0.5, 0.5], [4 / 3, 7 / 9, 4 / 9], 1 / 9),
    "hs76": (hs76, [0.5, 0.5, 0.5, 0.5], [3 / 11, 23 / 11, 0, 6 / 11], -4.6818181818),
    "rosenbrock": (bounded_rosenbrock, [-1.9, 1.5], [0.5, 0.25], 0.25),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("case", CASES)
def test_every_method_reaches_the_known_point(case: str, method: str) -> None:
    make, start, x, value = CASES[case]
    settings = Settings(max_iterations=2000)
    found = METHODS[method](make(), np.array(start, dtype=float), settings)
    assert found.value == pytest.approx(value, abs=1e-4)
    assert found.x == pytest.approx(x, abs=5e-3)
    assert found.violation <= 1e-5
    assert found.n_objective > 0
    assert found.path[-1] == pytest.approx(found.x)


@pytest.mark.parametrize("case", CASES)
def test_feasible_directions_stays_feasible_and_never_goes_up(case: str) -> None:
    make, start, _, _ = CASES[case]
    problem = make()
    found = feasible_directions(problem, np.array(start, dtype=float))
    values = np.array([problem.objective(x) for x in found.path])
    assert np.all(np.diff(values) < 0)
    assert np.all((found.path >= problem.lower) & (found.path <= problem.upper))
    if problem.constraints is not None:
        assert max(problem.constraints(x).max() for x in found.path) <= 1e-8


def test_a_start_outside_is_led_back() -> None:
    found = feasible_directions(rosen_suzuki(), np.full(4, 5.0), Settings(max_iterations=500))
    assert found.violation <= 1e-8
    assert found.value == pytest.approx(-44.0, abs=1e-3)


def test_no_feasible_point_is_a_status() -> None:
    box = (np.array([-1.0]), np.array([1.0]))
    problem = Problem(lambda x: float(x[0]), *box, constraints=lambda x: np.array([2.0 - x[0]]))
    found = feasible_directions(problem, np.array([0.0]))
    assert found.status is Status.INFEASIBLE
    assert not found.success


def failing_beyond(limit: float) -> Problem:
    """(x - 2)^2 whose solver fails beyond a limit, as an FE model may."""
    return Problem(
        lambda x: float((x[0] - 2) ** 2) if x[0] <= limit else np.nan,
        np.array([0.0]),
        np.array([10.0]),
        gradient=lambda x: 2 * (x - 2),
    )


@pytest.mark.parametrize("method", METHODS)
def test_a_solver_that_fails_ends_no_search(method: str) -> None:
    found = METHODS[method](failing_beyond(1.5), np.array([0.1]), Settings(max_iterations=300))
    assert found.n_failed > 0
    assert 0.9 < found.x[0] <= 1.5
    assert np.isfinite(found.value)


@pytest.mark.parametrize("method", METHODS)
def test_a_failed_start_is_a_status(method: str) -> None:
    found = METHODS[method](failing_beyond(1.5), np.array([3.0]), None)
    assert found.status is Status.FAILED_START
    assert found.value == np.inf


def test_a_gradient_of_which_a_component_is_not_known_is_no_minimum() -> None:
    """At (0, 3) the one that is known is zero, and the value would fall along the other."""
    box = np.full(2, 5.0)
    problem = Problem(
        lambda x: float(x[0] ** 2 + (x[1] - 1.0) ** 2) if x[1] == 3.0 else np.nan, -box, box
    )
    found = feasible_directions(problem, np.array([1.0, 3.0]), None)
    assert found.x == pytest.approx([0.0, 3.0], abs=1e-3)
    assert found.status is Status.NO_GRADIENT


def nowhere_differentiable(x: np.ndarray) -> float:
    """x^2 of a solver that works at (3, 3) alone."""
    return float(x @ x) if np.array_equal(x, [3.0, 3.0]) else np.nan


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("gradient", [None, lambda x: np.full(2, np.nan)])
def test_a_gradient_that_cannot_be_found_is_no_minimum(method: str, gradient) -> None:
    box = np.full(2, 5.0)
    problem = Problem(nowhere_differentiable, -box, box, gradient=gradient)
    found = METHODS[method](problem, np.array([3.0, 3.0]), None)
    assert found.status is Status.NO_GRADIENT
    assert not found.success


@pytest.mark.parametrize("method", METHODS)
def test_a_failed_start_is_not_the_best_of_minima(method: str) -> None:
    """On the line x + y = 2, which SciPy's methods meet to 1e-9; the start fails beyond it."""
    problem = Problem(
        lambda x: float((x - 2.0) @ (x - 2.0)) if x[0] > -4.0 else np.nan,
        np.full(2, -5.0),
        np.full(2, 5.0),
        gradient=lambda x: 2.0 * (x - 2.0),
        constraints=lambda x: np.array([x.sum() - 2.0]),
        constraint_jacobian=lambda x: np.ones((1, 2)),
    )
    starts = [np.array([-4.5, 0.0]), np.array([0.0, 0.3])]
    failed, found = (METHODS[method](problem, start, None) for start in starts)
    assert failed.status is Status.FAILED_START
    assert best_of([failed, found]) is found
    infeasible = replace(found, value=0.0, violation=0.1)
    assert best_of([infeasible, failed, found]) is found
    # both meet the constraint, the lower one to 1e-9 as SciPy's methods make it
    lower, exact = (replace(found, value=v, violation=g) for v, g in ((1.0, 1e-9), (2.0, 0.0)))
    assert best_of([exact, lower]) is lower


def test_differences_are_those_asked_and_stay_in_the_box() -> None:
    asked: list[float] = []

    def objective(x: np.ndarray) -> float:
        asked.append(float(x[0]))
        return float(x[0] ** 2)

    problem = Problem(objective, np.zeros(1), np.full(1, 9.0), steps=DifferenceSteps(0.1, 0.1))
    feasible_directions(problem, np.array([5.0]), Settings(max_iterations=1))
    assert 4.5 in asked and 5.5 in asked
    asked.clear()
    found = feasible_directions(problem, np.array([0.02]), Settings(max_iterations=5))
    assert min(asked) >= 0.0
    # The wide one-sided step sees a slope that is not there: the search may stop, not leave.
    assert found.x[0] >= 0.0


def test_direction_leads_down_and_off_the_constraint_and_slides_on_the_bound() -> None:
    rows = np.array([[1.0, 2.0], [-1.0, 0.5], [-1.0, 0.0]])
    found = find_direction(rows, np.array([1.0, 1.0, 0.0]), np.eye(2))
    assert rows[0] @ found.d < 0
    assert rows[1] @ found.d < 0
    assert rows[2] @ found.d <= 1e-12
    blocked = find_direction(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.ones(2), np.eye(2))
    assert blocked.slope == pytest.approx(0.0, abs=1e-12)


def test_random_convex_quadratics_agree_with_slsqp() -> None:
    rng = np.random.default_rng(8)
    for _ in range(20):
        n = 4
        root = rng.normal(size=(n, n))
        matrix, linear = root @ root.T + 0.1 * np.eye(n), rng.normal(size=n)
        rows, limit = rng.normal(size=(3, n)), rng.uniform(0.1, 1.0, 3)
        problem = Problem(
            lambda x, a=matrix, b=linear: float(0.5 * x @ a @ x + b @ x),
            np.full(n, -1.0),
            np.full(n, 1.0),
            gradient=lambda x, a=matrix, b=linear: a @ x + b,
            constraints=lambda x, a=rows, b=limit: a @ x - b,
            constraint_jacobian=lambda x, a=rows: a,
        )
        ours = feasible_directions(problem, np.zeros(n), Settings(max_iterations=1000))
        theirs = METHODS["slsqp"](problem, np.zeros(n), None)
        assert ours.value == pytest.approx(theirs.value, abs=1e-4)


def ellipsoids(rng: np.random.Generator) -> tuple[Problem, np.ndarray]:
    """A convex quadratic within two ellipsoids and a box, and a start that may violate them."""
    n = int(rng.integers(2, 5))
    root = rng.normal(size=(n, n))
    matrix = root @ root.T + 10 ** rng.uniform(-3, 0) * np.eye(n)
    linear, size = rng.normal(size=n) * 10 ** rng.uniform(-2, 2), 10 ** rng.uniform(-4, 4)
    centre, radius = 0.3 * rng.normal(size=(2, n)), rng.uniform(0.5, 2, 2)
    axes = np.array([rng.uniform(0.3, 3, n) for _ in range(2)])
    problem = Problem(
        lambda x: float(size * (0.5 * x @ matrix @ x + linear @ x)),
        np.where(rng.random(n) < 0.5, -0.5, -3.0),
        np.where(rng.random(n) < 0.5, 0.5, 3.0),
        gradient=lambda x: size * (matrix @ x + linear),
        constraints=lambda x: np.sum(axes * (x - centre) ** 2, axis=1) - radius**2,
        constraint_jacobian=lambda x: 2.0 * axes * (x - centre),
    )
    return problem, rng.uniform(-3, 3, n)


def test_curved_constraints_end_no_search_and_agree_with_slsqp() -> None:
    """One of these crashed where the thickness of constraints changed after a direction."""
    rng = np.random.default_rng(5)
    agreed = 0
    for _ in range(50):
        problem, start = ellipsoids(rng)
        ours = feasible_directions(problem, start, Settings(max_iterations=2000))
        theirs = METHODS["slsqp"](problem, start, Settings(max_iterations=500))
        if ours.success and theirs.success:
            agreed += 1
            assert ours.value == pytest.approx(theirs.value, rel=1e-3, abs=1e-6)
    assert agreed > 25


def test_multistart_keeps_the_order_and_knows_the_best() -> None:
    starts = [np.array([-1.0, 1.0]), np.array([0.4, 0.1])]
    found = multistart(bounded_rosenbrock(), starts)
    assert [m.path[0].tolist() for m in found] == [s.tolist() for s in starts]
    assert best_of(found).value == min(m.value for m in found)
    with pytest.raises(ValueError, match="method"):
        multistart(bounded_rosenbrock(), starts, method="simplex")
    with pytest.raises(ValueError, match="starts"):
        multistart(bounded_rosenbrock(), [])


def test_wrong_problems_are_refused() -> None:
    with pytest.raises(ValueError, match="lower < upper"):
        Problem(rosen, np.ones(2), np.ones(2))
    with pytest.raises(ValueError, match="start"):
        feasible_directions(bounded_rosenbrock(), np.zeros(3))
    with pytest.raises(ValueError, match="relative, absolute"):
        DifferenceSteps(0.1, 0.0)
    with pytest.raises(ValueError, match="max_iterations"):
        Settings(max_iterations=0)


def test_optimize_is_a_leaf() -> None:
    folder = Path(__file__).parent.parent / "calib" / "optimize"
    for path in folder.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("calib"):
                assert (node.module or "").startswith("calib.optimize")


def test_what_only_changes_little_is_not_called_a_point_of_karush_kuhn_tucker() -> None:
    """A flat valley: one step changes its bottom by less than the tolerance, far from the end."""
    problem = Problem(rosen, np.full(2, -INF), np.full(2, INF), gradient=rosen_der)
    loose = Settings(relative_change=0.5, kkt_tolerance=1e-9)
    found = METHODS["slsqp"](problem, np.array([-1.2, 1.0]), loose)
    assert found.status is Status.SMALL_CHANGE
    assert np.abs(rosen_der(found.x)).max() > 1e-3


@pytest.mark.parametrize(("limit", "status"), [(9.0, Status.SMALL_CHANGE), (0.0, Status.CONVERGED)])
def test_constraints_that_do_not_bind_make_no_point_of_karush_kuhn_tucker(limit, status) -> None:
    """The same valley with a constraint far off; and with one that holds the way to its end."""
    problem = Problem(
        rosen if limit else lambda x: float(x[0] + x[1]),
        np.full(2, -INF),
        np.full(2, INF),
        gradient=rosen_der if limit else lambda x: np.ones(2),
        constraints=lambda x: np.array([x @ x - 2.0 if not limit else x[0] - limit]),
        constraint_jacobian=lambda x: np.array([2.0 * x if not limit else [1.0, 0.0]]),
    )
    if limit:
        settings = Settings(relative_change=0.5, kkt_tolerance=1e-9)
    else:
        settings = Settings(relative_change=0.0, absolute_change=0.0)
    found = METHODS["slsqp"](problem, np.array([-1.2, 1.0]), settings)
    assert found.status is status
