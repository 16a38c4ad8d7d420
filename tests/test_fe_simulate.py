"""One door to all specimens: labels, names of theta, scale, derivatives, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import fe
import fe.newton
from fe.materials import LAWS
from fe.response import load_response, save_response

SPECIMENS = {
    "uniaxial": fe.UniaxialModel(fe.Bar(), (0.2, 0.4)),
    "tensile": fe.TensileModel(fe.NotchedPlate(), (2, 2, 1), (2.0, 4.0), field_grid=(2, 3)),
    "cylinder": fe.CylinderModel(fe.Cylinder(), (3, 2), (1.0, 2.0), "bonded", n_point=4),
    "block_pin": fe.BlockPinModel(
        fe.BlockPin(),
        fe.Contact("stick", "stick"),
        (4, 2, 1),
        (0.1, 0.2),
        field_grid=(3, 2),
        newton=fe.newton.NewtonOptions(tolerance=1e-9),
    ),
}
every_specimen = pytest.mark.parametrize("specimen", SPECIMENS.values(), ids=SPECIMENS.keys())
THETA = {"C10": 0.02, "C01": 0.01, "C11": 0.003, "bulk": 6.0}


@every_specimen
def test_the_response_is_labelled_and_good_to_the_last_travel(specimen):
    response = fe.simulate(specimen, "mooney-rivlin-3", THETA)
    assert response.status is fe.Status.CONVERGED, response.message
    assert response.reached == response.travel[-1] == specimen.travel[-1]
    n_step, n_point, n_parameter = 2, len(specimen.points()), len(response.parameters)
    assert response.force.shape == (n_step,)
    assert response.displacement.shape == (n_step, n_point, 3)
    assert response.force_gradient.shape == (n_step, n_parameter)
    assert response.displacement_gradient.shape == (n_step, n_point, 3, n_parameter)
    np.testing.assert_array_equal(response.points, specimen.points())
    assert (np.diff(response.force) > 0.0).all()
    assert response.force[0] > 0.0
    assert response.n_factorisations > 0
    assert response.seconds > 0.0


@pytest.mark.parametrize("wrong", [True, "0.01", None])
def test_theta_is_of_numbers(wrong):
    with pytest.raises(ValueError, match="theta: expected a number of MPa for C11, found"):
        fe.simulate(SPECIMENS["uniaxial"], "mooney-rivlin-3", {**THETA, "C11": wrong})
    for array in ([wrong] * 4, ["0.01"] * 4, [[0.01], [1.0, 2.0]], [1j] * 4):
        with pytest.raises(ValueError, match=r"theta: expected 4 numbers \(C10, C01, C11, bulk\)"):
            fe.simulate(SPECIMENS["uniaxial"], "mooney-rivlin-3", array)


@every_specimen
def test_a_stiffer_material_takes_more_force_for_the_same_field(specimen):
    one = fe.simulate(specimen, "mooney-rivlin-3", THETA)
    five = fe.simulate(specimen, "mooney-rivlin-3", {k: 5.0 * v for k, v in THETA.items()})
    np.testing.assert_allclose(five.force, 5.0 * one.force, rtol=1e-7)
    np.testing.assert_allclose(five.displacement, one.displacement, atol=1e-7)


@every_specimen
def test_laws_that_are_special_cases_of_one_another_respond_the_same(specimen):
    general = fe.simulate(specimen, "mooney-rivlin-3", (0.02, 0.0, 0.0, 6.0))
    special = fe.simulate(specimen, LAWS["neo-hookean"], (0.02, 6.0))
    np.testing.assert_allclose(special.force, general.force, rtol=1e-10)


@pytest.mark.parametrize("name", ["uniaxial", "tensile", "cylinder"])
def test_gradients_are_in_the_numbers_of_theta(name):
    specimen = SPECIMENS[name]
    # with 1e-4 the differences in C30 are of the size of the rounding of the force
    theta, h = np.array([0.02, 0.004, 0.001, 6.0]), 1e-3
    response = fe.simulate(specimen, "yeoh", theta)
    assert response.parameters == ("C10", "C20", "C30", "bulk")
    for j in range(4):
        step = h * theta * np.eye(4)[j]
        plus, minus = (fe.simulate(specimen, "yeoh", theta + k * step).force for k in (1, -1))
        difference = (plus - minus) / (2 * h * theta[j])
        np.testing.assert_allclose(
            response.force_gradient[:, j], difference, rtol=2e-5, atol=1e-6 * abs(difference).max()
        )


@pytest.mark.lasting
@pytest.mark.parametrize("law", ["yeoh", "ogden-2"])
@pytest.mark.parametrize(
    "contact", [("slide", "slide"), ("stick", "stick"), (0.3, 0.2)], ids=["slide", "stick", "rub"]
)
def test_gradients_of_the_block_under_a_pin_take_its_contact_along(law, contact):
    """Penalty, friction and anchors included; the stiffness of contact goes with the material's."""
    specimen = replace(SPECIMENS["block_pin"], contact=fe.Contact(*contact))
    theta = {"yeoh": (0.02, 0.004, 0.001, 6.0), "ogden-2": (0.03, 1.7, -0.006, -2.3, 6.0)}[law]
    response, h = fe.simulate(specimen, law, theta), 1e-3
    assert response.parameters == (*LAWS[law].constant_names, "bulk")
    for j, value in enumerate(theta):
        step = h * abs(value) * np.eye(len(theta))[j]
        plus, minus = (fe.simulate(specimen, law, theta + k * step) for k in (1, -1))
        force = (plus.force - minus.force) / (2 * h * abs(value))
        field = (plus.displacement - minus.displacement) / (2 * h * abs(value))
        np.testing.assert_allclose(response.force_gradient[:, j], force, rtol=1e-4)
        np.testing.assert_allclose(
            response.displacement_gradient[..., j], field, atol=1e-3 * np.abs(field).max()
        )


