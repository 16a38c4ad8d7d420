"""Ties of what sticks: where points are anchored, how firmly they hold, and what that follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.taylor import model as small
from benchmarks.taylor import rubber
from fe import BlockPin, BlockPinModel, Contact
from fe.contact import FREE, TIED_TO_FLOOR, TIED_TO_PIN, PenaltyLaw, penalty
from fe.contact_memory import initial_memory, tie_touching
from fe.pin_surface import BAR, ROUND, RigidPin, pin_point
from fe.steps import StepOptions
from fe.surface_slopes import no_slopes
from fe.ties import Stick, share

GRIP = PenaltyLaw().grip

TRAVEL = (0.2, 0.4)
"""of two steps; in the second some touch that did not in the first"""


def pressed(shape=BAR, size=1.0):
    """Faces, pin and displacements after two steps, the second further down; all of a `size`."""
    pin = RigidPin(2.5 + 0.05 * size, 2.0, 0.3, 500.0, 0.1, shape=shape)
    block = BlockPinModel(BlockPin(), Contact("slide", "slide"), (4, 2, 4), (0.5,))
    discrete = block.discretise()
    rng = np.random.default_rng(5)
    first, second = 0.05 * size * rng.standard_normal((2, *discrete.elements.positions.shape))
    second[:, 1] -= 0.1 * size
    return discrete.faces, pin, (first, first + second)


def after(steps, faces, pin, states, travel=TRAVEL, *, stick=(True, True), slopes=None, by=None):
    """Ties after so many steps; `by` are derivatives of states and travels, if any."""
    slopes = no_slopes(faces, 0) if slopes is None else slopes
    n_p = slopes.height.size
    by = ([np.zeros((*states[0].shape, n_p))] * 2, [np.zeros(n_p)] * 2) if by is None else by
    memory = initial_memory(faces, np.zeros(faces.weights.shape, bool), pin, slopes)
    counts = [
        tie_touching(
            memory, faces, states[i], by[0][i], travel[i], pin, Stick(*stick), slopes, by[1][i]
        )
        for i in range(steps)
    ]
    return memory.ties, counts


def ends(faces, u, travel):
    """(n_face, n_q, 2, 3) places of the contact points at one state, as pin and floor see them."""
    places = faces.points + np.einsum("cqa,cai->cqi", faces.shape, u[faces.nodes])
    return np.stack([places + np.array([0.0, travel, 0.0]), places], axis=2)


def gaps(places, kind, pin):
    """Distances to what points are tied to, mm."""
    return np.array(
        [
            pin_point(x, 0.0, pin).gap if k == TIED_TO_PIN else x[1]
            for x, k in zip(places, kind, strict=True)
        ]
    )


def test_points_meet_the_surface_on_their_straight_way_through_the_step():
    faces, pin, states = pressed()
    ties, _ = after(1, faces, pin, states)
    tied = ties.kind != FREE
    side = np.where(ties.kind[tied] == TIED_TO_PIN, 0, 1)
    was = np.repeat(faces.points[:, :, None], 2, axis=2)[tied, side]
    now, met = ends(faces, states[0], TRAVEL[0])[tied, side], ties.touch[tied]
    part = np.linalg.norm(met - was, axis=1) / np.linalg.norm(now - was, axis=1)
    np.testing.assert_allclose(met, was + part[:, None] * (now - was), atol=1e-12)
    assert np.all((part > 0.0) & (part < 1.0))
    at, end = (gaps(x, ties.kind[tied], pin) for x in (met, now))
    flat = (met[:, 0] < 1.65) | (ties.kind[tied] == TIED_TO_FLOOR)
    assert 50 < np.count_nonzero(flat) < flat.size
    np.testing.assert_allclose(at[flat], 0.0, atol=1e-12)
    # on the fillet a straight way passes a little deeper
    assert np.all(np.abs(at) < 0.1 * np.abs(end).max())


def test_no_pressure_jumps_where_a_point_is_tied():
    """The spring's force along the normal is the penalty's, on the flat and on the floor."""
    faces, pin, states = pressed()
    ties, _ = after(1, faces, pin, states)
    end = ends(faces, states[0], TRAVEL[0])
    flat = (end[..., 0, 0] < 1.65) & (ties.touch[..., 0] < 1.65)
    for kind, side, up, least in ((TIED_TO_PIN, 0, -1.0, 20), (TIED_TO_FLOOR, 1, 1.0, 1)):
        tied = (ties.kind == kind) & (flat | (side == 1))
        now = end[tied, side]
        spring = -up * pin.stiffness * (now - ties.anchor[tied])[:, 1]
        gap = gaps(now, ties.kind[tied], pin)
        pressure = [-penalty(g, pin.stiffness, pin.ramp)[1] for g in gap]
        assert len(gap) >= least
        np.testing.assert_allclose(spring, pressure, rtol=1e-9)


def test_a_point_that_touches_just_before_or_just_after_the_end_of_a_step_is_tied_alike():
    faces, pin, (first, second) = pressed()
    ties, counts = after(2, faces, pin, (first, second))
    assert min(counts) > 20
    # the step ends where one of the points is at the surface, a hair before or after
    late = (ties.kind == TIED_TO_PIN) & (after(1, faces, pin, (first, second))[0].kind == FREE)
    c, q = np.argwhere(late)[0]

    def at(part):
        middle = first + part * (second - first)
        travel = TRAVEL[0] + part * (TRAVEL[1] - TRAVEL[0])
        return middle, travel

    def gap(part):
        middle, travel = at(part)
        x = faces.points[c, q] + faces.shape[c, q] @ middle[faces.nodes[c]]
        return pin_point(x, travel, pin).gap

    low, high = 0.0, 1.0
    for _ in range(50):
        part = (low + high) / 2
        low, high = (part, high) if gap(part) > 0.0 else (low, part)
    found = []
    for part in (low - 1e-7, high + 1e-7):
        middle, travel = at(part)
        memory = initial_memory(faces, np.zeros(faces.weights.shape, bool), pin)
        none = np.zeros((*first.shape, 0))
        kinds = []
        for u, t in ((first, TRAVEL[0]), (middle, travel), (second, TRAVEL[1])):
            tie_touching(memory, faces, u, none, t, pin)
            kinds.append(memory.ties.kind[c, q])
        found.append((memory.ties, kinds))
    (early, earlier), (later, after_it) = found
    assert earlier == [FREE, FREE, TIED_TO_PIN]
    assert after_it == [FREE, TIED_TO_PIN, TIED_TO_PIN]
    np.testing.assert_allclose(early.anchor[c, q], later.anchor[c, q], atol=1e-6)
    assert early.hold[c, q] == pytest.approx(later.hold[c, q], abs=1e-6)


@pytest.mark.parametrize("depth", [0.0005, 0.002, 0.004, 0.02])
def test_a_point_is_held_at_the_same_pressure_by_the_same_share_of_a_stiffer_law(depth):
    law, stiff = PenaltyLaw(), PenaltyLaw().stiffened(8.0)
    held, slope = share(depth, law.grip)
    assert share(depth / 8.0, stiff.grip) == pytest.approx((held, 8.0 * slope), rel=1e-12)


def test_what_holds_a_point_grows_with_its_depth_from_nothing_to_the_whole_spring():
    depth = np.linspace(-0.5, 1.5, 401) * GRIP
    value, slope = np.array([share(d, GRIP) for d in depth]).T
    assert np.all(value[depth <= 0.0] == 0.0)
    assert np.all(value[depth >= GRIP] == 1.0)
    np.testing.assert_allclose(np.gradient(value, depth)[1:-1], slope[1:-1], atol=0.03 / GRIP)
    assert np.all(slope >= 0.0)


def test_a_point_that_was_held_is_not_let_go():
    faces, pin, (first, second) = pressed()
    held = after(1, faces, pin, (second, second))[0]
    back = after(2, faces, pin, (second, first), (0.2, 0.0))[0]
    tied = held.kind != FREE
    np.testing.assert_array_equal(back.kind[tied], held.kind[tied])
    np.testing.assert_array_equal(back.anchor[tied], held.anchor[tied])
    assert np.all(back.hold >= held.hold)
    # how deep they are is not how deep they were
    last = ends(faces, first, 0.0)[tied, 0]
    assert np.count_nonzero(gaps(last, back.kind[tied], pin) > 0.0) > 20


@pytest.mark.parametrize(
    ("stick", "kind"), [((True, False), TIED_TO_PIN), ((False, True), TIED_TO_FLOOR)]
)
def test_only_a_surface_that_sticks_ties_points(stick, kind):
    faces, pin, states = pressed()
    ties, counts = after(2, faces, pin, states, stick=stick)
    assert set(np.unique(ties.kind)) == {FREE, kind}
    assert sum(counts) == np.count_nonzero(ties.kind)


@pytest.mark.parametrize("size", [1.0, 2.0 * GRIP], ids=["deep", "shallow"])
@pytest.mark.parametrize("shape", [BAR, ROUND], ids=["bar", "round"])
def test_derivatives_of_anchors_and_hold_are_difference_quotients(shape, size):
    """In displacements of both steps, their travels, the pin and the places of the points."""
    faces, pin, states = pressed(shape, size)
    travels = tuple(size * t for t in TRAVEL)
    rng = np.random.default_rng(3)
    fields = ("height", "half_width", "fillet", "x", "z")
    n_p = len(fields) + 2
    slopes = no_slopes(faces, n_p)
    for j, name in enumerate(fields):
        getattr(slopes, name)[j] = 1.0
    slopes.points[..., -1] = 0.1 * rng.standard_normal(faces.points.shape)
    along = [np.zeros((*u.shape, n_p)) for u in states]
    sinks = np.zeros((2, n_p))
    for du, sink in zip(along, sinks, strict=True):
        du[..., -2] = 0.1 * rng.standard_normal(du.shape[:2])
        sink[-2] = rng.standard_normal()

    def moved(j, h):
        changed = pin._replace(**{n: getattr(pin, n) + h * (j == i) for i, n in enumerate(fields)})
        there = faces._replace(points=faces.points + h * slopes.points[..., j])
        at = [u + h * du[..., j] for u, du in zip(states, along, strict=True)]
        travel = [t + h * sink[j] for t, sink in zip(travels, sinks, strict=True)]
        return after(2, there, changed, at, travel)[0]

    found = after(2, faces, pin, states, travels, slopes=slopes, by=(along, sinks))[0]
    h = 2e-8
    for j in range(n_p):
        plus, minus = moved(j, h), moved(j, -h)
        same = (found.kind != FREE) & (plus.kind == found.kind) & (minus.kind == found.kind)
        # where a gap passes a corner of the profile or a limit of the share, slopes jump
        anchor = (plus.anchor - minus.anchor)[same] / (2 * h)
        hold = (plus.hold - minus.hold)[same] / (2 * h)
        off = np.abs(found.anchor_gradient[same][..., j] - anchor).max(axis=1)
        assert np.count_nonzero(same) > 25
        assert np.mean(off < 2e-5) > 0.99
        off = np.abs(found.hold_gradient[same][:, j] - hold)
        assert np.mean(off < 1e-3 / GRIP) > 0.99
    partly = (found.hold > 0.0) & (found.hold < 1.0)
    assert size == 1.0 or np.count_nonzero(partly) > 20


@pytest.mark.lasting
def test_a_state_asked_again_at_once_moves_by_little():
    """What touches is tied after a step is solved, and no step is solved again for it."""
    stuck = Contact("stick", "stick")
    block = BlockPinModel(BlockPin(), stuck, (8, 4, 2), (1.0, 1.0 + 1e-9), sensitivities=())
    response = block((0.5, 0.05))
    first, again = response.displacement
    assert 1e-4 < np.abs(again - first).max() < 0.01
    assert response.force[1] == pytest.approx(response.force[0], rel=1e-3)
    assert response.message == "reached every asked travel"  # no growth of the force by 1e-9 mm


@pytest.mark.lasting
def test_a_stuck_block_is_smooth_in_its_parameters():
    """Forces and field along a line on which points of the surface come to touch a step earlier."""
    block = replace(small(Contact("stick", "stick")), steps=StepOptions(first=0.05, largest=0.05))
    block = replace(block, sensitivities=())
    ratio = np.linspace(0.8, 1.2, 9)
    runs = [block.respond(rubber((0.5, 0.4 * k, 0.1 * k, 400.0))) for k in ratio]
    field = np.array([run.displacement for run in runs])
    force = np.log([run.force for run in runs])
    basis = np.linalg.qr(np.vander(ratio - 1.0, 4))[0]
    for values, rough in ((field, 1e-5), (force, 1e-5)):
        flat = values.reshape(len(ratio), -1)
        left = flat - basis @ (basis.T @ flat)
        assert np.abs(left).max() < rough
