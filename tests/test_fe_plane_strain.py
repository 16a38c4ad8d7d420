"""The block under a bar in plane strain: closed form, solid model, energy, convergence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fe import BlockPin, BlockPinModel, Contact, Status
from fe.closed_forms import pure_shear
from fe.contact import Faces
from fe.contact_memory import initial_memory
from fe.discretisation import pattern
from fe.linear_solver import SymmetricSolver
from fe.load_stepping import TravelState, march
from fe.materials.material import mooney_rivlin_of_ratios
from fe.newton import NewtonOptions
from fe.parameters import Parameters
from fe.potential import Potential
from fe.steps import March, StepOptions
from fe.surface_slopes import no_slopes
from fe.ties import Stick

RATIOS = np.array([0.4, 0.1])
CONTACTS = pytest.mark.parametrize(
    "contact", [("stick", "stick"), ("slide", "slide"), (0.3, 0.2)], ids=["stick", "slide", "rub"]
)


def model(contact, cells=(4, 2, 1), **changes) -> BlockPinModel:
    m = BlockPinModel(
        BlockPin(),
        Contact(*contact),
        cells,
        (0.2, 0.4),
        field_grid=(4, 3),
        newton=NewtonOptions(tolerance=1e-9),
        plane_strain=True,
    )
    return replace(m, **changes)


def test_under_a_frictionless_platen_the_force_is_that_of_pure_shear():
    platen = BlockPin(pin_width=40.0)
    m = model(("slide", "slide"), (2, 1, 1), specimen=platen)
    material = mooney_rivlin_of_ratios(RATIOS, 1.0, 2.0 * m.bulk_ratio)
    top = m.discretise().elements.positions[:, 1] > platen.height - 1e-9
    for state in m.solve(RATIOS)[0]:
        stretch = 1.0 + state.u[top, 1] / platen.height
        np.testing.assert_allclose(stretch, stretch[0], rtol=1e-7)
        expected = -pure_shear(material, stretch[0])[0] * platen.width * platen.depth / 4.0
        np.testing.assert_allclose(state.pin_force, expected, rtol=1e-7)


def between_walls(m: BlockPinModel, nz: int) -> list[TravelState]:
    """States of a solid quarter of `nz` elements along z that only its end faces keep plane."""
    solid = replace(m, plane_strain=False, cells=(*m.cells[:2], nz))
    discrete = solid.discretise()
    half_depth = m.specimen.depth / 2.0
    inside = discrete.faces.points[..., 2].min(axis=1) < half_depth - 1e-6
    faces = Faces(*(part[inside] for part in discrete.faces))
    fixed = (discrete.pattern.number < 0).reshape(-1, 3)
    fixed[discrete.elements.positions[:, 2] > half_depth - 1e-9, 2] = True
    discrete = replace(
        discrete,
        faces=faces,
        pattern=pattern(discrete.elements.nodes, faces.nodes, fixed.ravel()),
        glued=discrete.glued[inside],
    )
    problem = solid.problem(discrete, RATIOS)
    memory = initial_memory(faces, discrete.glued, problem.pin)
    solver = SymmetricSolver(discrete.pattern.indptr, discrete.pattern.indices)
    try:
        return list(
            march(
                Potential(problem),
                solver,
                memory,
                m.travel,
                March(),
                parameters=Parameters(
                    (), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 1, 3)), no_slopes(faces, 0)
                ),
                stick=Stick(m.contact.pin == "stick", m.contact.base == "stick"),
                steps=m.steps,
                newton=m.newton,
            )
        )
    finally:
        solver.close()


@CONTACTS
def test_the_force_is_that_of_a_solid_block_between_frictionless_walls(contact):
    m = model(contact, (3, 2, 1))
    plane = m.solve(RATIOS)[0]
    solid = between_walls(m, 2)
    assert len(solid) == len(plane) == 2
    for a, b in zip(plane, solid, strict=True):
        assert b.pin_force == pytest.approx(a.pin_force, rel=1e-7)
        assert b.energy == pytest.approx(a.energy, rel=1e-7)
        assert np.abs(b.u[:, 2]).max() < 1e-7


@CONTACTS
def test_the_field_is_plane_and_the_force_goes_with_the_depth(contact):
    m = model(contact)
    thin = replace(m, specimen=BlockPin(depth=1.0))
    one, two = m(RATIOS), thin(RATIOS)
    assert one.status is Status.CONVERGED
    np.testing.assert_allclose(two.force, 0.1 * one.force, rtol=1e-7)
    np.testing.assert_allclose(two.displacement, one.displacement, atol=1e-7)
    assert not one.displacement[..., 2].any()
    assert one.displacement[-1, :, 0].max() > 0.1


@pytest.mark.lasting
def test_the_force_of_a_block_with_free_ends_comes_near_as_it_gets_deeper():
    """It must stick: a block that slides gets longer along z everywhere, however deep it is."""
    m = model(("stick", "stick"), travel=(0.2,))
    plane = m(RATIOS).force[0]
    missing = []
    for depth, nz in ((10.0, 4), (20.0, 8)):
        solid = replace(m, plane_strain=False, cells=(4, 2, nz))
        deep = replace(solid, specimen=BlockPin(depth=depth))(RATIOS).force[0]
        missing.append(1.0 - deep / (plane * depth / m.specimen.depth))
    assert (np.array(missing) > 0.0).all()
    # what the ends lack is the same, whatever the depth
    assert missing[1] / missing[0] == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("contact", [("slide", "slide"), ("stick", "stick")], ids=str)
def test_the_work_of_the_pin_is_stored(contact):
    m = model(contact, travel=tuple(np.linspace(0.02, 0.5, 25)))
    states = m.solve(RATIOS)[0]
    work = np.trapezoid([0.0, *(s.pin_force for s in states)], [0.0, *m.travel])
    assert states[-1].energy == pytest.approx(work, rel=1e-3)


@pytest.mark.slow  # 64 elements across; the solid block between walls has the same force, above
def test_the_force_converges_as_the_mesh_gets_finer():
    """From 12 elements across on: 8 are as near as 16, as errors of either sign make up there."""

    def of(n: int) -> float:
        m = model(("stick", "stick"), (n, n // 2, 1), travel=(0.2,), sensitivities=())
        return m(RATIOS).force[0]

    force = np.array([of(n) for n in (12, 24, 48, 64)])
    coarse, middle, fine = np.abs(force[:-1] - force[-1]) / force[-1]
    assert middle < 0.3 * coarse
    assert fine < 0.3 * middle
    assert fine < 1e-3


def test_a_shifted_bar_gives_the_mirrored_field():
    right, left = (
        model(("stick", "stick"), specimen=BlockPin(pin_shift=(s, 0.0)))(RATIOS)
        for s in (0.5, -0.5)
    )
    np.testing.assert_allclose(left.force, right.force, rtol=1e-7)
    flip = left.displacement.reshape(2, 8, 3, 3)[:, ::-1].reshape(2, 24, 3) * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose(flip, right.displacement, atol=1e-7)


@pytest.mark.lasting
@CONTACTS
def test_sensitivities_match_central_differences(contact):
    m, h = model(contact, (3, 2, 1), steps=StepOptions(0.1, 0.1)), 1e-4
    base = m(RATIOS)
    for j, step in enumerate(h * np.eye(2)):
        plus, minus = m(RATIOS + step), m(RATIOS - step)
        force = (plus.force - minus.force) / (2 * h)
        np.testing.assert_allclose(base.force_gradient[:, j], force, rtol=1e-4)


@pytest.mark.parametrize(
    "changes",
    [
        {"cells": (4, 2, 2)},
        {"specimen": BlockPin(pin="round")},
        {"specimen": BlockPin(pin_rotation=5.0)},
        {"symmetry": "full"},
    ],
)
def test_what_is_not_plane_is_refused(changes):
    with pytest.raises(ValueError, match="plane_strain: expected a bar along z"):
        model(("stick", "stick"), **changes)


def test_a_force_that_falls_on_the_way_is_told():
    """Frictionless on a coarse mesh a row of nodes snaps past the fillet near 0.95 mm."""
    m = model(("slide", "slide"), (4, 3, 1), travel=(0.9, 1.0))
    r = replace(m, newton=NewtonOptions())(np.zeros(2))
    assert r.status is Status.CONVERGED
    assert r.message.startswith("reached every asked travel; the force falls at a travel of 0.9")
    early = replace(m, travel=(0.5,))(np.zeros(2))
    assert early.message == "reached every asked travel"
