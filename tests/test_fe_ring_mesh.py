"""Meshes whose lines follow the rim of a round pin: geometry, forces, derivatives, refusals."""

from __future__ import annotations

import itertools
import math
from dataclasses import astuple, replace

import numpy as np
import pytest

from benchmarks.grid_convergence import CASES
from benchmarks.mesh_convergence import similar
from benchmarks.taylor import moved, names, rubber
from fe import BlockPin, BlockPinModel, Contact, Rings, Status
from fe.newton import NewtonOptions
from fe.specimens.mesh_lines import is_grid
from fe.steps import StepOptions

ROUND = BlockPin(pin="round")
STUCK, SLIDING, RUBBING = Contact(), Contact("slide", "slide"), Contact(0.3, 0.2)
CONTACTS = pytest.mark.parametrize(
    "contact", [STUCK, SLIDING, RUBBING], ids=["stick", "slide", "friction"]
)


def small(contact: Contact, specimen: BlockPin = ROUND) -> BlockPinModel:
    return BlockPinModel(
        specimen,
        contact,
        Rings(3, 2, 1),
        (0.1, 0.2),
        field_grid=(4, 3),
        newton=NewtonOptions(tolerance=1e-11),
        steps=StepOptions(first=0.18, largest=0.18),
    )


@CONTACTS
def test_elements_fill_the_quarter_and_rings_are_circles_under_the_rim(contact):
    block = BlockPin(width=9.0, depth=11.0, pin="round")
    model = BlockPinModel(block, contact, Rings(16, 3, 3), (0.1,))
    mesh = model.mesh()
    assert mesh.nelements == (3 * 3 + 16 * 6) * 3
    assert not is_grid(mesh.p)
    table = model.discretise().elements
    assert table.weights.sum() == pytest.approx(4.5 * 5.5 * 2.5, rel=1e-12)
    assert table.weights.min() > 0.0
    radius = np.unique(np.hypot(mesh.p[0], mesh.p[2]).round(9))
    on_rim = radius[(radius > 1.4) & (radius < 2.2)]
    for r in on_rim:  # seven rays meet each circle, once a layer
        assert np.isclose(np.hypot(mesh.p[0], mesh.p[2]), r).sum() == 7 * 4
    assert on_rim.size >= 4


@pytest.mark.parametrize("case", [case for case in CASES if case.pin == "round"], ids=str)
def test_rings_of_the_convergence_study_are_similar(case):
    """The core's lines and those of rings and layers that two meshes should share, they share."""
    contact = Contact(case.interface, case.interface)
    for one, other in itertools.combinations([mesh.cells for mesh in similar(case)], 2):
        x, y = [], []
        for cells in (one, other):
            points = BlockPinModel(ROUND, contact, cells, (0.1,)).mesh().p
            x.append(np.unique(points[0, (points[1] == 0.0) & (points[2] == 0.0)]))
            y.append(np.unique(points[1]))
        core = one.sectors
        assert core == other.sectors
        np.testing.assert_allclose(x[0][:core], x[1][:core], rtol=0, atol=1e-12)
        rings, layers = (
            math.gcd(*n) for n in zip(astuple(one)[:2], astuple(other)[:2], strict=True)
        )
        shared = [v[core :: cells.rings // rings] for v, cells in zip(x, (one, other), strict=True)]
        np.testing.assert_allclose(*shared, rtol=0, atol=1e-12)
        shared = [v[:: cells.layers // layers] for v, cells in zip(y, (one, other), strict=True)]
        np.testing.assert_allclose(*shared, rtol=0, atol=1e-12)


@pytest.mark.lasting
def test_rings_and_a_grid_take_the_same_force_and_bulge_alike():
    one, other = (
        BlockPinModel(ROUND, SLIDING, cells, (0.3,), sensitivities=()).respond(rubber())
        for cells in (Rings(5, 3, 2), (6, 3, 6))
    )
    np.testing.assert_allclose(one.force, other.force, rtol=0.01)
    difference = np.sqrt(np.mean((one.displacement - other.displacement) ** 2))
    assert difference < 0.05 * np.sqrt(np.mean(other.displacement**2))


def test_gradients_of_a_homogeneous_deformation_are_exact():
    model = BlockPinModel(ROUND, SLIDING, Rings(3, 2, 1), (0.1,), sensitivities=())
    table = model.discretise().elements
    stretch = np.array([0.03, -0.06, 0.03])
    H = np.einsum("eqja,eai->eqij", table.gradients, (table.positions * stretch)[table.nodes])
    np.testing.assert_allclose(H, np.broadcast_to(np.diag(stretch), H.shape), atol=1e-13)


ALONG = {
    "width": 0.7,
    "depth": -0.4,
    "height": 0.5,
    "pin_width": -0.9,
    "pin_fillet": 0.3,
    "C10": 0.6,
}
"""a direction that changes all at once, no two alike: two solves in place of twelve"""


@CONTACTS
@pytest.mark.lasting
def test_derivatives_are_central_differences_of_whole_solutions(contact):
    block = small(contact)
    base = replace(block, sensitivities=tuple(ALONG)).respond(rubber())
    assert base.status is Status.CONVERGED, base.message
    h = 1e-5
    sides = []
    for step in (h, -h):
        there = block
        for name, share in ALONG.items():
            there, law = moved(there, name, share * step)  # C10 is the last
        sides.append(there.respond(law))
    force = (sides[0].force - sides[1].force) / (2 * h)
    field = (sides[0].displacement - sides[1].displacement) / (2 * h)
    shares = np.array(list(ALONG.values()))
    terms = np.abs(base.force_gradient * shares).max(axis=0)
    assert terms.min() > 1e-3 * terms.max()  # so that none is missed
    np.testing.assert_allclose(base.force_gradient @ shares, force, atol=2e-5 * terms.max())
    np.testing.assert_allclose(
        base.displacement_gradient @ shares, field, atol=2e-5 * np.abs(field).max()
    )


@pytest.mark.lasting
def test_the_adjoint_agrees_with_the_direct_derivatives():
    block = small(RUBBING)
    block = replace(block, sensitivities=names(block))
    base = block.respond(rubber())
    weights = np.random.default_rng(0).standard_normal(base.displacement.shape)
    found = block.objective_gradients(rubber(), lambda i, field, force: (weights[i], 0.3))
    expected = 0.3 * base.force_gradient
    expected = expected + np.einsum("ipk,ipkj->ij", weights, base.displacement_gradient)
    assert (np.abs(found - expected).max(axis=0) <= 1e-8 * np.abs(expected).max(axis=0)).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Rings(0, 2), "rings: expected a whole number"),
        (lambda: small(STUCK, BlockPin()), "cells: expected for rings a quarter model of a round"),
        (lambda: small(STUCK, replace(ROUND, pin_width=8.0)), "at most 0.7 times as wide"),
        (lambda: small(STUCK, replace(ROUND, pin_shift=(0.1, 0.0))), "found a half model"),
        (lambda: small(STUCK, replace(ROUND, depth=16.0)), "sides of a ratio up to 1.5"),
    ],
)
def test_what_rings_cannot_follow_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
