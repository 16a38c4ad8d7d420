"""The equilibrium iteration: what it must not take for an equilibrium."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fe import BlockPin, BlockPinModel, Contact
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


@pytest.mark.parametrize("contact", [Contact("stick", "stick"), Contact("slide", "slide")])
def test_an_older_factor_ends_where_new_ones_do(monkeypatch, contact):
    """And needs fewer factorisations than where each iterate is factorised."""
    newton, steps = NewtonOptions(tolerance=1e-9), StepOptions(first=0.05)  # all of one length
    model = BlockPinModel(BlockPin(), contact, (6, 3, 2), (0.3, 0.5), newton=newton, steps=steps)
    lagged = model([0.5, 0.05])
    monkeypatch.setattr(SymmetricSolver, "solve_positive", lambda *_: None)
    factorised = model([0.5, 0.05])
    np.testing.assert_allclose(lagged.force, factorised.force, rtol=1e-8)
    np.testing.assert_allclose(lagged.displacement, factorised.displacement, atol=1e-8)
    assert lagged.n_factorisations < 0.7 * factorised.n_factorisations
