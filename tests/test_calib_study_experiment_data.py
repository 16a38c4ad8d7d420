"""The data set kept beside a laboratory's files: of these files and of this code, or made anew."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from importlib import resources
from pathlib import Path

import pytest
from closed_form_laboratory import Truth, write_laboratory

from calib import __version__
from calib.code_hash import code_hash, hash_of_modules
from calib.data import Dataset
from calib.data.dataset_file import load_dataset, save_dataset
from calib.study import experiment_data, stage_list
from calib.study.config import Study, load_study
from calib.study.context import Context, block_pin_model
from calib.study.data_stage import load_data, measured, save_data
from calib.study.experiment_data import MEASURED, experiment_dataset, warnings_kept
from calib.study.judgement import measurement_noise
from calib.study.stages import run_stages
from calib.study.tables import data_table
from fe.executors import serial_map

STUDY = "thesis-forces.toml"
OTHER = "f" * 64
"""hash of another code"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of two samples, and the data set made of them."""
    samples = {f"S{i}": Truth(stiffness=1 + 0.3 * i, noise=0.005) for i in (1, 2)}
    folder = write_laboratory(tmp_path_factory.mktemp("made") / "lab", samples)
    experiment_dataset(folder)
    return folder


@pytest.fixture
def lab(made: Path, tmp_path: Path) -> Path:
    """A copy for one test, which changes it."""
    return Path(shutil.copytree(made, tmp_path / "lab"))


def dataset_of(lab: Path) -> Dataset:
    """As another process would find it."""
    experiment_data._dataset.cache_clear()
    return experiment_dataset(lab)


