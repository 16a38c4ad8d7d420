"""A second test of another geometry: right constants pass, others fail, and it says which."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Literal

import arviz as az
import numpy as np
import pytest
import xarray as xr

from calib.cli import FAILED, WRONG_INPUT, main
from calib.data.dataset import Dataset, FieldData, SampleData
from calib.data.dataset_file import save_dataset
from calib.folders import held_alone
from calib.inference.inference_data import load_inference_data, save_inference_data
from calib.study import second_prediction
from calib.study.answers import sampled
from calib.study.block_cells import refinement
from calib.study.mesh_error import left_share
from calib.study.sample_stage import samples_path
from calib.study.second_data import (
    Rubbers,
    SecondData,
    Study,
    plate_model,
    second_data,
    solve,
    stated,
)
from calib.study.second_prediction import N_REPLICATES, Predicted, predict, replicates
from calib.study.second_test import SecondTest, load_second_test
from calib.study.validate import answer_noise, field_noise, posterior_draws, validate
from calib.study.validation_tables import OTHER
from calib.toml_file import FileRefused
from fe.response import Response, Status
from fe.specimens.tensile import NotchedPlate, TensileModel

STUDY = Study(bulk_ratio=200.0, correlation=0.7)
TRUTH = np.array([0.008, 0.004, 0.0024])
SMALL = """
name = "small"
seed = 3
levels = [0.2, 0.4, 0.6]
draws = 4
field_grid = [4, 5]
[data]
source = "virtual"
[virtual]
C10 = 0.008
C01 = 0.004
C11 = 0.0024
cells = [4, 7, 1]
n_samples = 10
force_sd_share = 0.04
field_noise_std = [0.01, 0.01, 0.02]
field_correlation_length = 1.0
field_reference_share = 0.5
[mesh]
sampling = [2, 4, 1]
check = [3, 6, 1]
[[constants]]
name = "thesis"
C10 = 0.02974
C01 = 0.02254
C11 = 3.83086e-4
"""


def _finished(out: Path, synthetic: bool = True, **centres: float) -> Path:
    """A folder with a posterior around the truth times a factor for each hypothesis."""
    rng = np.random.default_rng(1)
    names = list(centres)
    spread = 1 + 0.01 * rng.standard_normal((len(names), 2, 50, 3))
    values = np.array(list(centres.values()))[:, None, None, None] * TRUTH * spread
    dims = ("hypothesis", "chain", "draw")
    posterior = xr.Dataset(
        {name: (dims, values[..., i]) for i, name in enumerate(("C10", "C01", "C11"))},
        {"hypothesis": names},
    )
    posterior["mu"] = 2.0 * (posterior["C10"] + posterior["C01"])
    study = {"material": {"bulk_ratio": 200.0}, "noise": {"sample_correlation": 0.9}}
    facts = {"study_file": study, "hypotheses": {name: {} for name in names}}
    facts["synthetic"] = synthetic
    provenance = json.dumps(facts)
    data = az.InferenceData(attrs={"provenance": provenance}, posterior=posterior)
    save_inference_data(data, out / "posterior.nc")
    return out


@pytest.fixture
def second_file(tmp_path: Path) -> Path:
    path = tmp_path / "second.toml"
    path.write_text(SMALL)
    return path


def test_right_constants_pass_and_those_of_the_thesis_fail(
    tmp_path: Path, second_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = _finished(tmp_path, right=1.0)
    assert main(["validate", str(out), str(second_file)]) == 0
    text = capsys.readouterr().out
    assert "SYNTHETIC" in text and "PASS  right" in text and "FAIL (answer, x, y)  thesis" in text
    assert OTHER not in text
    measured = _finished(tmp_path, synthetic=False, right=1.0)
    assert main(["validate", str(measured), str(second_file)]) == 0
    assert OTHER in capsys.readouterr().out
    found = json.loads((out / "validation" / "small" / "validation.json").read_text())
    right, wrong = found["predictions"]["right"], found["predictions"]["thesis"]
    assert found["synthetic"] and right["passed"] and not wrong["passed"]
    # kappa is 4.36 times too large, and so is the force at a travel.
    assert 4.0 < wrong["quantities"]["y"]["ratio"] < 5.5
    assert wrong["quantities"]["y"]["correlation"] > 0.99
    assert wrong["quantities"]["answer"]["area"] > 10 * right["quantities"]["answer"]["area"]
    assert (out / "validation" / "small" / "validation.png").is_file()


@pytest.mark.parametrize(
    ("name", "words"), [("right", "of a hypothesis"), ("thesis", "of its own")]
)
def test_constants_that_go_by_another_s_name_are_refused(
    tmp_path: Path, second_file: Path, capsys: pytest.CaptureFixture[str], name: str, words: str
) -> None:
    """They would stand in the place of the posterior's verdict, or of each other's."""
    more = SMALL[SMALL.index("[[constants]]") :].replace('"thesis"', f'"{name}"')
    second_file.write_text(f"{SMALL}{more}")
    assert main(["validate", str(_finished(tmp_path, right=1.0)), str(second_file)]) == 2
    said = capsys.readouterr().err
    assert "constants[1].name: found" in said and words in said


def test_a_wrong_posterior_is_an_exit_code(tmp_path: Path, second_file: Path) -> None:
    out = _finished(tmp_path, soft=0.6)
    assert main(["validate", str(out), str(second_file)]) == FAILED


def test_set_travels_are_blind_to_stiffness_in_the_field_and_see_it_in_the_force(
    tmp_path: Path, second_file: Path
) -> None:
    second_file.write_text(
        SMALL.replace("levels = [0.2, 0.4, 0.6]", 'control = "travel"\nlevels = [2.0, 4.0]')
    )
    test, folder = load_second_test(second_file)
    out = _finished(tmp_path, soft=0.6)
    found, _ = validate(out, test, folder, lambda _: None)
    soft = found["predictions"]["soft"]["quantities"]
    assert soft["y"]["passed"] and not soft["answer"]["passed"]
    assert soft["answer"]["ratio"] == pytest.approx(1 / 0.6, rel=0.04)


def test_a_measured_data_set_is_read_from_its_file(second_file: Path) -> None:
    test, folder = load_second_test(second_file)
    made = second_data(test, folder, STUDY)
    assert made.synthetic and made.field is not None
    assert test.virtual is not None and made.correlation == STUDY.correlation
    travel = solve(plate_model(test, (4, 7, 1), made.levels), stated(test.virtual, STUDY)).travel
    # The noise of the mean of ten samples that differ by 4 %.
    assert made.answer == pytest.approx(travel, rel=0.04)
    field: FieldData = made.field
    dataset = Dataset("measured", False, made.answer, made.levels, 0.04 * made.levels, 10, field)
    read = second_data(*_measured(second_file, dataset), STUDY)
    assert not read.synthetic and read.levels == pytest.approx(made.levels)
    assert read.answer == pytest.approx(made.answer)


def test_what_a_data_set_states_of_its_zero_is_known_of_the_second_test(second_file: Path) -> None:
    travel, force = np.array([2.0, 4.0]), np.array([0.3, 0.6])
    dataset = Dataset("measured", False, travel, force, 0.04 * force, 9, travel_zero_sd=0.025)
    assert second_data(*_measured(second_file, dataset), STUDY).travel_zero_sd == 0.025


def test_what_is_left_of_the_mesh_error_moves_answer_and_field_together(second_file: Path) -> None:
    """With the SD of a share of the measured difference; within four SDs of an SD of so many."""
    test, _ = load_second_test(second_file)
    levels, force = np.array([2.0, 4.0]), np.array([0.3, 0.5])
    moved, tiny = np.ones((2, 1, 3)), np.full(2, 1e-9)
    field = FieldData(np.ones((1, 2)), moved, np.full(3, 1e-9), 1.0, 0.5)
    data = SecondData("plate", True, "travel", levels, force, tiny, 9, None, field, 0.7)
    draws = Predicted(np.tile(force, (4, 1)), np.tile(moved, (4, 1, 1, 1)))
    off = Predicted(np.array([[0.01, -0.02]]), np.full((1, 2, 1, 3), 0.003))
    again = replicates(test, data, draws, off, np.random.default_rng(4))
    left = left_share(refinement(test.mesh.check, test.mesh.sampling))
    of_an_sd = 4 / np.sqrt(2 * N_REPLICATES)
    assert again.answer.std(axis=0) == pytest.approx(left * np.array([0.01, 0.02]), rel=of_an_sd)
    assert again.field is not None
    assert again.field[:, 0, 0, 0].std() == pytest.approx(left * 0.003, rel=of_an_sd)
    together = np.corrcoef(again.answer[:, 0], again.field[:, 1, 0, 2])[0, 1]
    assert together == pytest.approx(1.0, abs=1e-4)


def _measured(second_file: Path, dataset: Dataset, grid: str = "") -> tuple[SecondTest, Path]:
    """A second test whose data are a file beside it."""
    save_dataset(second_file.parent / "plate.npz", dataset)
    plain = SMALL.replace("levels = [0.2, 0.4, 0.6]", "").replace("field_grid = [4, 5]", grid)
    head, _, tail = plain.partition("[virtual]")
    text = head.replace('"virtual"', '"plate.npz"') + "[mesh]" + tail.partition("[mesh]")[2]
    second_file.write_text(text)
    return load_second_test(second_file)


@pytest.mark.parametrize("place", [(-3.0, 2.0), (2.0, -1.0), (7.0, 0.0), (9.0, 16.0)])
def test_points_off_the_quarter_of_the_plate_are_refused(
    second_file: Path, place: tuple[float, float]
) -> None:
    levels, points = np.array([1.0, 2.0]), np.array([[0.0, 0.0], [6.0, 0.0], [10.0, 15.0], place])
    field = FieldData(points, np.ones((2, 4, 3)), np.full(3, 0.01), 1.0, 0.5)
    dataset = Dataset("measured", False, levels, 0.1 * levels, 0.01 * levels, 10, field)
    says = f"plate.npz: points: found 1 off the plate, the first at x = {place[0]:g}, "
    with pytest.raises(ValueError, match=says):
        second_data(*_measured(second_file, dataset), STUDY)


def test_one_increment_and_forces_that_are_no_numbers_are_refused(second_file: Path) -> None:
    """R2 of one increment is undefined, so that nothing could pass."""
    one = Dataset("measured", False, np.array([1.0]), np.array([0.2]), np.array([0.02]), 10)
    with pytest.raises(ValueError, match=r"plate.npz: travel: found one increment, expected two"):
        second_data(*_measured(second_file, one), STUDY)
    travel, force = np.array([1.0, 2.0]), np.array([0.2, 0.4])
    each = np.outer([0.9, 1.0, 1.1], force)
    each[1, 0] = np.nan
    samples = SampleData(("a", "b", "c"), each, np.zeros((3, 2, 0, 3)))
    two = Dataset("measured", False, travel, force, 0.1 * force, 3, samples=samples)
    with pytest.raises(ValueError, match=r"plate.npz: samples: found a force that is no number"):
        second_data(*_measured(second_file, two), STUDY)


def test_set_forces_that_do_not_increase_are_refused_by_their_file(second_file: Path) -> None:
    travel, force = np.array([1.0, 2.0, 3.0]), np.array([0.2, 0.4, 0.35])
    dataset = Dataset("measured", False, travel, force, 0.1 * force, 10)
    with pytest.raises(ValueError, match=r"plate.npz: force_mean: found 0.2, 0.4, 0.35 N"):
        second_data(*_measured(second_file, dataset), STUDY)


def test_replicates_of_forces_at_set_travels_scatter_as_the_samples_do(second_file: Path) -> None:
    test, _ = load_second_test(second_file)
    levels, force = np.array([2.0, 4.0]), np.array([0.3, 0.5])
    data = SecondData(
        "plate", True, "travel", levels, force, np.full(2, 0.06), 9, None, None, STUDY.correlation
    )
    draws = Predicted(np.tile(force, (4, 1)), None)
    no_mesh = Predicted(np.zeros((1, 2)), None)
    again = replicates(test, data, draws, no_mesh, np.random.default_rng(4))
    of_an_sd = 4 / np.sqrt(2 * N_REPLICATES)
    assert again.sample.std(axis=0) == pytest.approx(0.06 * force, rel=of_an_sd)
    assert again.answer.std(axis=0) == pytest.approx(0.02 * force, rel=of_an_sd)


@pytest.mark.parametrize("control", ["force", "travel"])
def test_a_measured_covariance_of_forces_is_that_of_the_replicates(
    second_file: Path, control: Literal["force", "travel"]
) -> None:
    travel, force = np.array([2.0, 4.0]), np.array([0.3, 0.6])
    relative = np.array([[0.06**2, -0.3 * 0.06 * 0.04], [-0.3 * 0.06 * 0.04, 0.04**2]])
    own = relative * np.outer(force, force)
    dataset = Dataset(
        "measured", False, travel, force, np.sqrt(np.diag(own)), 9, force_covariance=own
    )
    test, folder = _measured(second_file, dataset)
    data = second_data(replace(test, control=control), folder, STUDY)
    assert data.stiffness_covariance() == pytest.approx(relative)
    draws = Predicted(np.tile(data.answer, (4, 1)), None)
    no_mesh = Predicted(np.zeros((1, 2)), None)
    again = replicates(test, data, draws, no_mesh, np.random.default_rng(4))
    soft = data.softened(data.answer)
    expected = relative * np.outer(soft, soft)  # a straight curve: levels do not mix
    of_a_covariance = 4 * 0.06**2 * np.abs(soft).max() ** 2 / np.sqrt(N_REPLICATES)
    assert np.cov(again.sample.T) == pytest.approx(expected, abs=of_a_covariance)
    assert 9 * np.cov(again.answer.T) == pytest.approx(expected, abs=of_a_covariance)


@pytest.mark.parametrize("control", ["force", "travel"])
def test_replicates_have_the_errors_that_all_levels_share(
    second_file: Path, control: Literal["force", "travel"]
) -> None:
    test, _ = load_second_test(second_file)
    levels, answer = np.array([2.0, 4.0]), np.array([4.0, 8.0])  # 2 per mm, the field 0.5
    moved = np.array([1.0, 2.0])[:, None, None] * np.ones((2, 1, 3))
    tiny = np.full(2, 1e-6)
    field = FieldData(np.ones((1, 2)), moved, np.full(3, 1e-6), 1.0, 0.5, scale_sd=0.02)
    data = SecondData(
        "plate", True, control, levels, answer, tiny, 9, None, field, 0.7, travel_zero_sd=0.03
    )
    draws = Predicted(np.tile(answer, (4, 1)), np.tile(moved, (4, 1, 1, 1)))
    no_mesh = Predicted(np.zeros((1, 2)), np.zeros((1, 2, 1, 3)))
    again = replicates(test, data, draws, no_mesh, np.random.default_rng(4))
    assert again.field is not None
    by_zero = np.full(2, 0.03 * (1.0 if control == "force" else 2.0))
    of_field = 0.03 * (0.0 if control == "force" else 0.5)
    of_an_sd = 4 / np.sqrt(2 * N_REPLICATES)
    assert again.answer.std(axis=0) == pytest.approx(np.abs(by_zero), rel=of_an_sd)
    expected = np.hypot(0.02 * moved[:, 0, 0], of_field)
    assert again.field.std(axis=0)[:, 0, 0] == pytest.approx(expected, rel=of_an_sd)
    assert abs(np.corrcoef(again.field[:, :, 0, 0].T)[0, 1]) > 0.9
    # what the table says noise alone would do, is the same
    rms = [float(np.sqrt(np.mean(np.square(sd)))) for sd in (by_zero, expected)]
    assert answer_noise(data) == pytest.approx(rms[0], rel=1e-6)
    assert field_noise(data, field, 0) == pytest.approx(rms[1], rel=1e-6)


@pytest.mark.parametrize("control", ["force", "travel"])
def test_noise_of_a_field_has_the_scatter_of_the_samples(
    control: Literal["force", "travel"], second_file: Path
) -> None:
    """Samples that differ by 8 % move a field at a set force by as much, over the root of n."""
    test, _ = load_second_test(second_file)
    levels, answer = np.array([2.0, 4.0]), np.array([4.0, 8.0])
    moved = np.array([1.0, 2.0])[:, None, None] * np.array([0.5, 3.0, 1.0])
    field = FieldData(np.ones((1, 2)), moved, np.full(3, 0.01), 1.0, 0.5)
    data = SecondData("plate", True, control, levels, answer, np.full(2, 0.08), 7, None, field, 0.7)
    draws = Predicted(np.tile(answer, (4, 1)), np.tile(moved, (4, 1, 1, 1)))
    no_mesh = Predicted(np.zeros((1, 2)), np.zeros((1, 2, 1, 3)))
    again = replicates(test, data, draws, no_mesh, np.random.default_rng(4))
    assert again.field is not None
    of_an_sd = 4 / np.sqrt(2 * N_REPLICATES)
    for component in range(3):
        seen = np.sqrt(np.mean((again.field - moved)[..., component] ** 2))
        assert field_noise(data, field, component) == pytest.approx(seen, rel=of_an_sd)


def test_the_model_s_field_is_at_the_points_of_the_data(second_file: Path) -> None:
    """By the shape functions: points on a line, corners, edges, one that rounding took off it."""
    test, _ = load_second_test(second_file)
    model = plate_model(test, (2, 4, 1), np.array([0.2, 0.4]))
    wanted = np.array([[0.0, 0.0], [0.0, 15.0], [10.0, 15.0], [6.0, 0.0], [3.0, -5e-4]])
    levels, answer = np.array([0.2, 0.4]), np.array([2.0, 4.0])
    field = FieldData(wanted, np.ones((2, 5, 3)), np.full(3, 0.01), 1.0, 0.5)
    data = SecondData("plate", True, "force", levels, answer, np.full(2, 0.1), 9, None, field, 0.7)
    truth = Rubbers("mooney-rivlin-3", TRUTH[None], np.array([4.8]))
    found = predict(test, data, truth).field
    assert found is not None and found.shape == (1, 2, 5, 3)
    whole = solve(replace(model, field_grid=((0.0, 0.0), (3.0, 0.0))), truth).displacement
    assert found[0][:, [0, 4]] == pytest.approx(whole, abs=1e-12)
    pulled = solve(model, truth).travel / 2.0  # by half at each end
    assert found[0][:, [1, 2], 1] == pytest.approx(np.stack([pulled, pulled], 1), abs=1e-9)
    assert found[0][:, 0][:, :2] == pytest.approx(np.zeros((2, 2)), abs=1e-12)


def test_right_constants_hold_a_field_measured_between_the_points_of_any_grid(
    second_file: Path,
) -> None:
    """Of the same mesh off by rounding alone: nothing is interpolated from points of its own."""
    test, _ = load_second_test(second_file)
    rng = np.random.default_rng(3)
    y = 15.0 * rng.random(40)
    places = np.column_stack([rng.random(40) * NotchedPlate().half_width(y), y])
    levels, truth = np.array([0.2, 0.4]), Rubbers("mooney-rivlin-3", TRUTH[None], np.array([4.8]))
    made = solve(plate_model(test, test.mesh.sampling, levels, places), truth)
    field = FieldData(places, made.displacement, np.full(3, 1e-6), 1.0, 0.5)
    data = SecondData(
        "plate", True, "force", levels, made.travel, np.full(2, 0.1), 9, None, field, 0.7
    )
    found = predict(test, data, truth).field
    assert found is not None and found[0] == pytest.approx(made.displacement, abs=1e-12)


def test_noise_of_a_field_has_the_patterns_in_which_samples_differ() -> None:
    shape = np.zeros((2, 2, 5, 3))
    shape[0, ..., 0], shape[1, ..., 0] = 0.3, 0.4
    levels, answer, moved = np.array([2.0, 4.0]), np.array([4.0, 8.0]), np.zeros((2, 5, 3))
    field = FieldData(np.ones((5, 2)), moved, np.full(3, 1e-9), 1.0, 0.5, patterns=shape)
    data = SecondData("plate", True, "force", levels, answer, np.full(2, 0.1), 9, None, field, 0.7)
    assert field_noise(data, field, 0) == pytest.approx(0.5)
    assert field_noise(data, field, 1) == pytest.approx(1e-9)


def test_more_draws_than_replicates_are_all_replicated(second_file: Path) -> None:
    test, _ = load_second_test(second_file)
    n = N_REPLICATES + 5
    levels, answer = np.array([2.0, 4.0]), np.arange(1.0, n + 1.0)[:, None] * np.ones(2)
    data = SecondData(
        "plate", True, "travel", levels, np.ones(2), np.full(2, 1e-9), 9, None, None, 0.7
    )
    no_mesh = Predicted(np.zeros((1, 2)), None)
    again = replicates(test, data, Predicted(answer, None), no_mesh, np.random.default_rng(4))
    assert again.answer == pytest.approx(answer, rel=1e-6)


def test_draws_left_out_and_components_that_were_not_measured_are_told(
    tmp_path: Path,
    second_file: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    travel, force = np.array([2.0, 4.0]), np.array([0.2, 0.4])
    dataset = Dataset("measured", False, travel, force, 0.1 * force, 9)
    _measured(second_file, dataset)
    text = second_file.read_text().replace("draws = 4", "draws = 5")
    second_file.write_text(text)

    def one_fails(model: TensileModel, rubbers: Rubbers, index: int = 0) -> Response:
        found = solve(model, rubbers, index)
        if len(rubbers.bulk) == 5 and index == 3:
            return replace(found, status=Status.STOPPED, message="it snaps")
        return found

    monkeypatch.setattr(second_prediction, "solve", one_fails)
    main(["validate", str(_finished(tmp_path, right=1.0)), str(second_file)])
    said = capsys.readouterr().out
    assert "LOOK AT  1 of 5 draws could not be solved (it snaps)" in said
    assert "LOOK AT  u_x, u_y: not measured, so the verdict is of the answer alone" in said


def test_an_answer_keeps_other_runs_out_and_is_stamped_with_what_it_read(
    tmp_path: Path, second_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run that ended meanwhile would have it taken for an answer to the run's own posterior."""
    out = _finished(tmp_path, right=1.0)
    chains = samples_path(out, "right")
    chains.write_bytes(b"old")
    old = sampled(out, ["right"])

    def busy(model: TensileModel, rubbers: Rubbers, index: int = 0) -> Response:
        chains.write_bytes(b"new")
        with pytest.raises(ValueError, match="another `calib` is at work"), held_alone("OUT", out):
            pass
        return solve(model, rubbers, index)

    monkeypatch.setattr(second_prediction, "solve", busy)
    assert main(["validate", str(out), str(second_file)]) == 0
    found = json.loads((out / "validation" / "small" / "validation.json").read_text())
    assert found["posterior"] == old != sampled(out, ["right"])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("check = [3, 6, 1]", "check = [2, 5, 1]"), "mesh.check: found .*1.3 times smaller"),
        (("cells = [4, 7, 1]", "cells = [400, 60, 10]"), "virtual.cells: found .*at most"),
        (("sampling = [2, 4, 1]", "sampling = [400, 60, 10]"), "mesh.sampling: found .*at most"),
    ],
)
def test_meshes_that_say_nothing_or_are_a_slip_of_the_pen_are_refused(
    second_file: Path, change: tuple[str, str], says: str
) -> None:
    second_file.write_text(SMALL.replace(*change))
    with pytest.raises(FileRefused, match=says):
        load_second_test(second_file)


