"""The equilibrium iteration: what it must not take for an equilibrium."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fe.newton import NewtonOptions, equilibrate


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