def made_by(monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    """As if the modules had another text."""
    for module in (experiment_data, stage_list):
        monkeypatch.setattr(module, "code_hash", lambda _: code)


def test_a_kept_data_set_is_used_as_long_as_files_and_code_are_the_same(lab, monkeypatch):
    kept = lab / "qc" / "dataset.npz"
    data, made_from = load_dataset(kept)
    # what is kept is told from what is made anew by a name that no file has
    save_dataset(kept, replace(data, name="kept"), made_from)
    assert dataset_of(lab).name == "kept"
    made_by(monkeypatch, OTHER)
    assert dataset_of(lab).name == data.name
    assert load_dataset(kept)[1].endswith(OTHER)
    assert json.loads((lab / "qc" / "qc.json").read_text())["code"] == OTHER


def test_a_data_set_whose_key_tells_no_code_is_made_anew(lab):
    kept = lab / "qc" / "dataset.npz"
    data, made_from = load_dataset(kept)
    files, _ = made_from.split()
    save_dataset(kept, replace(data, name="older"), f"{__version__} {files}")
    assert dataset_of(lab).name == data.name


@pytest.mark.parametrize(
    ("key", "size", "name"),
    [
        ("height = 2.5", 3.5, "height_mm"),
        ("width = 10.0", 7.0, "width_mm"),
        ("depth = 10.0", 13.0, "depth_mm"),
    ],
)
def test_a_block_of_another_size_than_the_experiment_s_is_refused(lab, tmp_path, key, size, name):
    text = study_text(lab, '\nlevel = "summary"')
    assert key in text
    geometry = key.split(" ")[0]
    (tmp_path / "study.toml").write_text(text.replace(key, f"{geometry} = {size}"))
    with pytest.raises(
        ValueError, match=f"geometry.{geometry}: found {size}, expected about"
    ) as no:
        load_study(tmp_path / "study.toml")
    assert f"specimen.{name} of {lab / 'experiment.toml'}" in str(no.value)
    (tmp_path / "study.toml").write_text(text.replace("height = 2.5", "height = 2.7"))
    load_study(tmp_path / "study.toml")
    prior = '\n[prior.height]\ndistribution = "uniform"\nlow = 3.2\nhigh = 3.4\n'
    (tmp_path / "study.toml").write_text(text.replace("height = 2.5", "height = 3.3") + prior)
    load_study(tmp_path / "study.toml")  # which says what is known of it


def test_samples_that_are_rejected_are_told_by_the_study(tmp_path) -> None:
    samples = {f"S{i}": Truth(stiffness=1 + 0.3 * i, noise=0.005) for i in (1, 2)}
    samples["S3"] = Truth(x_shift=-0.6, noise=0.005)
    lab = write_laboratory(tmp_path / "lab", samples)
    study = study_of(lab, tmp_path)
    lines: list[str] = []
    context = Context(study, tmp_path / "out", block_pin_model, serial_map, lines.append, False)
    assert run_stages(context, "data") == ("data",)
    [said] = [line for line in lines if "left out" in line]
    assert said.startswith("  left out: S3: x-shift: found 0.")
    kept = load_data(tmp_path / "out")
    assert [f"  left out: {one}" for one in kept.left_out] == [said]
    note = data_table(json.loads((tmp_path / "out" / "data.json").read_text())).note
    assert note.startswith("Left out by quality control: S3: x-shift")


def study_of(lab: Path, folder: Path, more: str = "") -> Study:
    """A study of the laboratory's files, with `more` lines of its section [data]."""
    (folder / "study.toml").write_text(study_text(lab, more))
    return load_study(folder / "study.toml")


def study_text(lab: Path, more: str) -> str:
    text = (resources.files("calib.study") / "embedded" / STUDY).read_text()
    for old, new in (
        ('source = "thesis-table-5.1"', f'source = "experiment"\nfolder = "{lab}"{more}'),
        ("increments = [0.6, 0.8, 1.0, 1.2, 1.4]", "increments = [0.4, 0.6, 0.8]"),
    ):
        assert old in text
        text = text.replace(old, new)
    return text


def test_the_noise_of_a_measured_field_is_that_by_which_an_emulator_is_judged(lab, tmp_path):
    field = dataset_of(lab).field
    assert field is not None
    assert measurement_noise(study_of(lab, tmp_path)).field == field.noise_std.min()
    forces_only = study_of(lab, tmp_path, '\nlevel = "summary"')
    assert measurement_noise(forces_only).field is None


def test_a_study_of_the_files_reads_them_again_by_other_code_and_says_so(
    lab, tmp_path, monkeypatch
):
    study = study_of(lab, tmp_path)
    lines: list[str] = []
    context = Context(study, tmp_path / "out", block_pin_model, serial_map, lines.append, False)
    assert run_stages(context, "data") == ("data",)
    assert run_stages(context, "data") == ()
    made_by(monkeypatch, OTHER)
    assert run_stages(context, "data") == ("data",)
    assert lines[-1].startswith("data") and "changed: code of calib.data" in lines[-1]


def test_the_hash_is_that_of_every_module_and_of_nothing_else(tmp_path):
    package = tmp_path / "package"
    shutil.copytree(Path(str(resources.files(MEASURED))), package)
    assert hash_of_modules(package) == code_hash(MEASURED)
    (package / "notes.txt").write_text("no code")
    assert hash_of_modules(package) == code_hash(MEASURED)
    for module in ("qc/averaging.py", "readers/units.py", "dataset.py"):
        before = hash_of_modules(package)
        with (package / module).open("a") as stream:
            stream.write("# changed\n")
        assert hash_of_modules(package) != before, module
    before = hash_of_modules(package)
    (package / "qc" / "masks.py").rename(package / "qc" / "other.py")
    assert hash_of_modules(package) != before


def test_warnings_of_quality_control_come_with_the_data_and_older_reports_have_none(lab, tmp_path):
    folder = tmp_path / "other"
    (folder / "qc").mkdir(parents=True)
    report = folder / "qc" / "qc.json"
    assert warnings_kept(folder) == ()
    report.write_text("{}\n")
    assert warnings_kept(folder) == ()
    report.write_text('{"warnings": ["the displacement of sample S2 is off"]}\n')
    assert warnings_kept(folder) == ("the displacement of sample S2 is off",)
    data = replace(measured(study_of(lab, tmp_path)), warnings=("a", "b"))
    save_data(tmp_path, data)
    assert load_data(tmp_path).warnings == ("a", "b")