def test_a_grid_of_field_points_is_for_synthetic_tests_alone(second_file: Path) -> None:
    levels = np.array([1.0, 2.0])
    dataset = Dataset("measured", False, levels, levels, 0.1 * levels, 9)
    with pytest.raises(FileRefused, match=r"field_grid: found .*at the points of the data"):
        _measured(second_file, dataset, grid="field_grid = [4, 5]")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("levels = [0.2, 0.4, 0.6]", "levels = [0.4, 0.2]", "increasing"),
        ("levels = [0.2, 0.4, 0.6]", "", "levels with data.source"),
        ('source = "virtual"', 'source = "plate.csv"', "npz"),
        ("cells = [4, 7, 1]", "cells = [3, 5, 1]", "finer than mesh.check"),
        ("check = [3, 6, 1]", "check = [2, 4, 1]", "finer"),
        ("[mesh]", "[plate]\nnotch_depth = 6.0\n[mesh]", "notch"),
        ("C10 = 0.02974", "C10 = -0.5", "positive"),
        ("C10 = 0.008\nC01 = 0.004", "C10 = 0.0\nC01 = 0.0", "more than 0 where C01 is 0"),
    ],
)
def test_impossible_tests_are_refused_with_their_line(
    second_file: Path, old: str, new: str, says: str
) -> None:
    second_file.write_text(SMALL.replace(old, new, 1))
    with pytest.raises(FileRefused, match=says) as refused:
        load_second_test(second_file)
    assert "second.toml:" in str(refused.value)


