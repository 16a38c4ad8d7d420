"""The equilibrium iteration: what it must not take for an equilibrium."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fe import BlockPin, BlockPinModel, Contact, newton
from fe.linear_solver import SymmetricSolver
from fe.newton import NewtonOptions, equilibrate
from fe.steps import StepOptions


@pytest.mark.parametrize(("energy", "smallest_J"), [(np.inf, 0.5), (np.inf, -0.5)])
def test_a_state_without_finite_energy_does_not_converge(energy, smallest_J):
    """A law that ends at a dilation of -1 leaves arrays incomplete there, though det F > 0."""
    assembly = SimpleNamespace(
        energy=energy, smallest_J=smallest_J, gradient=np.zeros(1), force_scale=1.0
    )
    potential = SimpleNamespace(assemble=lambda *_: assembly, has_friction=False)
    state = np.zeros((1, 3)), np.zeros((1, 1))
    found = equilibrate(potential, None, *state, 0.1, None, NewtonOptions())
    assert not found.converged
    assert found.reason == "an element turned inside out"


@pytest.mark.lasting
@pytest.mark.parametrize("contact", [Contact("stick", "stick"), Contact("slide", "slide")])
def test_an_older_factor_ends_where_new_ones_do(monkeypatch, contact):
    """And needs fewer factorisations than where each iterate is factorised."""
    options, steps = NewtonOptions(tolerance=1e-9), StepOptions(first=0.05)  # all of one length
    model = BlockPinModel(BlockPin(), contact, (6, 3, 2), (0.3, 0.5), newton=options, steps=steps)
    lagged = model([0.5, 0.05])
    monkeypatch.setattr(SymmetricSolver, "solve_positive", lambda *_: None)
    factorised = model([0.5, 0.05])
    np.testing.assert_allclose(lagged.force, factorised.force, rtol=1e-8)
    np.testing.assert_allclose(lagged.displacement, factorised.displacement, atol=1e-8)
    assert lagged.n_factorisations < 0.7 * factorised.n_factorisations


@pytest.mark.lasting
def test_a_march_over_negative_curvature_ends_where_new_factors_do(monkeypatch):
    """Rows snap past the pin's edge: tangents turn indefinite within steps."""
    options, steps = NewtonOptions(tolerance=1e-9), StepOptions(first=0.05)
    model = BlockPinModel(
        BlockPin(), Contact("slide", "slide"), (8, 3, 1), (0.8, 1.2), newton=options, steps=steps
    )
    counted: list[int] = []
    factorise = SymmetricSolver.factorise

    def count(self: SymmetricSolver, data: np.ndarray) -> int:
        counted.append(factorise(self, data))
        return counted[-1]

    monkeypatch.setattr(SymmetricSolver, "factorise", count)
    lagged = model([0.5, 0.05])
    assert max(counted) > 0
    monkeypatch.setattr(SymmetricSolver, "solve_positive", lambda *_: None)
    factorised = model([0.5, 0.05])
    np.testing.assert_allclose(lagged.force, factorised.force, rtol=1e-6)
    np.testing.assert_array_equal(lagged.negative_pivots, 0)


class Saddle:
    """Energy x^2 / 2 + y^4 / 4 - y^2 / 2: a saddle at (0, 0), minima at (0, 1) and (0, -1)."""

    has_friction, n_unknowns = False, 3

    def __init__(self) -> None:
        self.problem = SimpleNamespace(pattern=SimpleNamespace(number=np.arange(3)))

    def energy(self, u, *_):
        x, y, z = u[0]
        return 0.5 * (x * x + z * z) + 0.25 * y**4 - 0.5 * y * y

    def assemble(self, u, p, *_):
        x, y, z = u[0]
        return SimpleNamespace(
            energy=self.energy(u),
            smallest_J=1.0,
            gradient=np.array([x, y**3 - y, z]),
            data=np.array([1.0, 0.0, 0.0, 3.0 * y * y - 1.0, 0.0, 1.0]),
            force_scale=1.0,
            frame=None,
        )

    def expand(self, free):
        return free[None]

    def pressure_step(self, du):
        return np.zeros((1, 1))

    consistent_pressure = pressure_step