def test_the_two_doors_of_the_block_under_a_pin_open_on_the_same_block():
    specimen = SPECIMENS["block_pin"]
    r, s, kappa = 0.4, 0.1, 0.03
    theta = (kappa * (1 - r), kappa * r, kappa * s, 2.0 * kappa * specimen.bulk_ratio)
    one, two = specimen(np.array([r, s])), fe.simulate(specimen, "mooney-rivlin-3", theta)
    np.testing.assert_allclose(two.force, kappa * one.force, rtol=1e-7)
    np.testing.assert_allclose(two.displacement, one.displacement, atol=1e-8)
    # dF/dr and dF/ds at fixed kappa and bulk modulus by the chain rule
    C10, C01, C11 = two.force_gradient[:, :3].T
    np.testing.assert_allclose(np.stack([C01 - C10, C11], 1), one.force_gradient, rtol=1e-6)


@pytest.mark.parametrize("name", ["uniaxial", "block_pin"])
def test_the_volumetric_law_matters_where_volume_changes(name):
    theta = (0.02, 0.05)
    one, two = (
        fe.simulate(SPECIMENS[name], "neo-hookean", theta, volumetric=v).force
        for v in ("quadratic", "logarithmic")
    )
    assert (np.abs(one / two - 1) > 1e-4).all()


def test_a_labelled_response_survives_storage(tmp_path):
    response = fe.simulate(SPECIMENS["uniaxial"], "yeoh", (0.02, 0.004, 0.001, 6.0))
    save_response(tmp_path / "r.npz", response)
    loaded = load_response(tmp_path / "r.npz")
    assert loaded.parameters == response.parameters
    np.testing.assert_array_equal(loaded.points, response.points)


def test_results_stored_without_labels_are_read_as_those_of_ratios(tmp_path):
    uniaxial = SPECIMENS["uniaxial"]
    for name, response in (
        ("old.npz", uniaxial(np.array([0.4, 0.1]))),
        ("other.npz", fe.simulate(uniaxial, "yeoh", (1, 0, 0, 9.0))),
    ):
        save_response(tmp_path / "r.npz", response)
        with np.load(tmp_path / "r.npz") as stored:
            old = {k: stored[k] for k in stored.files if k not in ("points", "parameters")}
        np.savez(tmp_path / name, **old)
    with pytest.raises(ValueError, match=r"derivatives in 2 parameters \(r, s\), found 4"):
        load_response(tmp_path / "other.npz")
    loaded = load_response(tmp_path / "old.npz")
    assert loaded.parameters == ("r", "s")
    assert loaded.points.shape == (0, 2)


@pytest.mark.parametrize(
    ("law", "theta", "message"),
    [
        ("gent", (1.0, 2.0), "law: expected one of neo-hookean"),
        (
            fe.material("yeoh", (1, 0, 0), 9.0),
            (1, 0, 0, 9.0),
            "law: expected a name, such as 'yeoh'",
        ),
        ("yeoh", (1.0, 2.0), r"theta: expected 4 numbers \(C10, C20, C30, bulk\)"),
        ("neo-hookean", {"C10": 1.0, "K": 2.0}, "theta: expected C10, bulk, found C10, K"),
        ("neo-hookean", (1.0, np.inf), "material: expected a finite bulk modulus"),
        ("neo-hookean", (-1.0, 2.0), "shear modulus above 0"),
    ],
)
def test_what_gives_no_material_is_refused(law, theta, message):
    with pytest.raises(ValueError, match=message):
        fe.simulate(SPECIMENS["uniaxial"], law, theta)