def test_a_missing_study_or_hypothesis_is_said_in_one_sentence(
    tmp_path: Path, second_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["validate", str(tmp_path / "none"), str(second_file)]) == WRONG_INPUT
    assert "posterior of a finished study" in capsys.readouterr().err
    test, folder = load_second_test(second_file)
    asked: SecondTest = replace(test, hypothesis="other")
    with pytest.raises(ValueError, match="hypothesis: found other, expected one of right"):
        validate(_finished(tmp_path, right=1.0), asked, folder, lambda _: None)


def test_more_draws_than_a_posterior_holds_are_refused_in_one_sentence(
    tmp_path: Path, second_file: Path
) -> None:
    test, _ = load_second_test(second_file)
    out = _finished(tmp_path, right=1.0)
    assert len(posterior_draws(out, replace(test, draws=100))[0]["right"].bulk) == 100
    with pytest.raises(ValueError, match="draws: found 101, expected at most the 100 that the"):
        posterior_draws(out, replace(test, draws=101))


def test_a_posterior_that_lacks_a_constant_of_its_law_is_refused(
    tmp_path: Path, second_file: Path
) -> None:
    test, folder = load_second_test(second_file)
    out = _finished(tmp_path, right=1.0)
    stored = load_inference_data(out / "posterior.nc")
    whole = stored["posterior"]
    for posterior, says in (
        (whole.drop_vars("C11"), "right: found no C11, expected"),
        (whole.assign(C01=np.nan * whole["C01"]), "right: found no C01, expected"),
    ):
        changed = az.InferenceData(attrs=stored.attrs, posterior=posterior)
        save_inference_data(changed, out / "posterior.nc")
        with pytest.raises(ValueError, match=says):
            validate(out, test, folder, lambda _: None)


