"""What must hold for friction on every pin, checked by finite differences on a few faces."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from fe.contact import ContactSystem, Faces, empty_system
from fe.contact_memory import ContactMemory
from fe.contact_slopes import contact_pull
from fe.discretisation import sum_to_nodes
from fe.friction import Frame, friction_system, frozen_energy
from fe.pin_surface import RigidPin
from fe.surface_slopes import SurfaceSlopes, no_slopes
from fe.touch import FLOOR, PIN, FrictionLaw

LAW = FrictionLaw(0.3, 0.7, 0.01)
TRAVEL = 0.4
STATES = pytest.mark.parametrize("slipped", [1e-3, 7e-3, 0.2], ids=["stick", "between", "slip"])
"""mm that anchors are behind the points, about"""


class Patch(NamedTuple):
    """Faces with displacements that touch pin and floor at TRAVEL, and anchors some way behind."""

    faces: Faces
    u: np.ndarray
    memory: ContactMemory
    """with random gradients in four parameters"""
    pin: RigidPin


class Friction(NamedTuple):
    """Friction alone."""

    frame: Frame
    energy: float
    pin_force: float
    system: ContactSystem
    coupling: np.ndarray


def evaluate(patch: Patch, travel: float = TRAVEL, law: FrictionLaw = LAW) -> Friction:
    """Friction of a patch, in the frame frozen there."""
    faces, (ties, slip) = patch.faces, (patch.memory.ties, patch.memory.slip)
    system = empty_system(faces)
    coupling = np.zeros_like(system.tangent)
    found = friction_system(
        patch.u, faces, ties.kind, slip.place, travel, patch.pin, law, system, coupling
    )
    return Friction(*found, system, coupling)


def coefficients(faces: Faces) -> SurfaceSlopes:
    """Slopes of two parameters that change no surface, and the coefficients of pin and base."""
    law = np.eye(4)[[2, 3]]
    return no_slopes(faces, 4)._replace(friction_pin=law[PIN], friction_base=law[FLOOR])


def assert_tangent_with_coupling_is_the_derivative_of_the_forces(patch: Patch) -> None:
    """In the displacements and in the travel."""
    system, coupling = evaluate(patch)[-2:]
    h = 1e-8
    du = np.random.default_rng(1).standard_normal(patch.u.shape)
    plus, minus = (evaluate(patch._replace(u=patch.u + k * h * du)) for k in (1, -1))
    along = du[patch.faces.nodes]
    change = np.einsum("caikb,cbk->cai", system.tangent + coupling, along)
    expected = (plus.system.force - minus.system.force) / (2 * h)
    np.testing.assert_allclose(change, expected, atol=2e-5 * np.abs(expected).max())
    force = np.sum(system.pin_force_by_u * along)
    assert force == pytest.approx((plus.pin_force - minus.pin_force) / (2 * h), rel=1e-5)
    plus, minus = (evaluate(patch, TRAVEL + k * h) for k in (1, -1))
    expected = (plus.system.force - minus.system.force) / (2 * h)
    np.testing.assert_allclose(system.by_travel, expected, atol=2e-5 * np.abs(expected).max())


def assert_frozen_potential_has_the_true_forces(patch: Patch) -> None:
    """And the energy."""
    found, h = evaluate(patch), 1e-6

    def energy(shift: float | np.ndarray) -> float:
        return float(frozen_energy(patch.u + shift, patch.faces, found.frame, TRAVEL, LAW.slip))

    assert energy(0.0) == pytest.approx(found.energy, rel=1e-12)
    du = np.random.default_rng(2).standard_normal(patch.u.shape)
    along = np.sum(found.system.force * du[patch.faces.nodes])
    assert along == pytest.approx((energy(h * du) - energy(-h * du)) / (2 * h), rel=1e-6)


def assert_pull_of_anchors_and_coefficients_is_the_derivative_of_the_forces(patch: Patch) -> None:
    """In all four parameters."""
    faces, memory, h = patch.faces, patch.memory, 1e-7
    remembered, slopes = (memory.ties, memory.slip), coefficients(faces)
    nodal, on_pin = contact_pull(patch.u, faces, *remembered, TRAVEL, patch.pin, LAW, slopes)
    for j in range(4):
        sides = []
        for k in (1, -1):
            moved = memory.copy()
            moved.slip.place[...] += k * h * memory.slip.gradient[..., j]
            law = LAW._replace(
                pin=LAW.pin + k * h * (j == 2 + PIN), base=LAW.base + k * h * (j == 2 + FLOOR)
            )
            sides.append(evaluate(patch._replace(memory=moved), law=law))
        plus, minus = sides
        change = (plus.system.force - minus.system.force) / (2 * h)
        expected = sum_to_nodes(faces.nodes, change, len(patch.u))
        np.testing.assert_allclose(nodal[..., j], expected, atol=1e-5 * np.abs(expected).max())
        assert on_pin[j] == pytest.approx((plus.pin_force - minus.pin_force) / (2 * h), rel=1e-5)
