"""A whole laboratory of closed forms: from its files to a data set, a verdict, and a study."""

from __future__ import annotations

import csv
import io
import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from analytic_block import AnalyticBlock, analytic_block
from closed_form_laboratory import EXPERIMENT, Truth, field_at, force_at, write_laboratory

from calib.cli import main
from calib.data.dataset_file import load_dataset, save_dataset
from calib.data.qc import analyse, read_experiment
from calib.data.qc.doubts import doubts
from calib.data.qc.lab_files import _check_numbers, sample_files, static_folder
from calib.data.qc.pipeline import QcResult
from calib.data.qc.results import FIGURE_NAMES
from calib.data.qc.rules import Rules
from calib.data.qc.statistics import accuracy_table, force_table, noise_table, relaxation_table
from calib.data.qc.table import QcTable, table_csv
from calib.data.readers import WrongFile, read_dic, write_points
from calib.inference.field_noise import field_covariance
from calib.inference.forward import DirectForward
from calib.inference.likelihood import build_likelihood
from calib.inference.noise import SCALE, NoiseSettings, further_errors
from calib.study import data_checks
from calib.study.config import Study, StudyError, load_study
from calib.study.context import Context, block_pin_model
from calib.study.data_stage import load_data
from calib.study.experiment_data import experiment_dataset, make_dataset
from calib.study.hierarchical_stage import population_posterior
from calib.study.posterior_setup import noise_of
from calib.study.sections import Cells, Hypothesis
from calib.study.stages import run_stages, run_study
from calib.study.summary import load_summary
from fe.executors import serial_map
from fe.response import Array

STIFFNESS = np.exp(0.08 * np.random.default_rng(9).standard_normal(9))
GOOD = {
    f"S{i + 1}": Truth(
        angle=0.2 * (i % 5 - 2),
        tilt=0.1 * (i % 3 - 1),
        roll=0.15 * (i % 4 - 1.5),
        x_shift=0.04 * (i % 5 - 2),
        origin=(0.3 + 0.013 * i, -1.1 + 0.011 * i, 2.0),
        stiffness=float(STIFFNESS[i]),
        slack=0.5,
        clock=0.3 * (i - 4),
        noise=0.005,
        force_noise=0.03,
        outliers=3,
    )
    for i in range(9)
}
BAD = {
    "S10": Truth(angle=1.3, noise=0.005, force_noise=0.03),
    "S11": Truth(x_shift=-0.4, noise=0.005, force_noise=0.03),
    "S12": Truth(angle=-1.5, x_shift=0.5, noise=0.005, force_noise=0.03),
}


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_laboratory(tmp_path_factory.mktemp("made") / "lab", {**GOOD, **BAD})


@pytest.fixture(scope="module")
def result(lab: Path) -> QcResult:
    return analyse(lab)


@pytest.fixture
def some(lab: Path, tmp_path: Path):
    """Copies some samples of the laboratory into one of their own, with more in its toml."""

    def copied(*names: str, text: str = EXPERIMENT) -> Path:
        folder = tmp_path / "lab"
        for name in (*names, "static"):
            shutil.copytree(lab / name, folder / name)
        (folder / "experiment.toml").write_text(text)
        return folder

    return copied


def test_exactly_the_misplaced_samples_are_rejected_with_value_and_threshold(result):
    found = {(r.sample, r.rule): r for r in result.rejections}
    assert set(found) == {
        ("S10", "max_angle_deg"),
        ("S11", "max_x_shift_mm"),
        ("S12", "max_angle_deg"),
        ("S12", "max_x_shift_mm"),
    }
    assert found["S10", "max_angle_deg"].value == pytest.approx(1.3, abs=0.05)
    assert found["S10", "max_angle_deg"].threshold == 1.0
    assert found["S11", "max_x_shift_mm"].value == pytest.approx(0.4, abs=0.08)
    text = found["S11", "max_x_shift_mm"].text()
    assert text.startswith("S11: x-shift: found 0.") and text.endswith("expected at most 0.25 mm")


def test_mean_field_is_the_truth_within_its_stated_errors(result):
    field = result.dataset.field
    truth = np.stack([field_at(field.points, t) for t in result.dataset.travel])
    off = field.displacement - truth
    assert np.sqrt(np.mean(off**2, axis=(0, 1))).max() < 0.008
    # interpolation on a coarse lattice has no place in the noise: smooth shapes are taken off
    error = np.sqrt((field.patterns**2).sum(axis=0)) if field.patterns is not None else 0.0
    z = off / np.sqrt(field.noise_std**2 + error**2)
    assert np.sqrt(np.mean(z**2)) < 3.0


def test_mean_force_is_the_truth_within_its_stated_error(result):
    data = result.dataset
    truth = force_at(data.travel, float(STIFFNESS.mean()))
    # the stiffness of these samples is known: what is left is contact, zero and noise
    np.testing.assert_allclose(data.force_mean, truth, rtol=0.025)
    spread = np.std(force_at(data.travel[:, None], STIFFNESS), axis=1, ddof=1)
    np.testing.assert_allclose(data.force_sd, spread, rtol=0.3)
    correlation = data.force_covariance / np.outer(data.force_sd, data.force_sd)
    assert correlation.min() > 0.9, "stiff samples are stiff at every increment"


def test_single_samples_are_kept_beside_their_mean(result):
    data = result.dataset
    assert data.samples.names == tuple(GOOD)
    np.testing.assert_allclose(data.samples.force.mean(axis=0), data.force_mean)
    mean = np.nanmean(data.samples.displacement, axis=0)
    np.testing.assert_allclose(mean, data.field.displacement, atol=2e-3)


def test_noise_of_the_data_set_is_what_was_put_in(result):
    raw = result.noise.at_points
    np.testing.assert_allclose(raw.std, 0.005, rtol=0.1)
    # two independent halves are folded, and parabolas at places up to half a spacing t from a point
    # along both axes take the mean of 1 - 3 t^2 / 2 + 3 t^4 / 2 off the variance: 0.894 each
    mapped = 0.005 * 0.894 / np.sqrt(2)
    np.testing.assert_allclose(result.noise.static.std, mapped, rtol=0.1)
    # nine samples of three steps tell it better than the static frames
    np.testing.assert_allclose(result.noise.mean_std, mapped / 3, rtol=0.06)
    one = result.dataset.samples.noise_std
    np.testing.assert_allclose(one, 3 * result.noise.mean_std, rtol=0.02)
    assert raw.reference_share < 0.1


def test_outliers_were_found(result):
    found = [int(s.face.cleaned.is_outlier.sum()) for s in result.samples[:9]]
    # three a frame in three frames of each sample and the one beside
    assert min(found) >= 8 and max(found) <= 20