def test_another_law_and_an_unknown_bulk_modulus_predict_by_their_own_draws(
    tmp_path: Path, second_file: Path
) -> None:
    test, _ = load_second_test(second_file)
    out = _finished(tmp_path, right=1.0, soft=0.5)
    stored = load_inference_data(out / "posterior.nc")
    one = np.array([1.0, np.nan])  # of the second hypothesis neither is known
    posterior = stored["posterior"]
    posterior["bulk_ratio"] = (
        30.0 * posterior["mu"] / posterior["mu"] * xr.DataArray(one, dims="hypothesis")
    )
    posterior["mu1"], posterior["alpha1"] = posterior["C10"], 2.0 + 0.0 * posterior["C10"]
    posterior["friction"] = posterior["C10"]
    facts = json.loads(stored.attrs["provenance"])
    of_law = {"law": {"name": "ogden-1"}, "inputs": [], "errors": []}
    facts["hypotheses"]["right"] = {"space": of_law}
    facts["hypotheses"]["soft"] = {"contact": {"bulk_ratio": 10.0}}
    attrs = stored.attrs | {"provenance": json.dumps(facts)}
    save_inference_data(az.InferenceData(attrs=attrs, posterior=posterior), out / "posterior.nc")
    draws, study = posterior_draws(out, test)
    assert draws["right"].law == "ogden-1" and draws["soft"].law == "mooney-rivlin-3"
    assert draws["right"].constants.shape == (4, 2) and (draws["right"].constants[:, 1] == 2).all()
    mu = posterior["mu"].sel(hypothesis="right").values.ravel()
    assert np.isin(np.round(draws["right"].bulk, 12), np.round(30.0 * mu, 12)).all()
    soft = draws["soft"].constants
    assert draws["soft"].bulk == pytest.approx(10.0 * 2.0 * soft[:, :2].sum(axis=1))
    assert study.correlation == 0.9


def test_the_embedded_test_is_readable() -> None:
    test, _ = load_second_test("notched-plate")
    assert test.virtual is not None and test.constants
