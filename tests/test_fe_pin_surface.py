"""Distance, normal and Hessian of both pins, wherever they stand, and their contact's tangent."""

from __future__ import annotations

import numpy as np
import pytest

from fe import BlockPin, BlockPinModel, Contact
from fe.contact import contact_system, empty_system
from fe.contact_memory import initial_memory
from fe.pin_surface import ROUND, RigidPin, bar_distance, pin_point, under_flat

KEYS = {"height": 2.5, "half_width": 2.0, "fillet": 0.3, "stiffness": 500.0, "ramp": 0.1}
TRAVEL = 0.5  # the flat bottom at y = 2
TURN = np.radians(25.0)
PINS = {
    "bar": RigidPin(**KEYS),
    "turned bar": RigidPin(
        **KEYS, x=0.2, z=-0.3, across_x=float(np.cos(TURN)), across_z=-float(np.sin(TURN))
    ),
    "round": RigidPin(**KEYS, shape=ROUND),
    "shifted round": RigidPin(**KEYS, shape=ROUND, x=0.2, z=-0.3),
}
every_pin = pytest.mark.parametrize("pin", PINS.values(), ids=PINS.keys())
# under the flat, off the rounded edge outside and inside, beside the wall
PROFILE = [(0.4, 1.9), (1.9, 2.05), (1.85, 2.2), (2.05, 2.6)]


def around(pin: RigidPin, out: float, y: float, turn: float) -> np.ndarray:
    """The point at a distance `out` from the pin's axis in a direction turned from x."""
    return np.array([pin.x + out * np.cos(turn), y, pin.z + out * np.sin(turn)])


def test_a_bar_is_its_profile_to_the_bit():
    for x, y in PROFILE:
        s = pin_point(np.array([x, y, 3.3]), TRAVEL, PINS["bar"])
        profile = bar_distance(x, y, 2.0, 0.3, 2.0)
        assert (s.gap, s.nx, s.ny, s.hxx, s.hxy, s.hyy) == profile
        assert s.nz == s.hxz == s.hyz == s.hzz == 0.0


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.5, 4.0])
@pytest.mark.parametrize("name", ["round", "shifted round"])
def test_a_round_pin_is_the_profile_turned_about_its_axis(name, turn):
    for out, y in PROFILE:
        s = pin_point(around(PINS[name], out, y, turn), TRAVEL, PINS[name])
        gap, n, ny, *_ = bar_distance(out, y, 2.0, 0.3, 2.0)
        assert s.gap == pytest.approx(gap, abs=1e-14)
        found = [s.nx, s.ny, s.nz]
        np.testing.assert_allclose(found, [n * np.cos(turn), ny, n * np.sin(turn)], atol=1e-12)


def test_the_distance_to_a_torus_is_euclidean():
    """From a point off the edge to the nearest of many points on the torus."""
    point = np.array([1.7, 1.8, 1.1])
    around_axis, tube = np.meshgrid(np.linspace(0, 2 * np.pi, 2001), np.linspace(0, np.pi / 2, 501))
    out = 1.7 + 0.3 * np.sin(tube)
    torus = [out * np.cos(around_axis), 2.3 - 0.3 * np.cos(tube), out * np.sin(around_axis)]
    nearest = np.sqrt(sum((t - x) ** 2 for t, x in zip(torus, point, strict=True))).min()
    assert pin_point(point, TRAVEL, PINS["round"]).gap == pytest.approx(nearest, abs=1e-5)


@every_pin
@pytest.mark.parametrize("profile", PROFILE)
@pytest.mark.parametrize("turn", [0.3, 2.8])
def test_normal_and_hessian_are_derivatives_of_the_distance(pin, profile, turn):
    x, h = around(pin, *profile, turn), 1e-6
    s = pin_point(x, TRAVEL, pin)
    normal = np.array([s.nx, s.ny, s.nz])
    hessian = np.array([[s.hxx, s.hxy, s.hxz], [s.hxy, s.hyy, s.hyz], [s.hxz, s.hyz, s.hzz]])
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-12)
    for i, step in enumerate(np.eye(3) * h):
        up, down = pin_point(x + step, TRAVEL, pin), pin_point(x - step, TRAVEL, pin)
        assert normal[i] == pytest.approx((up.gap - down.gap) / (2 * h), abs=1e-8)
        change = [(a - b) / (2 * h) for a, b in zip(up[1:4], down[1:4], strict=True)]
        np.testing.assert_allclose(hessian[i], change, atol=1e-7)


@every_pin
def test_points_under_the_flat_part_have_the_flat_bottom_s_distance(pin):
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.uniform(-4, 4, 400), np.full(400, 1.9), rng.uniform(-4, 4, 400)])
    down = [pin_point(p, TRAVEL, pin).ny == -1.0 for p in points]
    assert 20 < np.count_nonzero(down) < 380
    np.testing.assert_array_equal(under_flat(points, pin), down)


def patch(pin: str):
    """Faces of a block under this pin, and a rough displacement that presses it in."""
    specimen = BlockPin(pin="round" if "round" in pin else "bar")
    m = BlockPinModel(specimen, Contact("slide", "stick"), (2, 1, 2), (0.5,), symmetry="full")
    discrete = m.discretise()
    u = 0.15 * np.random.default_rng(5).standard_normal(discrete.elements.positions.shape)
    u[:, 1] -= 0.1
    return discrete.faces, u


def evaluate(faces, u, memory, travel, pin):
    system = empty_system(faces)
    ties = memory.ties
    tied = ties.kind, ties.hold, ties.anchor
    energy, force = contact_system(u, faces, *tied, travel, pin, True, system)
    return energy, force, system


@pytest.mark.parametrize("name", PINS)
def test_contact_tangent_is_the_derivative_of_the_force_and_that_of_the_energy(name):
    pin = PINS[name]
    faces, u = patch(name)
    memory = initial_memory(faces, np.zeros(faces.weights.shape, bool), pin)
    _, force, system = evaluate(faces, u, memory, 0.4, pin)
    du = np.random.default_rng(1).standard_normal(u.shape)
    h = 1e-6
    plus, minus = (evaluate(faces, u + k * h * du, memory, 0.4, pin) for k in (1, -1))
    along = np.sum(system.force * du[faces.nodes])
    assert along == pytest.approx((plus[0] - minus[0]) / (2 * h), rel=1e-6)
    change = np.einsum("caikb,cbk->cai", system.tangent, du[faces.nodes])
    expected = (plus[2].force - minus[2].force) / (2 * h)
    np.testing.assert_allclose(change, expected, atol=2e-5 * np.abs(expected).max())
    plus, minus = (evaluate(faces, u, memory, 0.4 + k * h, pin) for k in (1, -1))
    assert force == pytest.approx((plus[0] - minus[0]) / (2 * h), rel=1e-6)
    expected = (plus[2].force - minus[2].force) / (2 * h)
    np.testing.assert_allclose(system.by_travel, expected, atol=2e-5 * np.abs(expected).max())
