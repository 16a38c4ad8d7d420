"""Real cylinders: the runs behind the fit, and the data where SOFTCAL_DATA has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.cylinder_fit import LAWS, Model, fit
from benchmarks.cylinder_runs import FAMILIES, CylinderRun, emulator, friction_of
from benchmarks.cylinders import (
    DIAMETER,
    HEIGHT,
    cylinders,
    data_folder,
    published,
    run,
    tension,
)
from calib.inference.repeats import Repeats
from fe.closed_forms import uniaxial
from fe.materials.material import material

FOLDER = data_folder()
real = pytest.mark.skipif(
    not (FOLDER / "ecoflex_compression_cylinders").is_dir()
    or not (FOLDER / "soft_robotics_tension").is_dir(),
    reason=f"no real files in {FOLDER}; set SOFTCAL_DATA",
)
AREA = np.pi * DIAMETER**2 / 4


@pytest.mark.parametrize("family", list(FAMILIES))
def test_a_cylinder_without_friction_has_the_force_of_the_closed_form(family: str) -> None:
    ratios = np.array([0.3, 0.05])
    law = FAMILIES[family]
    found = CylinderRun(family, "friction", (2, 2), (3.0, 9.0))(np.array([*ratios, 0.0]))
    constants = law.constants(ratios)
    rubber = material(law.law, list(constants), 400.0)
    expected = -AREA * uniaxial(rubber, 1 - np.array([3.0, 9.0]) / HEIGHT)
    assert found.force == pytest.approx(expected, rel=1e-6)
    assert rubber.shear_modulus == pytest.approx(2.0)  # kappa is 1 MPa


def test_the_coordinate_of_friction_is_a_half_at_its_scale() -> None:
    assert friction_of(0.5) == pytest.approx(0.2) and friction_of(0.0) == 0.0


@pytest.mark.slow
def test_constants_behind_synthetic_cylinders_are_found_again(tmp_path: Path) -> None:
    trained, errors = emulator("mooney", "bonded", tmp_path)
    assert np.sqrt(np.mean(errors**2)) < 0.01
    model = Model(LAWS[1], "bonded", trained)
    truth = np.array([np.log(0.012), -0.1, *np.log([0.004, 0.03, 0.004, 0.005])])
    log_force, _ = model.predict(truth[None])
    rng = np.random.default_rng(1)
    z = []
    for _ in range(4):
        spread = 0.004 * rng.standard_normal((5, 1)) + 0.002 * rng.standard_normal((5, 8))
        travel = np.array(CylinderRun("mooney", "bonded").travel)
        data = Repeats(travel, np.exp(log_force + spread), 0.02, 5.0, 0.0)
        draws = fit(model, data, rng, 500).draws
        z.append((draws[:, :2].mean(axis=0) - truth[:2]) / draws[:, :2].std(axis=0))
    assert np.abs(z).max() < 3.5


@real
def test_the_records_are_those_that_their_description_says() -> None:
    data = cylinders(FOLDER)
    stretch = 1 - data.travel / HEIGHT
    stress = 1e3 * data.force.mean(axis=0) / AREA
    # README of the data, kPa at stretch .95, .9, .8, .7, .6
    known = {0.95: 5.06, 0.9: 11.02, 0.8: 24.08, 0.7: 40.21, 0.6: 63.53}
    for at, expected in known.items():
        assert stress[np.argmin(np.abs(stretch - at))] == pytest.approx(expected, abs=0.02)
    assert 1e3 * tension(FOLDER) == pytest.approx([3.59, 8.56, 16.89, 29.72], abs=0.02)


@real
def test_published_fits_have_the_stresses_that_their_description_says() -> None:
    data = cylinders(FOLDER)
    found = {one["law"]: one for one in published(FOLDER, data)}
    mean = np.exp(data.mean)
    two = 1e3 * mean * (1 + found["Mooney-Rivlin, 2 constants"]["relative_error"]) / AREA
    c20 = 1e3 * mean * (1 + found["Mooney-Rivlin with C20"]["relative_error"]) / AREA
    place = [int(np.argmin(np.abs(data.travel - t))) for t in (1.5, 3.0, 6.0, 9.0, 12.0)]
    assert two[place] == pytest.approx([3.48, 7.58, 18.41, 34.93, 62.26], abs=0.01)
    assert c20[place] == pytest.approx([6.09, 12.06, 24.43, 39.62, 63.07], abs=0.01)


@real
@pytest.mark.slow
def test_left_out_cylinders_are_predicted_and_tension_elsewhere_is_not(tmp_path: Path) -> None:
    facts = run(FOLDER, tmp_path, quick=True)
    [found] = facts["models"]
    assert 10.0 < found["kappa_kPa"][0] < 15.0
    assert found["left_out_rms_error"] < 0.03 and found["left_out_within_94"] > 0.85
    assert min(found["tension"]["ratio"]) > 1.2