def test_a_saddle_that_an_older_factor_leads_to_is_left():
    """Its negative mode is hardly in the residual, so conjugate gradients never meet it."""
    solver = SymmetricSolver(
        np.array([0, 3, 5, 6], np.int32), np.array([0, 1, 2, 1, 2, 2], np.int32)
    )
    jump = Saddle()
    whole = jump.assemble

    def assemble(u, p, *rest):
        at = whole(u, p, *rest)
        if abs(u[0, 0]) > 0.05:  # far off along x: another, positive, curvature along y
            at.data[3] = 2.0
            at.gradient[1] = 0.0
        return at

    jump.assemble = assemble
    start = np.array([[0.2, 1e-7, 0.0]])
    found = equilibrate(
        jump, solver, start, np.zeros((1, 1)), 0.1, None, NewtonOptions(max_move=0.14)
    )
    assert found.converged
    assert abs(found.u[0, 1]) == pytest.approx(1.0, abs=1e-3)
    solver.close()


class Valley:
    """Energy sqrt(1 + x^2) + (y^2 + z^2) / 2, whose whole Newton step from x goes to -x^3."""

    has_friction, n_unknowns = False, 3

    def __init__(self) -> None:
        self.problem = SimpleNamespace(pattern=SimpleNamespace(number=np.arange(3)))
        self.assembled: list[float] = []
        self.pressed: list[float] = []

    def energy(self, u, *_):
        x, y, z = u[0]
        return np.sqrt(1.0 + x * x) + 0.5 * (y * y + z * z)

    def assemble(self, u, p, *_):
        x, y, z = u[0]
        self.assembled.append(float(x))
        root = np.sqrt(1.0 + x * x)
        return SimpleNamespace(
            energy=self.energy(u),
            smallest_J=1.0,
            gradient=np.array([x / root, y, z]),
            data=np.array([1.0 / root**3, 0.0, 0.0, 1.0, 0.0, 1.0]),
            force_scale=1.0,
            frame=None,
        )

    def expand(self, free):
        return free[None]

    def pressure_step(self, du):
        self.pressed.append(self.assembled[-1])
        return np.zeros((1, 1))

    consistent_pressure = pressure_step


def test_a_whole_step_that_goes_up_is_taken_back_and_shortened():
    valley = Valley()
    solver = SymmetricSolver(
        np.array([0, 3, 5, 6], np.int32), np.array([0, 1, 2, 1, 2, 2], np.int32)
    )
    start = np.array([[2.0, 0.0, 0.0]])
    found = equilibrate(
        valley, solver, start, np.zeros((1, 1)), 0.1, None, NewtonOptions(max_move=20.0, memory=1)
    )
    assert found.converged
    np.testing.assert_allclose(found.u, 0.0, atol=1e-6)
    assert valley.assembled[:3] == pytest.approx([2.0, -8.0, 2.0])  # the last anew
    assert valley.pressed[0] == 2.0
    solver.close()


def test_steps_of_a_stuck_block_are_accepted_whole_without_a_search(monkeypatch):
    searches, search = 0, newton._line_search

    def count(*arguments):
        nonlocal searches
        searches += 1
        return search(*arguments)

    monkeypatch.setattr(newton, "_line_search", count)
    BlockPinModel(BlockPin(), Contact("stick", "stick"), (4, 2, 1), (0.3,))([0.5, 0.05])
    assert searches == 0


def test_derivatives_leave_the_factor_that_predicts_with_friction(monkeypatch):
    """So a prediction costs a back-substitution."""
    held: list[np.ndarray] = []  # kept, so that no identity is given twice
    predicted = 0
    solve = SymmetricSolver.solve_general

    def see(self, matrix, b, *, transposed=False):
        nonlocal predicted
        if b.ndim == 1:
            assert any(matrix.data is data for data in held)
            predicted += 1
        else:
            held.append(matrix.data)
        return solve(self, matrix, b, transposed=transposed)

    monkeypatch.setattr(SymmetricSolver, "solve_general", see)
    BlockPinModel(BlockPin(), Contact(0.3, 0.3), (5, 2, 1), (0.3,))([0.5, 0.05])
    assert predicted == len(held) - 1  # none after the last step
