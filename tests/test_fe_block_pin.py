"""The specimen model against closed forms, symmetries, finite differences and energy balance."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import root

import fe.load_stepping
from fe import BlockPin, BlockPinModel, Contact, Status
from fe.newton import NewtonOptions, equilibrate
from fe.steps import StepOptions

TRAVEL = (0.3, 0.6)
TIGHT = NewtonOptions(tolerance=1e-9)


def model(pin: str = "stick", base: str = "stick", **changes) -> BlockPinModel:
    return replace(
        BlockPinModel(BlockPin(), Contact(pin, base), (5, 2, 1), TRAVEL, newton=TIGHT), **changes
    )


def platen_force(ratios: np.ndarray, travel: float, bulk: float, m: BlockPinModel) -> float:
    """Frictionless compression of the block by a platen through the same penalty (closed form).

    Homogeneous F = diag(a, b, a) with W_iso + K/2 (J - 1)^2: lateral stress zero, axial nominal
    stress equal to the penalty pressure at the penetration travel - H (1 - b).
    """
    r, s = ratios
    C10, C01, C11 = 1.0 - r, r, s

    def energy(a: float, b: float) -> float:
        J = a * a * b
        I1 = J ** (-2 / 3) * (2 * a * a + b * b)
        I2 = J ** (-4 / 3) * (a**4 + 2 * a * a * b * b)
        W = C10 * (I1 - 3) + C01 * (I2 - 3) + C11 * (I1 - 3) * (I2 - 3)
        return W + bulk / 2 * (J - 1) ** 2

    def derivative(a: float, b: float) -> tuple[float, float]:
        h = 1e-5
        return (
            (energy(a + h, b) - energy(a - h, b)) / (2 * h),
            (energy(a, b + h) - energy(a, b - h)) / (2 * h),
        )

    def pressure(b: float) -> float:
        t = travel - m.specimen.height * (1 - b)
        stiffness, ramp = m.penalty.stiffness * 2.0, m.penalty.ramp
        return stiffness * max(t, 0.0) ** 2 / (2 * ramp)

    def equations(x: np.ndarray) -> list[float]:
        da, db = derivative(*x)
        return [da, db + pressure(x[1])]

    lam = 1 - (travel - 0.02) / m.specimen.height
    solution = root(equations, [lam**-0.5, lam], tol=1e-10)
    assert solution.success
    return pressure(solution.x[1]) * m.specimen.width * m.specimen.depth


@pytest.mark.parametrize("ratios", [(0.0, 0.0), (0.6, 0.0), (0.3, 0.4)])
def test_a_frictionless_platen_gives_the_uniaxial_closed_form(ratios):
    platen = model("slide", "slide", specimen=BlockPin(pin_width=40.0), travel=(0.3, 0.45))
    response = platen(np.array(ratios))
    expected = [platen_force(np.array(ratios), d, 400.0, platen) for d in platen.travel]
    np.testing.assert_allclose(response.force, expected, rtol=1e-5)


@pytest.mark.parametrize("contact", [("stick", "stick"), ("slide", "slide")])
def test_force_scales_with_kappa_and_field_does_not(contact):
    m = model(*contact, newton=NewtonOptions(tolerance=1e-10))
    ratios = np.array([0.4, 0.1])
    one, two = m.solve(ratios, 1.0)[0], m.solve(ratios, 0.037)[0]
    for a, b in zip(one, two, strict=True):
        assert b.pin_force == pytest.approx(0.037 * a.pin_force, rel=1e-9)
        np.testing.assert_allclose(b.u, a.u, atol=1e-9)


@pytest.mark.lasting
@pytest.mark.parametrize("contact", [("stick", "stick"), ("slide", "slide")])
def test_sensitivities_match_central_differences(contact):
    m = model(*contact, steps=StepOptions(largest=0.05))
    ratios = np.array([0.4, 0.1])
    base = m(ratios)
    h = 1e-4
    for j, step in enumerate(np.eye(2) * h):
        plus, minus = m(ratios + step), m(ratios - step)
        force = (plus.force - minus.force) / (2 * h)
        field = (plus.displacement - minus.displacement) / (2 * h)
        np.testing.assert_allclose(base.force_gradient[:, j], force, rtol=2e-3)
        np.testing.assert_allclose(
            base.displacement_gradient[..., j], field, atol=5e-3 * np.abs(field).max()
        )


@pytest.mark.parametrize("contact", ["slide", "stick"])
def test_the_work_of_the_pin_is_stored(contact):
    m = model(contact, contact, travel=tuple(np.linspace(0.02, 0.5, 25)))
    states, _, _ = m.solve(np.array([0.3, 0.1]))
    travel = np.concatenate([[0.0], m.travel])
    force = np.concatenate([[0.0], [s.pin_force for s in states]])
    work = np.trapezoid(force, travel)
    # the trapezoidal rule on a curve like d^1.3 with 25 steps is itself good to 5e-4
    assert work == pytest.approx(states[-1].energy, rel=1e-3)


def test_stick_is_stiffer_than_slide_and_force_grows_with_travel():
    ratios = np.array([0.3, 0.05])
    stuck, sliding = model("stick", "stick")(ratios), model("slide", "slide")(ratios)
    assert np.all(stuck.force > sliding.force)
    assert np.all(np.diff(stuck.force) > 0)
    assert np.all(np.diff(sliding.force) > 0)


def test_front_face_moves_out_sideways_and_down_under_the_pin():
    m = model()
    response = m(np.array([0.3, 0.05]))
    x, y = m.points().T
    under = (x < 1.0) & (y > 2.0)
    assert response.displacement.shape == (2, 840, 3)
    assert np.all(response.displacement[-1, under, 1] < 0.0)
    assert response.displacement[-1, :, 2].max() > 0.3
    assert response.displacement[-1, :, 0].max() > 0.2


def test_a_tolerance_below_rounding_is_told_with_what_is_left():
    response = model("slide", "slide", newton=NewtonOptions(tolerance=1e-14))(np.array([0.3, 0.05]))
    assert response.status is Status.STOPPED
    assert "of the contact forces, tolerance 1e-14)" in response.message


def test_a_march_that_cannot_go_on_says_how_far_it_got():
    m = model("slide", "slide", newton=NewtonOptions(max_iterations=1))
    response = m(np.array([0.3, 0.05]))
    assert response.status is Status.STOPPED
    assert response.reached < TRAVEL[0]
    assert np.isnan(response.force).all()
    assert "mm" in response.message
    assert np.all(response.negative_pivots == -1)


def test_what_was_reached_is_kept_when_a_later_step_fails(monkeypatch):
    def fails_beyond_04(potential, solver, u, p, travel, memory, options):
        found = equilibrate(potential, solver, u, p, travel, memory, options)
        return replace(found, converged=found.converged and travel <= 0.4, reason="test")

    monkeypatch.setattr(fe.load_stepping, "equilibrate", fails_beyond_04)
    whole = model()(np.array([0.3, 0.05]))
    assert whole.status is Status.STOPPED
    assert 0.39 <= whole.reached <= 0.4
    assert np.isfinite(whole.force[0]) and np.isnan(whole.force[1])
    assert np.isfinite(whole.displacement[0]).all() and np.isnan(whole.displacement[1]).all()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: BlockPin(height=-1.0), "height: expected a length above 0 mm, found -1.0"),
        (lambda: BlockPin(pin_fillet=2.0), "pin_fillet: expected less than half"),
        (lambda: Contact(pin="glue"), "pin: expected 'stick', 'slide' or a coeff.*found 'glue'"),
        (lambda: Contact(base=-0.1), "base: expected .* of 0 or more, found -0.1"),
        (lambda: Contact(base=float("inf")), "base: expected .* found inf"),
        (lambda: Contact(pin=True), "pin: expected .* found True"),
        (lambda: model(travel=(0.4, 0.2)), "travel: expected increasing"),
        (lambda: model(travel=(2.6,)), "less than the block's height"),
        (lambda: model(travel=np.array([0.1, 0.2])), "travel: expected a tuple of numbers"),
        (lambda: model(travel=("far",)), "travel: expected a tuple of numbers"),
        (lambda: model(travel=[0.1, 0.2]), "travel: expected a tuple of numbers"),
        (lambda: model(travel=(), force=[0.1]), "force: expected a tuple of numbers"),
        (
            lambda: model(travel=(1e-6, 0.2)),
            "travel: expected travels of at least 1e-05 mm, found 1e-06",
        ),
        (lambda: model(field_grid=((1.0, 2.0), (1.0,))), "field_grid: expected points"),
        (lambda: model(field_grid=(("a", "b"),)), "field_grid: expected points"),
        (lambda: BlockPin(pin_shift=(1.0, (2.0, 3.0))), "pin_shift: expected two lengths"),
        (lambda: BlockPin(pin_shift=(True, 0.2)), "pin_shift: expected two lengths"),
        (lambda: model(travel=(True, 2.0)), "travel: expected a tuple of numbers"),
        (lambda: model(cells=(0, 1, 1)), "cells"),
        (lambda: model(cells=(3.0, 1, 1)), "cells: expected 3 whole numbers"),
        (lambda: model(bulk_ratio=0.0), "bulk_ratio"),
        (lambda: model(bulk_ratio=float("inf")), "bulk_ratio: expected a finite ratio"),
        (lambda: model(bulk_ratio=True), "bulk_ratio: expected a finite ratio above 0, found True"),
        (lambda: BlockPin(width=True), "width: expected a length above 0 mm, found True"),
        (lambda: BlockPin(pin_rotation="10"), "pin_rotation: expected a finite angle, found '10'"),
        (lambda: BlockPin(pin_rotation=True), "pin_rotation: expected a finite angle, found True"),
        (lambda: BlockPin(pin_shift=("0.1", 0)), "pin_shift: expected two lengths"),
        (lambda: Contact(np.array([0.3, 0.2])), "pin: expected .* found array"),
        (
            lambda: NewtonOptions(max_iterations=20.5),
            "max_iterations: expected a whole number above 0, found 20.5",
        ),
        (lambda: NewtonOptions(tolerance=True), "tolerance: expected a finite number above 0"),
        (lambda: StepOptions(first="0.1"), "first: expected a finite number above 0, found '0.1'"),
        (lambda: model()(np.array([0.1])), "ratios: expected two finite numbers"),
    ],
)
def test_impossible_input_is_refused_by_name(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_the_model_travels_by_pickle_to_a_worker():
    m = model()
    assert pickle.loads(pickle.dumps(m)) == m


@pytest.mark.lasting
def test_bits_do_not_depend_on_process_or_number_of_threads():
    code = (
        "import sys, numpy as np; sys.path.insert(0, '.');"
        "from fe import BlockPin, BlockPinModel, Contact;"
        "m = BlockPinModel(BlockPin(), Contact('slide', 'slide'), (5, 2, 1), (0.3,));"
        "r = m(np.array([0.4, 0.1]));"
        "print(r.force.tobytes().hex(), r.displacement.tobytes().hex()[:2000])"
    )
    runs = [
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "OMP_NUM_THREADS": n, "MKL_NUM_THREADS": n},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for n in ("1", "2")
    ]
    assert runs[0] == runs[1] != ""


def test_points_given_one_by_one_see_what_those_of_a_grid_see() -> None:
    grid = BlockPinModel(
        BlockPin(), Contact("slide", "slide"), (3, 2, 1), (0.1,), field_grid=(3, 2)
    )
    chosen = [4, 0, 3]
    places = tuple((float(x), float(y)) for x, y in grid.points()[chosen])
    given = replace(grid, field_grid=places)
    np.testing.assert_array_equal(given.points(), grid.points()[chosen])
    ratios = np.array([0.3, 0.1])
    seen, whole = given(ratios), grid(ratios)
    np.testing.assert_allclose(seen.displacement, whole.displacement[:, chosen], atol=1e-12)
    np.testing.assert_array_equal(seen.force, whole.force)


@pytest.mark.parametrize("place", [(-0.1, 1.0), (5.1, 1.0), (1.0, -0.1), (1.0, 2.6), (np.nan, 1.0)])
def test_points_beside_the_face_are_refused(place: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="field_grid: expected points"):
        BlockPinModel(BlockPin(), Contact("slide", "slide"), (3, 2, 1), (0.1,), field_grid=(place,))