def test_tables_have_the_numbers_of_the_samples(result):
    rows = [row for row in force_table(result).rows if row[0] == "kept"]
    assert [row[1] for row in rows] == [2, 3, 4] and rows[0][3] == 9
    forces = result.forces()[result.kept]
    assert rows[1][4] == pytest.approx(forces[:, 1].mean())
    assert rows[1][5] == pytest.approx(forces[:, 1].std(ddof=1))
    for row in relaxation_table(result).rows:
        assert 0 < row[1] < row[2]


def test_the_field_can_be_given_to_the_likelihood(result):
    field = result.dataset.field
    covariance = field_covariance(field)
    draw = covariance.sample(np.random.default_rng(0), 1)
    assert covariance.inner(draw, draw)[0, 0] == pytest.approx(draw.size, rel=0.2)


def test_the_verb_writes_data_set_report_tables_and_figures(lab, tmp_path, capsys):
    assert main(["qc", str(lab), "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "S10: angular deviation: found" in said and "Remaining" in said
    assert "synthetic: the files were made by a model" in said
    report = json.loads((tmp_path / "qc.json").read_text())
    assert report["eligible"] == {
        "Total": 12,
        "Eliminated": 3,
        "Fails on angular deviation": 2,
        "Fails on x-shift": 2,
        "Remaining": 9,
    }
    assert report["thresholds"]["max_angle_deg"] == 1.0
    [s10] = [s for s in report["samples"] if s["name"] == "S10"]
    assert not s10["kept"] and s10["rejections"][0]["reason"] == "angular deviation"
    dataset, inputs = load_dataset(tmp_path / "dataset.npz")
    assert dataset.synthetic and dataset.n_samples == 9
    assert report["inputs"] in inputs
    with (tmp_path / "tables" / "eligible.csv").open() as stream:
        assert list(csv.reader(stream))[1:3] == [["Total", "12"], ["Eliminated", "3"]]
    for name in ("placement", "machine", "cycles", "forces", "boxes", "field", "noise"):
        assert (tmp_path / "figures" / f"{name}.png").stat().st_size > 5000
    assert {p.stem for p in (tmp_path / "figures").iterdir()} == set(FIGURE_NAMES)
    assert "force_deviation" in (tmp_path / "tables" / "requirements.txt").read_text()


@pytest.mark.lasting
def test_what_older_files_left_and_these_do_not_give_is_removed(some, tmp_path):
    """A study makes a data set anew without figures: those of the older one go."""
    folder, out = some("S1", "S2", "S10"), tmp_path / "out"
    make_dataset(folder, out, with_figures=False, show_progress=False)
    assert (out / "tables" / "rejections.csv").exists()
    (out / "figures").mkdir()
    for name in (*FIGURE_NAMES, "own"):  # as `calib qc` would have drawn, and one that is not ours
        (out / "figures" / f"{name}.png").write_bytes(b"older")
    (folder / "experiment.toml").write_text(
        (folder / "experiment.toml").read_text()
        + "[quality]\nmax_angle_deg = 9\nmax_x_shift_mm = 2\n"
    )
    result, _ = make_dataset(folder, out, with_figures=False, show_progress=False)
    assert not result.rejections
    assert [p.name for p in (out / "figures").iterdir()] == ["own.png"]
    assert not (out / "tables" / "rejections.csv").exists()
    assert (out / "tables" / "forces.csv").exists()


@pytest.mark.lasting
def test_the_same_files_give_the_same_bytes(some, tmp_path):
    folder = some("S1", "S2", "S3")
    for name in ("a", "b"):
        make_dataset(folder, tmp_path / name, with_figures=False, show_progress=False)
    for name in ("dataset.npz", "qc.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


@pytest.mark.lasting
def test_too_few_good_samples_are_a_result_and_no_data_set(some, capsys):
    folder = some("S1", *BAD)
    assert main(["qc", str(folder)]) == 1
    assert "fewer than two samples meet the rules" in capsys.readouterr().err
    report = json.loads((folder / "qc" / "qc.json").read_text())
    assert report["eligible"]["Remaining"] == 1 and report["dataset"] is None
    assert not (folder / "qc" / "dataset.npz").exists()


def test_a_sample_whose_test_stopped_early_is_rejected_by_the_protocol(some):
    folder = some("S1", "S2", "S3")
    path = folder / "S2" / "machine.csv"
    lines = path.read_text().splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("time_s"))
    kept = lines[: head + 1 + 640]  # 32 s: before the third hold
    kept[2] = "# samples: 640"
    path.write_text("\n".join(kept) + "\n")
    found = analyse(folder)
    [rejection] = found.rejections
    assert (rejection.sample, rejection.rule, rejection.reason) == ("S2", "protocol", "plateaus")
    assert rejection.threshold == 4
    assert found.dataset is not None and found.dataset.n_samples == 2
    assert found.dataset.force_covariance is None, "of two samples it has no inverse"


def test_a_clock_a_hold_off_rejects_the_sample_whose_frames_it_puts_into_wrong_holds(some):
    """Three frames in holds 2 to 4 and one after them: one hold of four has none."""
    folder = some("S1", "S2", "S3")
    path = folder / "S2" / "frames.csv"
    head, *rows = path.read_text().splitlines()
    later = [f"{name},{float(time) + 7.6:.3f}" for name, time in (row.split(",") for row in rows)]
    path.write_text("\n".join([head, *later]) + "\n")
    found = analyse(folder)
    [rejection] = found.rejections
    assert (rejection.sample, rejection.value) == ("S2", 1)
    assert "frames in no hold, while a hold has none" in rejection.text()
    assert "is the camera's clock within camera.max_clock_offset_s, 5 s?" in rejection.text()


def test_a_face_that_goes_in_is_told_and_no_more(some, capsys):
    """A very compressible block may do so."""
    folder = some("S1", "S2", text=EXPERIMENT + '[axes]\nz = "-z"\n')
    assert main(["qc", str(folder)]) == 0
    assert "warning: the face goes in by" in capsys.readouterr().out
    (folder / "experiment.toml").write_text(EXPERIMENT)
    assert main(["qc", str(folder)]) == 0
    assert "warning" not in capsys.readouterr().out


@pytest.mark.parametrize("key, size", [("width_mm", 13), ("height_mm", 2), ("height_mm", 5)])
def test_a_block_of_another_size_than_its_face_is_told(some, capsys, key, size):
    folder = some("S1", "S2", text=EXPERIMENT + f"[specimen]\n{key} = {size}\n")
    assert main(["qc", str(folder)]) == 0
    assert f"at most where specimen.{key} = {size}: is that right" in capsys.readouterr().out
    if size > 2:
        text = EXPERIMENT.replace("[field]\n", "[field]\nedge_mm = 1.7\n")
        assert text != EXPERIMENT
        (folder / "experiment.toml").write_text(text + f"[specimen]\n{key} = {size}\n")
        assert main(["qc", str(folder)]) == 0
        assert f"specimen.{key}" not in capsys.readouterr().out


def test_frames_of_a_sample_are_in_dic_alone(some):
    folder = some("S1", "S2")
    (folder / "S1" / "dic-old").mkdir()
    (folder / "S1" / "dic notes.txt").write_text("of the day")
    assert [one.dic.name for one in sample_files(folder, read_experiment(folder))] == ["dic"] * 2
    (folder / "S1" / "dic.toml").write_text("")
    assert sample_files(folder, read_experiment(folder))[0].dic.name == "dic"
    shutil.rmtree(folder / "S1" / "dic")
    (folder / "S1" / "dic.mat").write_text("")
    with pytest.raises(
        ValueError, match=r"S1: expected one of dic and dic\.\*.*found dic\.mat and"
    ):
        sample_files(folder, read_experiment(folder))


@pytest.mark.lasting
def test_a_force_far_from_the_others_is_rejected_where_a_rule_says_so(tmp_path):
    truths = {f"S{i}": GOOD[f"S{i}"] for i in range(1, 7)}
    truths["S6"] = Truth(stiffness=2.0, noise=0.005)
    text = EXPERIMENT + "\n[quality]\nmax_force_deviation = 5.0\n"
    found = analyse(write_laboratory(tmp_path / "lab", truths, text=text))
    assert [(r.sample, r.rule) for r in found.rejections] == [("S6", "max_force_deviation")]


def test_points_of_the_pin_tell_its_travel_to_hold_against_the_machines(tmp_path):
    # the sample's face, taken for a pin: the mean of u_y over a small rectangle is known
    box = "\n[mask]\npin_rectangle_mm = [0.2, 0.5, 0.5, 0.8]\n"
    text = EXPERIMENT + box
    still = {name: Truth(stiffness=GOOD[name].stiffness, noise=1e-3) for name in ("S1", "S2")}
    found = analyse(write_laboratory(tmp_path / "lab", still, text=text))
    row = accuracy_table(found).rows[0]
    assert row[1] == pytest.approx(-0.2, abs=0.01)
    inside = np.array([[x, y] for x in (-0.1, 0.05, 0.15) for y in (1.7, 1.8, 1.9)])
    travel = found.samples[0].face.travel
    down = [np.median(field_at(inside, t)[:, 1]) for t in travel]
    assert row[2] == pytest.approx((down[-1] - down[0]) / (travel.size - 1), rel=0.1)
    assert row[3] == pytest.approx(100 * abs(row[2] - row[1]) / abs(row[1]))


BREAKS = {
    "key": ("experiment.toml", "hold_s", "holds_s", "protocol.holds_s", "unknown key"),
    "value": ("experiment.toml", "hold_s = 4.0", "hold_s = -4.0", "protocol.hold_s", "-4.0"),
    "use": ("experiment.toml", "[2, 3, 4]", "[2, 3, 5]", "protocol.use[2]", "at most"),
    "order": ("experiment.toml", "[2, 3, 4]", "[2, 4, 3]", "protocol.use[2]", "more than"),
    "spacing": ("experiment.toml", "_mm = 0.4", "_mm = 1e-9", "field.spacing_mm", "at most 10000"),
    "up": (
        "experiment.toml",
        "[machine]",
        '[axes]\ny = "-y"\n[machine]',
        ":13: axes.y",
        "up by",
    ),
    "size": (
        "experiment.toml",
        "[machine]",
        "[specimen]\nheight_mm = 2500.0\n[machine]",
        "specimen.height_mm",
        "expected 0.1 to 1000: lengths are in mm",
    ),
    "not toml": ("experiment.toml", "[protocol]", "[protocol", "experiment.toml:4", "TOML"),
    "machine": ("S2/machine.csv", "time_s,", "when,", "machine.csv", "columns"),
    "frames": ("S2/frames.csv", "frame,time_s", "image,time", "frames.csv:1", "columns frame"),
    "time": ("S2/frames.csv", "\n2,", "\n2,x", "frames.csv:4", "time in s"),
    "frame order": ("S2/frames.csv", "\n2,", "\n0,", "frames.csv:4", "count up"),
    "frame lost": ("S2/frames.csv", "\n4,", "\n#", "frames.csv", "5 lines"),
    "points": ("S2/dic/B002.csv", "# points:", "# pts:", "B002.csv", "expected"),
    "static": ("static/B001.csv", "x_mm", "x_in", "B001.csv", "columns"),
}


@pytest.mark.parametrize("case", BREAKS)
def test_bad_input_is_one_sentence_with_file_place_found_and_expected(some, capsys, case):
    name, old, new, place, said = BREAKS[case]
    folder = some("S1", "S2")
    path = folder / name
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    assert main(["qc", str(folder)]) == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert error.startswith("calib: ") and place in error and said in error
    assert "expected" in error and "found" in error


@pytest.mark.parametrize("name", ["dataset.npz", "qc.json", "tables", "figures"])
def test_results_that_cannot_be_written_are_one_sentence(some, tmp_path, capsys, name):
    """A folder where a file of the results belongs, a file where a folder does."""
    folder, out = some("S1", "S2"), tmp_path / "out"
    out.mkdir()
    if name in ("tables", "figures"):
        (out / name).write_text("")
    else:
        (out / name).mkdir()
    assert main(["qc", str(folder), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"calib: {out / name}") and said.count("\n") == 1
    assert "cannot be written (" in said and "expected a place for the results" in said


def test_a_folder_of_results_that_cannot_be_made_is_refused_at_once(tmp_path, lab, capsys):
    (tmp_path / "file").write_text("")
    assert main(["qc", str(lab), "--out", str(tmp_path / "file" / "out")]) == 2
    said = f"--out: found the file {tmp_path / 'file'}, expected a folder or a new name"
    assert capsys.readouterr().err == f"calib: {said}\n"


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        ("[data]\nfolder = 1\n", "2: data.folder: found 1, expected a text in quotes"),
        ('[data]\nfolder = ["lab"]\n', '2: data.folder: found ["lab"], expected a text'),
        ("data = 1\n", "1: data: found 1, expected a table"),
        ("[[data]]\n", "1: data: found [{}], expected a table"),
        ('[data]\nsource = "experiment"\n', "data.folder: found"),
        ("", "1: data: found nothing, expected a section [data]"),
    ],
)
def test_a_study_that_names_no_folder_is_one_sentence(tmp_path, capsys, data, sentence):
    path = tmp_path / "study.toml"
    path.write_text(data)
    assert main(["qc", str(path)]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"calib: {path}:") and sentence in said and said.count("\n") == 1


def test_missing_files_and_folders_are_named(tmp_path, capsys):
    assert main(["qc", str(tmp_path / "none")]) == 2
    assert "none: found no such file, expected a folder" in capsys.readouterr().err
    assert main(["qc", str(tmp_path)]) == 2
    assert "experiment.toml: found no such file" in capsys.readouterr().err
    (tmp_path / "experiment.toml").write_text("")
    assert main(["qc", str(tmp_path)]) == 2
    assert "expected folders of samples with machine.csv, found none" in capsys.readouterr().err
    (tmp_path / "experiment.toml").write_text('samples = ["S1", "../S2"]\n')
    (tmp_path / "S1" / "dic").mkdir(parents=True)
    (tmp_path / "S1" / "machine.csv").touch()
    assert main(["qc", str(tmp_path)]) == 2
    assert "frames.csv: expected a file of this sample, found none" in capsys.readouterr().err


def test_a_folder_in_place_of_a_file_is_called_one_and_the_other_way_round(tmp_path):
    (tmp_path / "lab" / "experiment.toml").mkdir(parents=True)
    with pytest.raises(ValueError, match=r"experiment\.toml: found a folder, expected what"):
        analyse(tmp_path / "lab")
    lab = tmp_path / "other"
    (lab / "S1" / "machine.csv").mkdir(parents=True)
    (lab / "experiment.toml").write_text("")
    with pytest.raises(ValueError, match=r"machine\.csv: expected a file.*found a folder"):
        analyse(lab)
    with pytest.raises(ValueError, match=r"found a file, expected a folder with experiment"):
        analyse(lab / "experiment.toml")
    (lab / "static").touch()
    with pytest.raises(ValueError, match="static: expected a folder of frames, found a file"):
        static_folder(lab)


@pytest.mark.parametrize(
    "corners", [[[0, 0], [1, 0], [2, 0]], [[-5, 0], [5, 2], [5, 0], [-5, 2]]], ids=["line", "bow"]
)
def test_a_polygon_that_encloses_nothing_is_refused_by_its_key(corners, tmp_path):
    text = str([[float(x), float(y)] for x, y in corners])
    (tmp_path / "experiment.toml").write_text(f"[mask]\npolygon_mm = {text}\n")
    with pytest.raises(ValueError, match=r"toml:2: mask\.polygon_mm: .*whose sides do not cross"):
        read_experiment(tmp_path)
    good = "[mask]\npolygon_mm = [[0.0, 0.0], [4.0, 0.0], [1.0, 1.0], [0.0, 4.0]]\n"
    (tmp_path / "experiment.toml").write_text(good)
    assert read_experiment(tmp_path).mask.polygon_mm is not None


def test_an_empty_experiment_file_has_the_defaults_of_the_protocol(tmp_path):
    (tmp_path / "experiment.toml").write_text("")
    found = read_experiment(tmp_path)
    assert found.protocol.use == (3, 4, 5, 6, 7)
    np.testing.assert_array_equal(found.protocol.travel, [0.6, 0.8, 1.0, 1.2, 1.4])
    assert (found.quality.max_angle_deg, found.quality.max_x_shift_mm) == (1.0, 0.25)


# --- studies -------------------------------------------------------------------------------


def study_file(folder: Path, lab: Path, **changes: str) -> Path:
    """The embedded study of the thesis, on the laboratory's data."""
    from importlib import resources

    text = (resources.files("calib.study") / "embedded" / "thesis-forces.toml").read_text()
    swaps = {
        'source = "thesis-table-5.1"': f'source = "experiment"\nfolder = "{lab}"',
        "increments = [0.6, 0.8, 1.0, 1.2, 1.4]": "increments = [0.4, 0.6, 0.8]",
        "correlation_study = [0.0, 0.5, 0.9, 0.99]": "correlation_study = []",
        **changes,
    }
    for old, new in swaps.items():
        assert old in text
        text = text.replace(old, new)
    path = folder / "study.toml"
    path.write_text(text)
    return path


def test_a_study_takes_field_and_forces_of_the_files(lab, result, tmp_path):
    shutil.rmtree(lab / "qc", ignore_errors=True)
    study = load_study(study_file(tmp_path, lab))
    assert (lab / "qc" / "dataset.npz").is_file(), "made when the study is read"
    model = block_pin_model(study, study.hypotheses[0], (2, 2, 1))
    np.testing.assert_array_equal(model.points(), result.dataset.field.points)


@dataclass(frozen=True)
class Block(AnalyticBlock):
    """The stand-in for the FE model, seen at the points that were measured."""

    places: tuple[tuple[float, float], ...] = ()

    def points(self) -> Array:
        return np.array(self.places)


@dataclass(frozen=True)
class Blocks:
    """Makes it for a study."""

    places: tuple[tuple[float, float], ...]

    def __call__(self, study: Study, hypothesis: Hypothesis, cells: Cells) -> Block:
        return Block(**vars(analytic_block(study, hypothesis, cells)), places=self.places)


def test_field_and_forces_of_the_files_are_what_the_likelihood_is_of(lab, result, tmp_path):
    study = load_study(study_file(tmp_path, lab))
    blocks = Blocks(tuple(map(tuple, result.dataset.field.points.tolist())))
    context = Context(study, tmp_path / "out", blocks, serial_map, lambda _: None, False)
    run_stages(context, "data")
    data = load_data(tmp_path / "out").dataset
    np.testing.assert_array_equal(data.field.displacement, result.dataset.field.displacement)
    np.testing.assert_array_equal(data.force_covariance, result.dataset.force_covariance)
    assert data.synthetic and run_stages(context, "data") == ()
    forward = DirectForward(context.sampling_model(study.hypotheses[0]), with_field=True)
    likelihood = build_likelihood(data, forward, noise_of(study), field_floor=0.1)
    theta = np.array([[0.01, 0.3, 0.1], [0.02, 0.3, 0.1]])
    both, forces = likelihood.log_prob(theta), replace(likelihood, field=None).log_prob(theta)
    assert np.isfinite(both).all() and np.abs(both - forces).min() > 1.0


SHORT = {
    "n_runs = 20": "n_runs = 8",
    "n_held_out = 4": "n_held_out = 2",
    "n_refine = 8": "n_refine = 4",
    "n_ensembles = 4": "n_ensembles = 2",
    "n_walkers = 32": "n_walkers = 16",
    "max_steps = 20000": "max_steps = 100",
}
"""lines of the study file for runs and samples that take seconds"""


@pytest.mark.slow  # emulators, samples and figures of two hypotheses, half a minute and more
def test_a_study_of_an_experiment_runs_to_its_report(lab, result, tmp_path):
    study = load_study(study_file(tmp_path, lab, **SHORT))
    blocks = Blocks(tuple(map(tuple, result.dataset.field.points.tolist())))
    out = tmp_path / "out"
    run_study(
        study, out, simulate_factory=blocks, map_fn=serial_map, echo=[].append, show_progress=False
    )
    report = (out / "report.html").read_text()
    assert "a model made the instruments" in report
    assert "measured between the samples" in report


@pytest.mark.slow  # an emulator, samples, a population and figures: half a minute and more
def test_a_study_of_an_experiment_takes_its_samples_one_by_one(lab, result, tmp_path):
    text = SHORT | {
        "[geometry]": 'level = "samples"\n\n[population]\nscatter = { kappa = 0.3 }\n\n[geometry]',
    }
    study = load_study(study_file(tmp_path, lab, **text))
    blocks = Blocks(tuple(map(tuple, result.dataset.field.points.tolist())))
    out = tmp_path / "out"
    run_study(
        study, out, simulate_factory=blocks, map_fn=serial_map, echo=[].append, show_progress=False
    )
    [kept, *_] = load_summary(out / "posterior.nc")
    assert kept.population.sample_names == tuple(sorted(GOOD))
    posterior = population_posterior(
        Context(study, out, blocks, serial_map, lambda _: None, False), study.hypotheses[0]
    )
    assert len(posterior.samples.field) == len(GOOD), "the fields are used, not the forces alone"
    # One sample is stiffer than another as it was made; the fields know nothing of stiffness.
    seen = [np.log(one.mean) for one in kept.population.samples["kappa"]]
    made = np.log([GOOD[name].stiffness for name in kept.population.sample_names])
    assert np.corrcoef(seen, made)[0, 1] > 0.9
    assert "Population under" in (out / "report.html").read_text()
    assert not list((out / "chains").glob("*.population"))


def test_a_study_that_does_not_fit_the_experiment_is_refused_by_line(lab, tmp_path):
    cases = {
        "correlation_study = [0.0, 0.5, 0.9, 0.99]": (
            "correlation_study = [0.5]",
            "noise.correlation_study: found [0.5], expected no values",
        ),
        "increments = [0.6, 0.8, 1.0, 1.2, 1.4]": (
            "increments = [0.4, 0.7]",
            "increments[1]: found 0.7, expected a travel that was measured: 0.4, 0.6, 0.8 mm",
        ),
        "height = 2.5": ("height = 1.5", "geometry.height: found 1.5, expected about 2.5 mm, spec"),
        "width = 10.0": ("width = 5.0", "geometry.width: found 5.0, expected about 10 mm, spec"),
        'source = "thesis-table-5.1"': (
            'source = "experiment"\nfolder = "nowhere"',
            'data.folder: found "nowhere", expected a folder in',
        ),
    }
    for old, (new, sentence) in cases.items():
        with pytest.raises(StudyError) as caught:
            load_study(study_file(tmp_path, lab, **{old: new}))
        assert sentence in str(caught.value)
        assert str(caught.value).startswith(f"{tmp_path / 'study.toml'}:")


def test_a_block_that_does_not_reach_the_points_is_refused(lab, tmp_path, monkeypatch):
    monkeypatch.setattr(data_checks, "OTHER_SIZE", 1.0)
    for old, new, said in (
        ("height = 2.5", "height = 1.5", "geometry.height: found 1.5, expected "),
        ("width = 10.0", "width = 5.0", "geometry.width: found 5.0, expected "),
    ):
        with pytest.raises(StudyError, match=rf"{said}[0-9.]+ mm or more, as (high|wide) as the"):
            load_study(study_file(tmp_path, lab, **{old: new}))


def stating(folder: Path, sigma: tuple[float, float, float]) -> None:
    """Let every point file state SDs, mm, in the file's axes, and a correlation of 0.7 mm."""
    for path in folder.glob("S*/dic/*.csv"):
        frame = read_dic(path).frames[0]
        sigmas = np.tile(sigma, (frame.valid.size, 1))
        write_points(path, replace(frame, sigma=sigmas, correlation_length=0.7))


@pytest.mark.lasting
def test_what_a_dic_program_states_stands_in_for_static_frames(some):
    folder = some(*list(GOOD)[:3])
    alone = analyse(folder)
    assert alone.noise.stated is None
    stating(folder, (0.02, 0.03, 0.04))
    beside = analyse(folder)
    # halves are folded; with static frames, which measure it, the noise stays what it was
    expected = np.array([0.02, 0.03, 0.04]) / np.sqrt(2)
    np.testing.assert_allclose(beside.noise.stated, expected, rtol=1e-9)
    np.testing.assert_array_equal(beside.noise.mean_std, alone.noise.mean_std)
    lengths = [found.dataset.field.correlation_length for found in (alone, beside)]
    assert lengths[0] == lengths[1]
    assert "stated by the DIC program, field" in [row[0] for row in noise_table(beside).rows]
    shutil.rmtree(folder / "static")
    left = analyse(folder)
    without = left.noise.mean_std
    assert left.noise.repeats.correlation_length < 0.7 == left.dataset.field.correlation_length
    assert without.min() > 0
    np.testing.assert_allclose(without, expected / np.sqrt(3), rtol=0.05)


@pytest.mark.lasting
def test_the_scale_that_the_calibration_leaves_unknown_reaches_data_set_and_likelihood(
    some, tmp_path
):
    folder = some(*list(GOOD)[:2])
    for path in folder.glob("S2/dic/*.csv"):
        write_points(path, replace(read_dic(path).frames[0], scale_sd=0.003))
    data = analyse(folder).dataset
    assert data.field.scale_sd == 0.003
    save_dataset(tmp_path / "d.npz", data)
    data, _ = load_dataset(tmp_path / "d.npz")
    for study, expected in ((0.0, 0.003), (0.001, 0.003), (0.01, 0.01)):
        (scale,) = further_errors(data, NoiseSettings(field_scale_sd=study))
        assert (scale.name, scale.sd) == (SCALE, expected)
        np.testing.assert_array_equal(scale.field, expected * np.eye(data.travel.size))
        assert not scale.force.any()
    assert not further_errors(replace(data, field=None), NoiseSettings(field_scale_sd=0.01))


def test_frames_of_one_camera_are_refused_with_what_they_lack(some, capsys):
    folder = some("S1", "S2")
    for path in folder.glob("S2/dic/*.csv"):
        write_points(path, replace(read_dic(path).frames[0], is_planar=True))
    assert main(["qc", str(folder)]) == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert "S2/dic: expected stereo results" in error and "found frames of one camera" in error


def test_a_file_in_the_place_of_the_results_is_named(lab, capsys):
    assert main(["qc", str(lab), "--out", str(lab / "experiment.toml")]) == 2
    assert "--out: found the file" in capsys.readouterr().err


@pytest.mark.lasting
def test_stated_deviations_turn_with_the_axes(some):
    folder = some(*list(GOOD)[:2], text=EXPERIMENT)
    stating(folder, (0.02, 0.03, 0.04))
    turned = analyse(folder).samples[0].face.stated_std
    axes = read_experiment(folder).axes.matrix
    np.testing.assert_allclose(turned, np.abs(axes) @ [0.02, 0.03, 0.04], rtol=1e-9)


@pytest.mark.lasting
def test_frames_that_are_named_come_in_the_order_of_their_times(some, result):
    folder = some("S1", "S2")
    for name in ("S1", "S2"):
        place, table = folder / name / "dic", folder / name / "frames.csv"
        (place / "B000.csv").rename(place / "reference.csv")  # sorts after B004
        reference = replace(read_dic(place / "reference.csv").frames[0], name="reference")
        write_points(place / "reference.csv", reference)
        head, first, *others = table.read_text().splitlines()
        named = [f"B00{row}" for row in others] + [f"reference,{first.split(',')[1]}"]
        table.write_text("\n".join([head, *named]) + "\n")
    renamed = analyse(folder)
    for sample, known in zip(renamed.samples, result.samples[:2], strict=True):
        np.testing.assert_array_equal(sample.face.travel, known.face.travel)
        displacement = sample.face.lattice.displacement
        np.testing.assert_array_equal(displacement, known.face.lattice.displacement)
    text = table.read_text()
    table.write_text(text.replace(text.splitlines()[2].split(",")[1], named[0].split(",")[1]))
    with pytest.raises(WrongFile, match=r"frames.csv:3: expected another time than that of B001"):
        analyse(folder)


def test_numbers_that_lack_another_frame_than_the_folder_are_refused(some):
    """Else frames between would have the times of their neighbours: fields 15 % off, in silence."""
    folder = some("S1", "S2")
    table = folder / "S1" / "frames.csv"
    (folder / "S1" / "dic" / "B002.csv").unlink()
    lines = table.read_text().splitlines()
    table.write_text("\n".join(line for line in lines if not line.startswith("2,")) + "\n")
    assert len(analyse(folder).rejections) == 1  # a hold without a frame
    table.write_text("\n".join(line for line in lines if not line.startswith("3,")) + "\n")
    expected = r"frames.csv:4: expected the name of the frame, or a number that goes on as that of"
    with pytest.raises(WrongFile, match=expected + " B003 does, found 2"):
        analyse(folder)
    others = [f"{10 * k},{line.split(',')[1]}" for k, line in enumerate(lines[1:]) if k != 3]
    table.write_text("\n".join([lines[0], *others]) + "\n")  # count no frames
    assert len(analyse(folder).samples) == 2


@pytest.mark.parametrize(
    ("names", "table"),
    [
        ([f"20240101_1200{2 * k:02d}" for k in range(5)], [1, 2, 3, 4, 5]),  # a picture in 2 s
        ([f"img_{k:03d}_{s}s" for k, s in enumerate((0, 2, 3, 5, 6))], [1, 2, 3, 4, 5]),
        ([f"B{2 * k:04d}" for k in range(5)], [1, 2, 3, 4, 5]),  # every second one exported
        ([f"S_{k:04d}_0" for k in (0, 1, 2, 4, 5)], [1, 2, 3, 5, 6]),
        (["ref", *(f"S_{k:04d}_0" for k in (1, 2, 4, 5))], [0, 1, 2, 4, 5]),
        ([f"dic frame {k}" for k in range(5)], [1, 2, 3, 5, 6]),  # places in one file
    ],
)
def test_numbers_of_frames_that_may_be_right_are_taken(names, table):
    rows = [(k + 2, str(number), 1.0 * k) for k, number in enumerate(table)]
    _check_numbers(Path("frames.csv"), rows, names)


@pytest.mark.parametrize("end", ["", "_0"])
def test_numbers_of_frames_beside_those_of_the_files_are_refused_by_their_line(end):
    names = ["ref", *(f"S_{k:04d}{end}" for k in (1, 2, 4, 5))]
    rows = [(k + 2, str(number), 1.0 * k) for k, number in enumerate([0, 1, 2, 3, 5])]
    with pytest.raises(WrongFile, match=rf"frames.csv:5: .* that of S_0004{end} does, found 3"):
        _check_numbers(Path("frames.csv"), rows, names)


def test_a_folder_with_frames_and_no_machine_record_is_not_left_out_in_silence(some):
    folder = some("S1", "S2")
    (folder / "S1" / "machine.csv").rename(folder / "S1" / "Machine.csv")
    with pytest.raises(WrongFile, match=r"S1/machine.csv: expected a file of this sample, found"):
        analyse(folder)


def test_one_frame_of_one_camera_is_enough_to_refuse_a_sample(some):
    folder = some("S1", "S2")
    path = folder / "S1" / "dic" / "B002.csv"
    write_points(path, replace(read_dic(path).frames[0], is_planar=True))
    with pytest.raises(WrongFile, match=r"found frames of one camera \(planar\), B002"):
        analyse(folder)


def test_a_specimen_narrower_than_its_points_are_apart_rejects_all_samples(some):
    folder = some("S1", "S2", text=f"{EXPERIMENT}\n[specimen]\nwidth_mm = 8.0\n")
    rejections = analyse(folder).rejections
    assert {rejection.sample for rejection in rejections} == {"S1", "S2"}
    for rejection in rejections:
        assert rejection.threshold == "specimen.width_mm, 8, at most"
        assert 9.0 < float(rejection.value) <= 10.0
        assert "mm between points: found 9." in rejection.text()


def test_static_frames_that_are_copies_are_refused(some):
    folder = some("S1", "S3")
    first, second, *_ = _frames(folder / "static")[1:]
    shutil.copy(first, second)
    with pytest.raises(WrongFile, match="static: expected frames of their own, found one twice"):
        analyse(folder)


def test_static_frames_in_which_things_move_are_refused(some):
    folder = some("S1", "S2")
    for path in sorted((folder / "S1" / "dic").iterdir()):
        shutil.copy(path, folder / "static" / path.name)
    with pytest.raises(WrongFile, match=r"frames in which nothing moves, found an SD of 0\.\d+ mm"):
        analyse(folder)


def test_numbers_do_not_take_a_reference_that_sorts_last_for_the_last_frame(some):
    folder = some("S1", "S2")
    place = folder / "S1" / "dic"
    reference = read_dic(place / "B000.csv").frames[0]
    still = replace(reference, displacement=0.0 * reference.displacement, name="reference")
    (place / "B000.csv").unlink()
    write_points(place / "reference.csv", still)
    words = r"frames.csv:2: expected names of frames: reference has not moved, B001 has, found '0'"
    with pytest.raises(WrongFile, match=words):
        analyse(folder)


def test_cells_of_a_table_come_back_from_its_csv():
    texts = ("S1", 'the "first", again', 'say "x"', "two\nlines")
    table = QcTable("name", "title", ("sample", "mm"), tuple((text, 0.1) for text in texts))
    rows = list(csv.reader(io.StringIO(table_csv(table), newline="")))
    assert rows == [["sample", "mm"], *([text, "0.1"] for text in texts)]


def test_samples_that_make_no_data_set_together_are_refused_with_their_folder(tmp_path, capsys):
    # without noise no point is resolved
    still = {f"S{i}": Truth(stiffness=1.0 + 0.1 * i) for i in range(3)}
    folder = write_laboratory(tmp_path / "lab", still, static=0)
    assert main(["qc", str(folder)]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert f"{folder}: expected points that enough samples have, found none" in said


@pytest.mark.parametrize("what", ["machine.csv", "dic"])
def test_files_of_a_sample_that_were_copied_are_not_counted_twice(some, capsys, what):
    folder = some("S1", "S3", "S5")
    original, copy = folder / "S3" / what, folder / "S5" / what
    if original.is_dir():
        shutil.rmtree(copy)
        shutil.copytree(original, copy)
    else:
        shutil.copy(original, copy)
    assert main(["qc", str(folder)]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert f"{copy}: expected files of this sample, found a copy of {original}" in said


def _frames(folder):
    return sorted(path for path in folder.iterdir() if path.suffix == ".csv")


@pytest.mark.parametrize("inches", [False, True])
def test_exchanged_frames_and_frames_in_another_unit_reject_their_sample(some, inches):
    folder = some("S1", "S3", "S5")
    frames = _frames(folder / "S3" / "dic")
    two = [frames[-3], frames[-4]]
    texts = [path.read_text() for path in two]
    if inches:
        series = read_dic(frames[-1]).frames[0]
        write_points(frames[-1], replace(series, displacement=25.4 * series.displacement))
    else:
        for path, text in zip(two, reversed(texts), strict=True):
            path.write_text(text)
    [one] = [r for r in analyse(folder).rejections if r.sample == "S3"]
    assert one.rule == "protocol" and "mm of displacement (root mean square" in one.reason


def test_rigid_motion_between_frames_rejects_no_sample(some):
    """It is taken off before fields are averaged."""
    folder = some("S1", "S3", "S5")
    for path in _frames(folder / "S3" / "dic")[1:3]:
        series = read_dic(path).frames[0]
        moved = series.displacement + np.array([0.6, 0.0, 0.2])
        write_points(path, replace(series, displacement=moved))
    assert not [r for r in analyse(folder).rejections if "root mean square" in r.reason]


@pytest.mark.parametrize("factor", [1000.0, 1e-3])
def test_frames_that_are_all_in_another_unit_reject_their_samples(some, factor):
    folder = some("S1", "S3")
    for sample in ("S1", "S3"):
        for path in _frames(folder / sample / "dic"):
            frame = read_dic(path).frames[0]
            write_points(path, replace(frame, displacement=factor * frame.displacement))
    result = analyse(folder)
    assert {r.sample for r in result.rejections} == {"S1", "S3"} and result.dataset is None
    assert all("in another unit" in r.text() for r in result.rejections)


def test_a_sample_whose_displacements_are_three_times_the_others_is_rejected(some):
    """In frames of its own they look right, and ended all where samples were put in place."""
    folder = some("S1", "S3", "S5", "S7")
    for path in _frames(folder / "S3" / "dic"):
        frame = read_dic(path).frames[0]
        write_points(path, replace(frame, displacement=3.0 * frame.displacement))
    result = analyse(folder)
    [one] = [r for r in result.rejections if r.sample == "S3"]
    assert one.reason == "displacements over the median of the samples"
    assert one.value == pytest.approx(3.0, rel=0.05)
    assert result.dataset is not None


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_sample_of_which_one_axis_is_turned_is_rejected_and_no_other(some, axis):
    folder = some("S1", "S3", "S5", "S7")
    turned = np.ones(3)
    turned[axis] = -1.0
    for path in _frames(folder / "S3" / "dic"):
        frame = read_dic(path).frames[0]
        write_points(path, replace(frame, displacement=turned * frame.displacement))
    result = analyse(folder)
    [one] = result.rejections
    assert one.sample == "S3" and one.reason.startswith(f"displacement along {'xyz'[axis]} over")
    assert result.dataset is not None and result.dataset.n_samples == 3
    assert doubts(result) == []


def test_a_frame_in_which_the_camera_moved_up_is_warned_of_by_name(some, capsys):
    folder = some("S1", "S3", "S5", "S7")
    path = _frames(folder / "S3" / "dic")[-1]
    frame = read_dic(path).frames[0]
    write_points(path, replace(frame, displacement=frame.displacement + np.array([0, 0.15, 0])))
    assert main(["qc", str(folder)]) == 0
    assert "warning: the displacement of sample S3 along y is" in capsys.readouterr().out
    [said] = json.loads((folder / "qc" / "qc.json").read_text())["warnings"]
    assert "at worst at increment 4" in said


def test_readings_that_jump_in_a_hold_reject_their_sample(some):
    folder = some("S1", "S3", "S5", "S7")
    hold = machine_of(folder / "S5").holds[-2]
    _with_forces(
        folder / "S5" / "machine.csv",
        lambda time, force: force + 5.0 * (0.1 < time - hold.start < 0.4),
    )
    [one] = analyse(folder).rejections
    assert (one.sample, one.rule) == ("S5", "hold_noise")
    assert "expected at most 8 times" in one.text()


def machine_of(folder):
    """The machine's test of a sample that is among those analysed."""
    [found] = [s for s in analyse(folder.parent).samples if s.name == folder.name]
    return found.machine


def _with_forces(path, change):
    """The record with `change(time, force)` in place of its forces."""
    head, *rows = path.read_text().splitlines()
    while rows[0].startswith("#") or not rows[0][:1].isdigit():
        head += "\n" + rows.pop(0)
    names = head.splitlines()[-1].split(",")
    cells = [row.split(",") for row in rows]
    for row in cells:
        time = float(row[names.index("time_s")])
        row[names.index("force_N")] = repr(float(change(time, float(row[names.index("force_N")]))))
    path.write_text("\n".join([head, *(",".join(row) for row in cells)]) + "\n")


def test_a_sample_whose_force_is_ten_times_the_others_is_rejected(some):
    folder = some("S1", "S3", "S5", "S7")
    _with_forces(folder / "S5" / "machine.csv", lambda _, force: 10.0 * force)
    result = analyse(folder)
    [one] = [r for r in result.rejections if r.sample == "S5"]
    assert one.reason == "force over the median of the samples"
    assert isinstance(one.value, float) and 5.0 < one.value < 20.0


def test_a_frame_that_is_one_before_under_its_own_name_rejects_its_sample(some):
    folder = some("S1", "S3")
    frames = _frames(folder / "S3" / "dic")
    last, before = read_dic(frames[-1]).frames[0], read_dic(frames[-2]).frames[0]
    write_points(frames[-1], replace(last, displacement=before.displacement))
    [one] = analyse(folder).rejections
    assert one.sample == "S3" and "the displacements of" in one.text()


def test_a_frame_that_was_cut_off_rejects_its_sample_and_the_others_go_on(some):
    folder = some("S1", "S3", "S5", "S7")
    path = _frames(folder / "S3" / "dic")[-3]
    lines = path.read_text().splitlines()
    half = len(lines) // 2
    lost = [line.rpartition(",")[0] + ",0" for line in lines[half:]]
    path.write_text("\n".join([*lines[:half], *lost]) + "\n")
    result = analyse(folder)
    [one] = [r for r in result.rejections if r.sample == "S3"]
    assert one.reason == "points of half the face in all frames"
    assert one.rule == "min_points_share"
    value, limit = one.value, one.threshold
    assert isinstance(value, float) and isinstance(limit, float)
    kept = analyse(folder, rules=Rules(min_points_share=0.9 * 0.7 * value / limit))
    assert not [r for r in kept.rejections if r.rule == "min_points_share"]
    assert "expected at least" in one.text()
    assert result.dataset is not None


def test_links_to_nothing_are_named_and_what_a_mac_leaves_is_not_read(some, capsys):
    folder = some("S1", "S3", "S5")
    (folder / "S3" / "dic" / "._B0001.csv").write_bytes(b"\0\x05\x16\x07")
    assert analyse(folder).dataset is not None
    lost = folder / "S3" / "dic" / "B9999.csv"
    lost.symlink_to(folder / "nowhere.csv")
    assert main(["qc", str(folder)]) == 2
    assert f"{lost}: expected a file, found a link to nothing" in capsys.readouterr().err
    lost.unlink()
    shutil.rmtree(folder / "static", ignore_errors=True)
    (folder / "static").symlink_to(folder / "nowhere")
    assert main(["qc", str(folder)]) == 2
    assert "static: expected a file or folder, found a link to nothing" in capsys.readouterr().err


@pytest.mark.lasting
def test_what_is_stated_of_points_beside_the_sample_says_nothing_of_its_noise(some):
    rectangle = np.array([0.2, 0.5, 0.5, 0.8])
    pin = f"\n[mask]\npin_rectangle_mm = {rectangle.tolist()}\n"
    folder = some(*list(GOOD)[:2], text=EXPERIMENT + pin)
    stating(folder, (0.02, 0.03, 0.04))
    for path in folder.glob("S*/dic/*.csv"):
        frame = read_dic(path).frames[0]
        place = frame.position[:, :2]
        on_pin = np.all((place >= rectangle[:2]) & (place <= rectangle[2:]), axis=1)
        assert on_pin.any()
        blurred = np.where(on_pin[:, None], 1.0, frame.sigma)
        write_points(path, replace(frame, sigma=blurred))
    stated = analyse(folder).samples[0].face.stated_std
    np.testing.assert_allclose(stated, [0.02, 0.03, 0.04], rtol=1e-9)


def with_rules(folder: Path, lab: Path, text: str) -> Path:
    """The study with a section [data.quality]."""
    source = f'source = "experiment"\nfolder = "{lab}"\n[data.quality]\n{text}'
    return study_file(folder, lab, **{'source = "thesis-table-5.1"': source})


@pytest.mark.lasting
def test_rules_of_a_study_go_before_those_of_the_experiment_and_are_told(
    some, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("calib.data.qc.figures.all_figures", lambda result: {})
    lab = some("S1", "S3", "S5", "S7")  # turned by 0.4, 0, 0.4 and 0.2 degrees
    study = with_rules(tmp_path, lab, "max_angle_deg = 0.3")
    assert main(["qc", str(study)]) == 0
    said = capsys.readouterr().out
    assert "S1: angular deviation: found 0.4" in said and "expected at most 0.3 degrees" in said
    report = json.loads((lab / "qc" / "qc.json").read_text())
    assert [s["name"] for s in report["samples"] if s["kept"]] == ["S3", "S7"]
    assert report["thresholds"]["max_angle_deg"] == 0.3
    assert report["thresholds_of_the_study"] == {"max_angle_deg": 0.3}
    # the data set of other rules is not that of these files alone
    assert experiment_dataset(lab).n_samples == 4
    assert experiment_dataset(lab, Rules(max_angle_deg=0.3)).n_samples == 2


@pytest.mark.parametrize("verb", ["qc", "run"])
def test_a_wrong_rule_of_a_study_is_refused_by_file_line_and_key(verb, lab, tmp_path, capsys):
    for text, words in (
        ("max_angle_deg = -1", "data.quality.max_angle_deg: found -1, expected"),
        ("max_angel_deg = 1", "data.quality.max_angel_deg: found an unknown key, expected one of"),
    ):
        study = with_rules(tmp_path, lab, text)
        line = study.read_text().splitlines().index(text) + 1
        assert main([verb, str(study)]) == 2
        assert f"{study}:{line}: {words}" in capsys.readouterr().err


def test_rules_without_an_experiment_are_refused(tmp_path):
    study = tmp_path / "study.toml"
    source = 'source = "thesis-table-5.1"'
    text = study_file(tmp_path, tmp_path).read_text()
    found = f'source = "experiment"\nfolder = "{tmp_path}"'
    study.write_text(text.replace(found, f"{source}\n[data.quality]\nmin_points = 50"))
    with pytest.raises(StudyError, match=r"data\.quality: found a table, expected none without"):
        load_study(study)