def test_a_run_that_stops_says_so_and_keeps_what_is_good():
    hopeless = replace(
        SPECIMENS["cylinder"], newton=fe.newton.NewtonOptions(max_iterations=1), travel=(1.0,)
    )
    response = fe.simulate(hopeless, "neo-hookean", (0.02, 6.0))
    assert response.status is fe.Status.STOPPED
    assert "at a travel of" in response.message
    assert response.reached == 0.0
    assert np.isnan(response.force).all()
    assert response.negative_pivots.tolist() == [-1]


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (
            lambda: fe.simulate(fe.BlockPin(), "neo-hookean", (0.02, 6.0)),
            "specimen: found BlockPin",
        ),
        (
            lambda: fe.BlockPinModel(fe.Disc(), fe.Contact(), (3, 2, 1), (0.1,)),
            "specimen: expected",
        ),
        (lambda: fe.BlockPinModel(fe.BlockPin(), "stick", (3, 2, 1), (0.1,)), "contact: expected"),
        (lambda: replace(SPECIMENS["cylinder"], newton=None), "newton: expected NewtonOptions"),
        (lambda: replace(SPECIMENS["uniaxial"], steps=None), "steps: expected StepOptions"),
        (lambda: replace(SPECIMENS["tensile"], specimen=fe.Bar()), "specimen: expected Notched"),
        (lambda: replace(SPECIMENS["cylinder"], friction="0.3"), "friction: expected a finite"),
        (lambda: fe.simulate(fe.UniaxialModel, "yeoh", (1.0,)), "specimen: found <class"),
        (lambda: fe.Material("neo-hookean", (0.01,), 1.0), "law: expected one of fe.materials"),
        (lambda: fe.material("neo-hookean", 0.01, 1.0), "constants: expected 1 finite"),
        (lambda: fe.material("neo-hookean", ("0.01",), 1.0), "constants: expected 1 finite"),
        (lambda: fe.material("neo-hookean", (0.01,), None), "bulk: expected a modulus above 0"),
        (lambda: fe.material("neo-hookean", (0.01,), 1e200), "bulk: expected less than 1e"),
        (lambda: fe.material("mooney-rivlin-3", (0.01, 0.01, 1e200), 1.0), "C11: expected less"),
        (lambda: fe.material(["yeoh"], (0.01,)), "law: expected one of neo-hookean"),
        (lambda: fe.material("neo-hookean", (0.01,), 1.0, ["log"]), "volumetric: expected one of"),
        (
            lambda: replace(SPECIMENS["block_pin"], plane_strain="no"),
            "plane_strain: expected True or False, found 'no'",
        ),
        (
            lambda: replace(
                SPECIMENS["block_pin"],
                specimen=fe.BlockPin(pin_shift=(4.95, 0.0)),
                symmetry="auto",
            ),
            "pin_shift: expected at most 4.9 and 4.9 mm",
        ),
        (lambda: fe.Bar(width="a"), "width: expected a length above 0 mm, found 'a'"),
    ],
)
def test_what_is_of_another_kind_is_refused_by_name(make, said):
    with pytest.raises(ValueError, match=said):
        make()


@pytest.mark.parametrize(
    "theta", [{"C10": "x", "bulk": 6.0}, {"C10": [0.1], "bulk": 6.0}, "many", [True, 6.0]]
)
def test_numbers_of_the_material_that_are_none_are_refused(theta):
    with pytest.raises(ValueError, match="theta: expected"):
        fe.simulate(SPECIMENS["uniaxial"], "neo-hookean", theta)


def test_a_progress_that_cannot_be_called_is_refused():
    with pytest.raises(ValueError, match="progress: expected a function"):
        fe.simulate(SPECIMENS["uniaxial"], "neo-hookean", (0.02, 6.0), progress=True)


def test_field_points_may_be_given_as_lists():
    block = SPECIMENS["block_pin"]
    listed = replace(block, field_grid=[[1.0, 1.0], [3.0, 2.0]])
    tuples = replace(block, field_grid=((1.0, 1.0), (3.0, 2.0)))
    found, expected = (fe.simulate(m, "mooney-rivlin-3", THETA) for m in (listed, tuples))
    np.testing.assert_array_equal(found.displacement, expected.displacement)
