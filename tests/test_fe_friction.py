"""Coulomb friction: derivatives in every state, closed forms, limits, energy and sensitivities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from friction_derivatives import (
    LAW,
    STATES,
    TRAVEL,
    Patch,
    assert_frozen_potential_has_the_true_forces,
    assert_pull_of_anchors_and_coefficients_is_the_derivative_of_the_forces,
    assert_tangent_with_coupling_is_the_derivative_of_the_forces,
    evaluate,
)

from fe import BlockPin, BlockPinModel, Contact
from fe.contact import (
    TIED_TO_PIN,
    PenaltyLaw,
    contact_system,
    empty_system,
)
from fe.contact_memory import initial_memory, slide_anchors
from fe.friction import friction_system, frozen_energy, slip_potential
from fe.linear_solver import SymmetricSolver
from fe.load_stepping import march
from fe.material_parameters import ratio_parameters
from fe.newton import NewtonOptions
from fe.pin_surface import RigidPin, bar_distance
from fe.potential import Potential
from fe.specimens.block_pin_mesh import block_mesh
from fe.steps import March
from fe.surface_slopes import no_slopes
from fe.ties import Stick
from fe.touch import FLOOR, PIN, FrictionLaw, bar_arc

RIGID = RigidPin(2.5, 2.0, 0.3, stiffness=500.0, ramp=0.1, base_stiffness=2e4)
TIGHT = NewtonOptions(tolerance=1e-9)
RATIOS = np.array([0.4, 0.1])


def model(pin, base, **changes) -> BlockPinModel:
    return replace(
        BlockPinModel(BlockPin(), Contact(pin, base), (5, 2, 1), (0.3, 0.6), newton=TIGHT),
        **changes,
    )


def patch(slipped: float) -> Patch:
    """Faces, displacements that touch pin and floor, and anchors a random way `slipped` behind."""
    discrete = model(0.3, 0.7, cells=(4, 2, 2)).discretise()
    faces = discrete.faces
    rng = np.random.default_rng(0)
    u = 0.1 * rng.standard_normal(discrete.elements.positions.shape)
    u[:, 1] -= 0.15
    none = no_slopes(faces, 4)
    memory = initial_memory(faces, np.zeros(faces.weights.shape, bool), RIGID, none)
    gradient = rng.standard_normal((*u.shape, 4))
    slide_anchors(memory, faces, u, gradient, TRAVEL - 0.2, RIGID, LAW)
    slide_anchors(memory, faces, u, 0.0 * gradient, TRAVEL, RIGID, LAW)
    touching = here(faces, u)
    memory.slip.place[...] = touching + slipped * rng.standard_normal(touching.shape)
    memory.slip.gradient[...] = rng.standard_normal(memory.slip.gradient.shape)
    return Patch(faces, u, memory, RIGID)


def here(faces, u):
    """(n_face, n_q, 2, 2) places of the points on pin and floor."""
    x = faces.points + np.einsum("cqa,cai->cqi", faces.shape, u[faces.nodes])
    place = np.zeros((*x.shape[:2], 2, 2))
    for at in np.ndindex(*x.shape[:2]):
        arc = bar_arc(*x[at][:2], RIGID.half_width, RIGID.fillet, RIGID.height - TRAVEL)[0]
        place[at] = [[arc, x[at][2]], [x[at][0], x[at][2]]]
    return place


def tractions(patch: Patch):
    """(n_face, n_q) size of the friction traction and its limit mu p, MPa."""
    frame, faces, u = evaluate(patch).frame, patch.faces, patch.u
    x = faces.points + np.einsum("cqa,cai->cqi", faces.shape, u[faces.nodes])
    x[..., 1] += frame.moves * TRAVEL
    slip = frame.offset + np.einsum("cqai,cqi->cqa", frame.tangent, x)
    secant = np.array([slip_potential(*s, LAW.slip)[1] for s in slip.reshape(-1, 2)])
    size = frame.limit * secant.reshape(frame.limit.shape) * np.linalg.norm(slip, axis=-1)
    return size, frame.limit


@STATES
def test_tangent_with_coupling_is_the_derivative_of_the_forces(slipped):
    assert_tangent_with_coupling_is_the_derivative_of_the_forces(patch(slipped))


@STATES
def test_frozen_potential_has_the_true_forces_and_its_own_hessian(slipped):
    found = patch(slipped)
    assert_frozen_potential_has_the_true_forces(found)
    faces, u = found.faces, found.u
    frame, energy, _, system, _ = evaluate(found)
    du = np.random.default_rng(2).standard_normal(u.shape)
    h = 3e-5
    plus, minus = (frozen_energy(u + k * h * du, faces, frame, TRAVEL, LAW.slip) for k in (1, -1))
    curvature = np.einsum("cai,caikb,cbk", du[faces.nodes], system.tangent, du[faces.nodes])
    assert curvature == pytest.approx((plus - 2 * energy + minus) / h**2, rel=1e-3)


@STATES
def test_pull_of_anchors_and_coefficients_is_the_derivative_of_the_forces(slipped):
    assert_pull_of_anchors_and_coefficients_is_the_derivative_of_the_forces(patch(slipped))


def test_pull_of_the_return_mapping_is_its_derivative():
    faces, u, memory, _ = patch(0.03)
    direction = np.random.default_rng(3).standard_normal((*u.shape, 4))
    h = 1e-7

    def returned(shift: float, j: int = 0):
        moved = memory.copy()
        moved.slip.place[...] += shift * memory.slip.gradient[..., j]
        slide_anchors(moved, faces, u + shift * direction[..., j], direction, TRAVEL, RIGID, LAW)
        return moved.slip

    for j in range(4):
        expected = (returned(h, j).place - returned(-h, j).place) / (2 * h)
        found = returned(0.0).gradient[..., j]
        used = np.ones(found.shape[:3], bool)
        used[faces.base, :, PIN] = False  # the base has no anchors on the pin
        np.testing.assert_allclose(found[used], expected[used], atol=1e-5 * np.abs(found).max())


def test_the_traction_reaches_its_limit_after_the_slip_and_never_passes_it():
    for slipped in (1e-3, 7e-3, 0.2):
        size, limit = tractions(patch(slipped))
        assert np.count_nonzero(limit) > 100
        assert np.all(size <= limit * (1 + 1e-12))
    far = slip_potential(0.3, 0.4, 0.01)[1] * 0.5
    assert far == pytest.approx(1.0, rel=1e-14)
    assert slip_potential(1e-6, 0.0, 0.01)[1] == pytest.approx(150.0, rel=1e-6)


def test_arc_length_runs_on_round_the_fillet():
    flat = bar_arc(1.0, 2.0, 2.0, 0.3, 2.0)
    corner = bar_arc(1.7 + 0.3 * np.sqrt(0.5), 2.3 - 0.3 * np.sqrt(0.5), 2.0, 0.3, 2.0)
    wall = bar_arc(2.0, 2.8, 2.0, 0.3, 2.0)
    assert flat == (1.0, 1.0)
    assert corner == pytest.approx((1.7 + 0.3 * np.pi / 4, 1.0))
    assert wall == pytest.approx((1.7 + 0.3 * np.pi / 2 + 0.5, 1.0))
    assert bar_arc(-1.9, 2.05, 2.0, 0.3, 2.0)[0] == -bar_arc(1.9, 2.05, 2.0, 0.3, 2.0)[0]


PRESSED = 0.02
"""travel of the platen, mm"""


def sheared_element(mu: float, shear: float):
    """One element pressed by the platen to a known pressure, its top moved sideways by `shear`.

    By less than to the highest points of its sides, 0.03 mm below the top.

    Returns (forces on the top in x and y, N) from the contact kernels alone.
    """
    m = BlockPinModel(BlockPin(1.0, 1.0, 2.5, 40.0), Contact(mu, "slide"), (1, 1, 1), (0.5,))
    discrete = m.discretise()
    pin = RigidPin(2.5, 20.0, 0.3, 500.0, 0.1)
    law = FrictionLaw(mu, 0.0, 0.01)
    none = no_slopes(discrete.faces, 4)
    memory = initial_memory(discrete.faces, discrete.glued, pin, none)
    u = np.zeros(discrete.elements.positions.shape)
    travel, total = PRESSED, np.zeros(3)
    for k in range(1, 6):
        u[:, 0] = shear * k / 5
        system = empty_system(discrete.faces)
        contact_system(
            u,
            discrete.faces,
            memory.ties.kind,
            memory.ties.hold,
            memory.ties.anchor,
            travel,
            pin,
            True,
            system,
        )
        kind, place = memory.ties.kind, memory.slip.place
        coupling = np.zeros_like(system.tangent)
        friction_system(u, discrete.faces, kind, place, travel, pin, law, system, coupling)
        slide_anchors(memory, discrete.faces, u, np.zeros((*u.shape, 4)), travel, pin, law)
        total = system.force.sum(axis=(0, 1))
    return total


@pytest.mark.parametrize("mu", [0.1, 0.6])
def test_a_pressed_block_slips_exactly_at_mu_times_the_normal_force(mu):
    pressure = 500.0 * PRESSED**2 / (2 * 0.1)
    area = 0.5 * 0.5
    x, y, z = sheared_element(mu, 0.2)
    assert (x, y, z) == pytest.approx((mu * pressure * area, pressure * area, 0.0), abs=1e-12)
    held = sheared_element(mu, 0.004)[0]  # within the slip a: h(0.4) of the limit
    assert held == pytest.approx(mu * pressure * area * (0.4 * 3 - 0.4**3) / 2, rel=1e-12)
    assert sheared_element(mu, -0.2)[0] == pytest.approx(-x, rel=1e-12)


@pytest.fixture(scope="module")
def rubbing():
    """States of a run with friction on pin and base."""
    names = ("r", "s", "friction_pin", "friction_base")
    return model(0.3, 0.2, sensitivities=names).solve(RATIOS)[0]


@pytest.mark.lasting
@pytest.mark.parametrize("along", [(1.0, 0.5, 0.7, -0.6), (-0.8, 0.9, 0.5, 0.7)], ids=str)
def test_sensitivities_match_central_differences(rubbing, along):
    """All four parameters changed together."""
    h, state = 1e-5, rubbing[0]
    sides = []
    for r, s, pin, base in (h * np.array(along), -h * np.array(along)):
        m = model(0.3 + pin, 0.2 + base, travel=(0.3,))
        sides.append(m.solve(RATIOS + np.array([r, s]))[0][0])
    force = (sides[0].pin_force - sides[1].pin_force) / (2 * h)
    field = (sides[0].u - sides[1].u) / (2 * h)
    assert state.force_gradient @ along == pytest.approx(force, rel=1e-5)
    np.testing.assert_allclose(state.u_gradient @ along, field, atol=1e-5 * abs(field).max())


def test_force_scales_with_kappa_and_field_does_not(rubbing):
    softer = model(0.3, 0.2).solve(RATIOS, 0.037)[0]
    for a, b in zip(rubbing, softer, strict=True):
        assert b.pin_force == pytest.approx(0.037 * a.pin_force, rel=1e-9)
        assert b.friction_work == pytest.approx(0.037 * a.friction_work, rel=1e-9)
        np.testing.assert_allclose(b.u, a.u, atol=1e-9)


@pytest.mark.lasting
def test_the_work_of_the_pin_is_stored_or_rubbed_away():
    m = model(0.3, 0.3, travel=tuple(np.linspace(0.02, 0.5, 25)))
    states, _, _ = m.solve(RATIOS)
    force = np.concatenate([[0.0], [s.pin_force for s in states]])
    work = np.trapezoid(force, np.concatenate([[0.0], m.travel]))
    assert states[-1].friction_work > 0.03 * work
    assert states[-1].energy + states[-1].friction_work == pytest.approx(work, rel=5e-3)


@pytest.mark.lasting
def test_force_grows_with_friction_from_sliding_towards_sticking():
    one = {"travel": (0.3,)}
    force = [model(mu, mu, **one)(RATIOS).force[0] for mu in (1e-6, 0.1, 0.6, 20.0)]
    slide, stick = (model(c, c, **one)(RATIOS).force[0] for c in ("slide", "stick"))
    assert np.all(np.diff(force) > 0.0)
    # the base with friction rests on a spring, the one without is held
    assert force[0] == pytest.approx(slide, rel=1e-4)
    # what sticks to the pin also hangs on it, which friction cannot do: the fillet takes less along
    assert 0.9 * stick < force[-1] < stick


@pytest.mark.lasting
@pytest.mark.parametrize(("coefficient", "bound"), [(50.0, 5e-4), (500.0, 1e-4)])
def test_a_rough_base_is_a_base_that_sticks(monkeypatch, coefficient, bound):
    """Along the same steps (what sticks beside a pin lies where the step found it), and from 0.3 mm
    on: before, the base is pulled at its rim, where friction holds nothing."""
    one = block_mesh(BlockPin(), "quarter", (5, 2, 1), Contact("slide", "slide"))
    monkeypatch.setattr(BlockPinModel, "mesh", lambda _: one)  # else lines follow what is glued
    travel = tuple(0.02 * np.arange(1.0, 31.0))
    rough, stuck = (model("stick", c, travel=travel)(RATIOS) for c in (coefficient, "stick"))
    np.testing.assert_allclose(rough.force[14:], stuck.force[14:], rtol=bound)
    np.testing.assert_allclose(rough.displacement[14:], stuck.displacement[14:], atol=bound)


def test_no_friction_is_sliding_to_the_bit():
    zero, slide = model(0.0, 0.0)(RATIOS), model("slide", "slide")(RATIOS)
    assert zero.force.tobytes() == slide.force.tobytes()
    assert zero.displacement.tobytes() == slide.displacement.tobytes()


def test_at_equilibrium_no_traction_passes_mu_p_and_the_base_carries_the_pin():
    m = model(0.3, 0.2)
    discrete = m.discretise()
    problem = m.problem(discrete, RATIOS)
    known = ratio_parameters(problem.material)
    along = m.parameters(known.names, known, problem, shear=2.0)
    memory = initial_memory(discrete.faces, discrete.glued, problem.pin, along.surface)
    solver = SymmetricSolver(discrete.pattern.indptr, discrete.pattern.indices)
    keys = {"stick": Stick(pin=False, floor=False), "steps": m.steps, "newton": m.newton}
    keys["parameters"] = along
    states = list(march(Potential(problem), solver, memory, m.travel, March(), **keys))
    solver.close()
    faces, u = discrete.faces, states[-1].u
    x = faces.points + np.einsum("cqa,cai->cqi", faces.shape, u[faces.nodes])
    gap = np.array([bar_distance(*p[:2], 2.0, 0.3, 2.5 - 0.6)[0] for p in x.reshape(-1, 3)])
    depth = np.maximum(-gap.reshape(x.shape[:2]), 0.0)
    pressure = problem.pin.stiffness * depth**2 / (2 * problem.pin.ramp)  # depth < ramp
    on_base = -problem.pin.base_stiffness * x[faces.base][..., 1]
    size = np.linalg.norm(memory.slip.traction, axis=-1)
    top = ~faces.base & ~faces.floor
    assert depth.max() < problem.pin.ramp
    assert np.all(size[top][..., PIN] <= 0.3 * pressure[top] * (1 + 1e-9))
    assert np.all(size[faces.base][..., FLOOR] <= 0.2 * np.maximum(on_base, 0.0) * (1 + 1e-9))
    # much of the interface slides, some of it sticks
    sliding = size[faces.base][..., FLOOR] > 0.2 * on_base * (1 - 1e-9)
    assert 0.3 < sliding.mean() < 1.0
    reaction = np.sum(faces.weights[faces.base] * on_base)
    assert reaction == pytest.approx(states[-1].pin_force, rel=1e-7)


def test_a_base_with_friction_does_not_move_up_or_down(rubbing):
    discrete = model(0.3, 0.2).discretise()
    bottom = discrete.elements.positions[:, 1] < 1e-9
    assert np.abs(rubbing[-1].u[bottom, 1]).max() < 1e-4
    assert np.abs(rubbing[-1].u[bottom, 0]).max() > 0.05


def test_tied_points_have_no_friction():
    tied = patch(0.2)
    tied.memory.ties.kind[:] = TIED_TO_PIN
    energy, force, system = evaluate(tied)[1:4]
    assert energy == force == 0.0
    assert not system.force.any()


@pytest.mark.lasting
def test_the_slip_in_which_friction_builds_up_hardly_matters():
    sharp, blunt = (
        model(0.3, 0.3, travel=(0.4,), penalty=PenaltyLaw(slip=a))(RATIOS).force[0]
        for a in (0.005, 0.01)
    )
    assert sharp == pytest.approx(blunt, rel=0.01)


@pytest.mark.lasting
def test_inexact_directions_end_where_exact_ones_do(monkeypatch):
    """And need fewer factorisations than where the whole tangent is factorised each time."""
    plain = model(0.3, 0.3, newton=NewtonOptions(tolerance=1e-9), sensitivities=())
    rough = plain(RATIOS)
    monkeypatch.setattr(
        SymmetricSolver, "solve_near", lambda self, matrix, b, _: self.solve_general(matrix, b)
    )
    factorised = plain(RATIOS)
    np.testing.assert_allclose(rough.force, factorised.force, rtol=1e-8)
    np.testing.assert_allclose(rough.displacement, factorised.displacement, atol=1e-8)
    assert rough.n_factorisations < 0.7 * factorised.n_factorisations
