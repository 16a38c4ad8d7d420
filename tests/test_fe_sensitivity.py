"""Sensitivities in material, contact and geometry: partial derivatives, direct, adjoint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.taylor import (
    PLACE,
    direct_adjoint_difference,
    moved,
    names,
    orders,
    rubber,
    size,
    steps_of,
    turned,
)
from benchmarks.taylor import model as small
from fe import BlockPin, BlockPinModel, Contact
from fe.contact import FREE, TIED_TO_FLOOR, TIED_TO_PIN, contact_system, empty_system
from fe.contact_memory import initial_memory
from fe.contact_slopes import contact_pull
from fe.directions import directions
from fe.discretisation import elements, sum_to_nodes
from fe.friction import friction_system
from fe.pin_surface import BAR, ROUND, RigidPin
from fe.sensitivity import adjoint
from fe.shape_slopes import residual_slopes
from fe.singular_tangent import SingularTangentError
from fe.surface_slopes import no_slopes
from fe.touch import FrictionLaw
from fe.weak_form import element_system
from fe.weak_form import empty_system as empty_elements
from tests.material_laws import make

STUCK, SLIDING, RUBBING = Contact(), Contact("slide", "slide"), Contact(0.3, 0.2)
CONTACTS = pytest.mark.parametrize(
    "contact", [STUCK, SLIDING, RUBBING], ids=["stick", "slide", "friction"]
)
TRAVEL = 0.4
PIN = {"height": 2.5, "half_width": 2.0, "fillet": 0.3, "stiffness": 500.0, "ramp": 0.1}
PIN |= {"base_stiffness": 200.0, "x": 0.2, "z": -0.3}


def quotient(of, h):
    """Central difference quotient of `of` at 0."""
    return (of(h) - of(-h)) / (2 * h)


@pytest.mark.parametrize("volumetric", ["quadratic", "simo-miehe"])
@pytest.mark.parametrize("law", ["mooney-rivlin-3", "ogden-2"])
def test_inner_forces_follow_a_moving_mesh(law, volumetric):
    """Distorted elements whose vertices move at random, against elements made anew there."""
    rng = np.random.default_rng(0)
    mesh = replace_points(small(SLIDING, (2, 1, 1)).mesh(), rng, 0.05)
    table, _ = elements(mesh)
    velocity = rng.standard_normal(mesh.p.shape)
    u = 0.05 * rng.standard_normal(table.positions.shape)
    material = make(law, 10.0, volumetric)

    def at(h):
        return elements(replace(mesh, doflocs=mesh.p + h * velocity))[0]

    def forces(h):
        system, now = empty_elements(table), at(h)
        no_pressure = np.zeros((len(now.nodes), now.psi.shape[1]))
        element_system(u, no_pressure, now, material.kernel(), False, system)
        total = np.zeros_like(u)
        np.add.at(total, now.nodes, system.residual)
        return total

    motion = quotient(lambda h: at(h).positions, 1e-3)
    along = directions(material, table, np.zeros((0, len(material.constants))), motion[None])
    found = np.zeros((*u.shape, 2))
    residual_slopes(u, table, material.kernel(), along, found)
    expected = quotient(forces, 1e-5)
    np.testing.assert_allclose(found[..., 1], expected, atol=1e-8 * np.abs(expected).max())


def replace_points(mesh, rng, size):
    """The mesh with its vertices moved at random."""
    return replace(mesh, doflocs=mesh.p + size * rng.standard_normal(mesh.p.shape))


def pressed(shape, rubs):
    """Faces, displacement, pin and memory with free and tied points on pin and floor."""
    angle = 0.0 if shape == ROUND else 0.3
    pin = RigidPin(**PIN, shape=shape, across_x=np.cos(angle), across_z=-np.sin(angle))
    block = BlockPinModel(BlockPin(pin_shift=(0.3, 0.0)), Contact("stick", 0.7), (3, 2, 2), (0.1,))
    faces = block.discretise().faces
    rng = np.random.default_rng(1)
    u = 0.1 * rng.standard_normal((faces.nodes.max() + 1, 3))
    u[:, 1] -= 0.15
    memory = initial_memory(faces, np.zeros(faces.weights.shape, bool), pin)
    if not rubs:
        ties = memory.ties
        ties.kind[::3, ::2] = TIED_TO_PIN
        ties.kind[1::3, ::3] = TIED_TO_FLOOR
        ties.kind[faces.base] = FREE
        ties.hold[...] = np.minimum(rng.uniform(0.1, 1.9, ties.hold.shape), 1.0)
        ties.anchor[...] += 0.05 * rng.standard_normal(ties.anchor.shape)
    return faces, u, pin, memory


def forces_of(faces, u, pin, memory, law):
    """Forces of the nodes and, last, that of the pin."""
    system = empty_system(faces)
    ties = memory.ties
    tied = ties.kind, ties.hold, ties.anchor
    on_pin = contact_system(u, faces, *tied, TRAVEL, pin, True, system)[1]
    coupling, place = np.zeros_like(system.tangent), memory.slip.place
    on_pin += friction_system(u, faces, ties.kind, place, TRAVEL, pin, law, system, coupling)[2]
    return np.append(sum_to_nodes(faces.nodes, system.force, len(u)), on_pin)


OF_PIN = ("height", "half_width", "fillet", "x", "z", "stiffness", "ramp", "base_stiffness")


@pytest.mark.parametrize("rubs", [False, True], ids=["frictionless and tied", "friction"])
@pytest.mark.parametrize("shape", [BAR, ROUND], ids=["bar", "round"])
def test_contact_forces_follow_pin_law_and_points(shape, rubs):
    """At fixed displacement; against kernels that get another pin, law or place of the points."""
    faces, u, pin, memory = pressed(shape, rubs)
    law = FrictionLaw(0.3, 0.7, 0.01) if rubs else FrictionLaw()
    of_law = ("pin", "base", "slip") if rubs else ()
    turned = ("angle",) if shape == BAR else ()
    n_p = len(OF_PIN) + len(of_law) + len(turned) + 1
    slopes = no_slopes(faces, n_p)
    rng = np.random.default_rng(2)
    points, weights = (rng.standard_normal(a.shape) for a in (faces.points, faces.weights))
    changes = []
    for name in OF_PIN:
        value = getattr(pin, name)
        changes.append(lambda h, name=name, value=value: {"pin": {name: value + h}})
    for name in of_law:
        value = getattr(law, name)
        changes.append(lambda h, name=name, value=value: {"law": {name: value + h}})
    if turned:
        at = np.arctan2(-pin.across_z, pin.across_x)
        changes.append(lambda h: {"pin": {"across_x": np.cos(at + h), "across_z": -np.sin(at + h)}})
    changes.append(
        lambda h: {
            "faces": {"points": faces.points + h * points, "weights": faces.weights + h * weights}
        }
    )
    fields = [
        *OF_PIN,
        *({"pin": "friction_pin", "base": "friction_base"}.get(n, n) for n in of_law),
    ]
    for j, field in enumerate([*fields, *turned]):
        getattr(slopes, field)[j] = 1.0
    slopes.points[..., -1], slopes.weights[..., -1] = points, weights
    ties = memory.ties._replace(
        anchor_gradient=np.zeros((*memory.ties.anchor.shape, n_p)),
        hold_gradient=np.zeros((*memory.ties.hold.shape, n_p)),
    )
    still = memory.slip._replace(gradient=np.zeros((*memory.slip.place.shape, n_p)))
    total, on_pin = contact_pull(u, faces, ties, still, TRAVEL, pin, law, slopes)
    nodal = total.reshape(-1, n_p)
    for j, change in enumerate(changes):

        def forces(h, change=change):
            now = change(h)
            return forces_of(
                faces._replace(**now.get("faces", {})),
                u,
                pin._replace(**now.get("pin", {})),
                memory,
                law._replace(**now.get("law", {})),
            )

        expected = quotient(forces, 1e-7)
        found = np.append(nodal[:, j], on_pin[j])
        largest = np.abs(expected[:-1]).max()
        assert largest > 0.0
        np.testing.assert_allclose(found[:-1], expected[:-1], atol=2e-5 * largest)
        np.testing.assert_allclose(found[-1], expected[-1], atol=1e-4 * largest)


def assert_derivatives(block, name, h, rtol=1e-5):
    """Force and field derivatives in the parameter are central differences of whole solutions."""
    base = replace(block, sensitivities=(name,)).respond(rubber())
    sides = [there.respond(law) for there, law in (moved(block, name, k * h) for k in (1, -1))]
    force = (sides[0].force - sides[1].force) / (2 * h)
    field = (sides[0].displacement - sides[1].displacement) / (2 * h)
    assert base.parameters == (name,)
    np.testing.assert_allclose(
        base.force_gradient[:, 0], force, rtol=rtol, atol=rtol * np.abs(force).max()
    )
    np.testing.assert_allclose(
        base.displacement_gradient[..., 0], field, atol=rtol * np.abs(field).max()
    )


@pytest.mark.lasting
@CONTACTS
@pytest.mark.parametrize("name", ["height", "width", "pin_width", "contact_ramp", "travel_zero"])
def test_derivatives_are_central_differences_of_whole_solutions(contact, name):
    block = small(contact)
    # what sticks depends on the zero of the travel with a large third derivative
    assert_derivatives(block, name, 3e-6 if name == "travel_zero" else 1e-5)


@pytest.mark.parametrize("name", ["friction_pin", "friction_base", "contact_slip"])
def test_so_they_are_in_the_law_of_friction(name):
    block = small(RUBBING)
    assert_derivatives(block, name, 1e-5)


def moved_to(block, along):
    """The block with its pin moved and turned by `along`, in the order of PLACE."""
    for name, h in zip(PLACE, along, strict=True):
        block, _ = moved(block, name, h)
    return block


@pytest.mark.lasting
@CONTACTS
def test_derivatives_in_the_place_of_a_turned_bar_leave_remainders_of_second_order(contact):
    """All three changed together, each in proportion to its size."""
    block = turned(contact)
    base = replace(block, sensitivities=PLACE).respond(rubber())
    steps = steps_of(block, PLACE[0])[[0, -1]]
    found = []
    for h in steps:
        along = h * np.array([size(block, name) for name in PLACE]) * [1.0, -1.0, 1.0]
        there = moved_to(block, along).respond(rubber())
        force = there.force - base.force - base.force_gradient @ along
        field = there.displacement - base.displacement - base.displacement_gradient @ along
        found.append([np.linalg.norm(force), np.linalg.norm(field)])
    assert (orders(np.array(found), steps) > 1.9).all()


@pytest.mark.lasting
@CONTACTS
def test_the_adjoint_agrees_with_the_direct_derivatives_under_a_turned_bar(contact):
    assert direct_adjoint_difference(turned(contact)) < 1e-8


@CONTACTS
def test_the_adjoint_agrees_with_the_direct_derivatives(contact):
    """Gradient of a sum of squares of what differs from data, in all parameters."""
    block = small(contact)
    block = replace(block, sensitivities=names(block))
    rng = np.random.default_rng(0)
    base = block.respond(rubber())
    data = base.displacement + 0.1 * rng.standard_normal(base.displacement.shape)
    force = base.force * 1.1
    found = block.objective_gradients(
        rubber(), lambda i, field, total: (field - data[i], total - force[i])
    )
    misfit = base.displacement - data
    expected = (base.force - force)[:, None] * base.force_gradient
    expected += np.einsum("ipk,ipkj->ij", misfit, base.displacement_gradient)
    np.testing.assert_allclose(
        found, expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max(axis=0).min()
    )


def test_an_objective_is_asked_by_the_number_of_the_travel_when_a_step_is_cut(monkeypatch):
    """Its derivative fails once, after it was asked: the step to the travel is tried again."""
    block = small(SLIDING)
    asked, failing = [], [True]

    def objective(i, field, total):
        asked.append(i)
        return np.zeros_like(field), 1.0

    def fails_once(*of):
        if failing:
            failing.pop()
            raise SingularTangentError("singular")
        return adjoint(*of)

    whole = block.objective_gradients(rubber(), objective)
    expected, asked = asked, []
    monkeypatch.setattr("fe.load_stepping.adjoint", fails_once)
    cut = block.objective_gradients(rubber(), objective)
    assert asked == [expected[0], *expected]
    np.testing.assert_allclose(cut, whole, rtol=1e-6)


def test_an_error_of_the_objective_is_its_own():
    def objective(i, field, total):
        raise ZeroDivisionError("mine")

    with pytest.raises(ZeroDivisionError, match="mine"):
        small(RUBBING).objective_gradients(rubber(), objective)


@pytest.mark.parametrize("fillet", [2.0 - 5e-7, 5e-7])
def test_a_fillet_at_its_limit_is_differenced_to_one_side(fillet):
    block = BlockPinModel(
        BlockPin(pin_fillet=fillet), Contact("slide", "stick"), (3, 2, 1), (0.1,),
        field_grid=(2, 2), sensitivities=("pin_fillet", "height"),
    )  # fmt: skip
    inside = replace(block.specimen, pin_fillet=abs(fillet - 3e-6))
    at_limit, central = (
        replace(block, specimen=specimen).respond(rubber()).force_gradient
        for specimen in (block.specimen, inside)
    )
    np.testing.assert_allclose(at_limit, central, rtol=1e-3)


def test_asking_for_sensitivities_does_not_change_the_solution():
    block = small(RUBBING)
    with_all, without = (
        replace(block, sensitivities=asked).respond(rubber()) for asked in (names(block), ())
    )
    assert with_all.force.tobytes() == without.force.tobytes()
    assert with_all.displacement.tobytes() == without.displacement.tobytes()
    assert without.force_gradient.shape == (3, 0)


def test_columns_come_in_the_order_asked():
    block = small(SLIDING)
    two, one = (
        replace(block, sensitivities=asked)(np.array([0.4, 0.1]))
        for asked in (("height", "r"), ("r",))
    )
    assert two.parameters == ("height", "r")
    np.testing.assert_allclose(two.force_gradient[:, 1], one.force_gradient[:, 0], rtol=1e-10)


@pytest.mark.parametrize(
    ("block", "name"),
    [
        (small(STUCK), "friction_pin"),
        (small(STUCK), "pin_shift_x"),
        (small(STUCK), "C20"),
        (replace(small(RUBBING)), "pin_rotation"),
    ],
)
def test_an_unknown_parameter_is_refused_with_those_there_are(block, name):
    with pytest.raises(
        ValueError, match=rf"sensitivities: expected names among .*, found '{name}'"
    ):
        replace(block, sensitivities=(name,)).respond(rubber())
