"""A study of samples one by one: from its file to tables, figures and the report."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import arviz as az
import numpy as np
import pytest
from analytic_block import analytic_block

from calib.data.sample_forces import has_samples, read_sample_forces
from calib.inference import NoiseSettings
from calib.inference.sample_errors import SampleErrors
from calib.study.artifacts import mark_begun, read_record, write_record
from calib.study.config import Study, StudyError, load_study, read_study
from calib.study.data_source import measured_dataset
from calib.study.data_stage import StudyData, save_data
from calib.study.hierarchical_stage import with_own_zero
from calib.study.population_checks import check_level
from calib.study.sections import DataSource
from calib.study.stage_list import stages_of
from calib.study.stages import StudyResult, run_study
from calib.study.summary import format_table, load_summary
from calib.study.summary_files import to_json
from calib.toml_file import Contradiction
from fe.executors import serial_map
from fe.response import Array

TRAVEL = (0.6, 0.8, 1.0, 1.2, 1.4)
N = 8
TRUE_KAPPA, TRUE_SCATTER = 0.012, 0.1
NOISE = 0.01
"""N, SD of one force"""
ANY = 1.0 + np.random.default_rng(1).random((N, 5))
"""forces that no model has made"""

STUDY = """
name = "blocks"
seed = 3
increments = [0.6, 0.8, 1.0, 1.2, 1.4]
[data]
source = "forces.csv"
level = "samples"
[population]
scatter = { kappa = 0.3 }
[geometry]
width = 10.0
depth = 10.0
height = 2.5
pin_width = 4.0
pin_fillet = 0.3
[mesh]
sampling = [12, 6, 2]
check = [18, 9, 3]
[[hypothesis]]
name = "sliding"
pin = "slide"
base = "slide"
[noise]
load_cell_sd = 0.01
sample_correlation = 0.9
travel_zero_sd = 0.005
[prior.kappa]
distribution = "log_uniform"
low = 0.005
high = 0.03
[prior.r]
distribution = "uniform"
low = 0.0
high = 0.5
[prior.s]
distribution = "uniform"
low = 0.0
high = 0.25
[design]
n_runs = 12
n_held_out = 2
n_refine = 3
[sampler]
n_ensembles = 2
n_walkers = 16
n_autocorrelation = 10
max_steps = 300
min_ess = 50
max_r_hat = 1.2
"""


def forces_of(study: Study, rng: np.random.Generator) -> tuple[Array, Array]:
    """(N,) ln kappa and (N, 5) forces [N] of blocks that differ in stiffness."""
    model = analytic_block(study, study.hypotheses[0], study.mesh.check)
    own = np.log(TRUE_KAPPA) + TRUE_SCATTER * rng.standard_normal(N)
    clean = np.exp(own)[:, None] * model(np.array([0.2, 0.1])).force
    return own, clean + NOISE * rng.standard_normal(clean.shape)


def csv_of(forces: Array) -> str:
    rows = [
        f"S{i + 1},{travel},{force:.6f}"
        for i, own in enumerate(forces)
        for travel, force in zip(TRAVEL, own, strict=True)
    ]
    return "\n".join(["# made by a test", "sample,travel_mm,force_N", *rows]) + "\n"


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[StudyResult, Array, list[str]]:
    """A finished study, the samples' true ln kappa, and what it said."""
    folder = tmp_path_factory.mktemp("population")
    (folder / "forces.csv").write_text(csv_of(ANY))
    (folder / "study.toml").write_text(STUDY)
    own, forces = forces_of(load_study(folder / "study.toml"), np.random.default_rng(5))
    (folder / "forces.csv").write_text(csv_of(forces))
    lines: list[str] = []
    result = run_study(
        load_study(folder / "study.toml"),
        folder / "run",
        simulate_factory=analytic_block,
        map_fn=serial_map,
        echo=lines.append,
        show_progress=False,
    )
    return result, own, lines


@pytest.mark.slow
def test_the_population_holds_the_truth_and_is_told(
    finished: tuple[StudyResult, Array, list[str]],
) -> None:
    """Truth within four posterior SDs (fixed seed; 1e-4 for each of ten)."""
    result, own, lines = finished
    [summary] = load_summary(result.posterior)
    found = summary.population
    assert found is not None and found.varying == ("kappa",)
    scatter = found.population["sd_kappa"]
    assert scatter.unit == "1" and abs(scatter.mean - TRUE_SCATTER) < 4 * scatter.sd
    for spread, true in zip(found.samples["kappa"], np.exp(own), strict=True):
        assert spread.unit == "MPa" and abs(spread.mean - true) < 4 * spread.sd
    new, centre = found.new["kappa"], found.population["kappa"]
    assert new.sd > centre.sd  # a new sample is less known than the population's middle
    text = "\n".join(lines)
    for title in ("Population under sliding", "A new sample under", "Samples under sliding"):
        assert title in text and title in format_table([summary])
    assert json.loads(to_json([summary]))[0]["population"]["sample_names"][0] == "S1"


@pytest.mark.slow
def test_a_population_of_a_run_before_is_not_shown_with_the_posterior(
    finished: tuple[StudyResult, Array, list[str]], tmp_path: Path
) -> None:
    """As where new data were sampled and the run was stopped before its population."""
    out = tmp_path / "copy"
    shutil.copytree(finished[0].out, out)
    record = read_record(out, "posterior")
    assert record is not None and load_summary(out / "posterior.nc")[0].population is not None
    write_record(out, replace(record, inputs=record.inputs | {"stage sample": "0" * 16}))
    [summary] = load_summary(out / "posterior.nc")
    assert summary.population is None and not summary.passed
    failures = " ".join(summary.failures)
    assert "population_sliding.nc is left out: it is of another stage sample" in failures
    write_record(out, record)
    mark_begun(out, "population")
    [summary] = load_summary(out / "posterior.nc")
    assert summary.population is None
    assert "it was begun again and not finished" in " ".join(summary.failures)


@pytest.mark.slow
def test_the_report_shows_samples_and_population(
    finished: tuple[StudyResult, Array, list[str]],
) -> None:
    result, _, _ = finished
    names = {path.name for path in result.figures}
    assert {"population_sliding.png", "population_forces_sliding.png"} <= names
    html = result.report.read_text()
    assert "Population and samples" in html and "A new sample under sliding" in html


@pytest.mark.slow
def test_the_file_has_a_dimension_of_samples(
    finished: tuple[StudyResult, Array, list[str]],
) -> None:
    result, _, _ = finished
    data: Any = az.from_netcdf(str(result.out / "population_sliding.nc"), engine="h5netcdf")
    assert data["posterior"]["kappa_sample"].dims == ("chain", "draw", "sample")
    assert data["posterior"]["kappa_sample"].attrs["units"] == "MPa"
    assert data["observed_data"]["force"].dims == ("sample", "travel")
    assert data["posterior_predictive"]["force_new"].sizes["travel"] == 5
    data.close()


def refusal(text: str, folder: Path) -> str:
    (folder / "forces.csv").write_text(csv_of(ANY))
    (folder / "mean.csv").write_text(
        "travel_mm,force_mean_N,force_sd_N,n_samples\n"
        + "".join(f"{travel},{travel},0.1,5\n" for travel in TRAVEL)
    )
    with pytest.raises(StudyError) as error:
        read_study(text.encode(), file="study.toml", folder=folder)
    return str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('"forces.csv"', '"mean.csv"', "these data hold no samples one by one"),
        ('"forces.csv"', '"thesis-table-5.1"', "these data hold no samples one by one"),
        ('level = "samples"', 'level = "mean"', "population: found a table, expected none with"),
        ("[population]\nscatter = { kappa = 0.3 }", "", "expected a section [population] with it"),
        ("{ kappa = 0.3 }", "{ height = 0.1 }", "expected one or more of kappa, r, s"),
        ("{ kappa = 0.3 }", "{ kappa = 0.3, fillet = 0.1 }", "expected an unknown of the forward"),
        ("{ kappa = 0.3 }", "{ kappa = -1.0 }", "population.scatter"),
        ('level = "samples"', 'level = "all"', "data.level"),
        (
            "[design]",
            '[prior.force_noise]\ndistribution = "log_uniform"\nlow = 0.5\nhigh = 2.0\n[design]',
            "where errors have known sizes",
        ),
        ("[noise]", "[noise]\nforce_freedom = 4.0", "where errors of the forces are normal"),
        # though eight samples at five travels have a measured covariance
        ("load_cell_sd = 0.01", "load_cell_sd = 0.8", "the smallest SD between 8 samples"),
    ],
)
def test_what_does_not_go_together_is_refused(
    old: str, new: str, expected: str, tmp_path: Path
) -> None:
    assert old in STUDY
    message = refusal(STUDY.replace(old, new), tmp_path)
    assert expected in message and message.count("\n") == 0


def test_too_few_walkers_for_mean_and_scatter_are_refused(tmp_path: Path) -> None:
    few = STUDY.replace("n_walkers = 16", "n_walkers = 8")
    few = few.replace("{ kappa = 0.3 }", "{ kappa = 0.3, r = 0.1, s = 0.1 }")
    assert "twice the 6 unknowns of the population" in refusal(few, tmp_path)


def test_a_table_is_mean_and_sd_of_the_forces_alone(tmp_path: Path) -> None:
    path = tmp_path / "forces.csv"
    path.write_text(csv_of(ANY))
    whole = measured_dataset(DataSource(source=str(path)))
    table = measured_dataset(DataSource(source=str(path), level="summary"))
    assert whole.samples is not None and whole.force_covariance is not None
    assert table.samples is None and table.force_covariance is None and table.field is None
    assert np.array_equal(table.force_mean, whole.force_mean)
    assert np.array_equal(table.force_sd, whole.force_sd) and table.n_samples == N
    assert not DataSource(source="experiment", folder="lab", level="summary").has_field
    assert DataSource(source="experiment", folder="lab").has_field


def test_other_levels_have_no_stage_of_the_population() -> None:
    study = load_study("thesis-forces")
    assert "population" not in [stage.name for stage in stages_of(study)]


def test_one_sample_is_refused() -> None:
    data = measured_dataset(DataSource(source="thesis-table-5.1"))
    with pytest.raises(Contradiction, match=r"no samples one by one"):
        check_level(DataSource(source="thesis-table-5.1", level="samples"), data)


def test_sample_forces_are_read_in_any_order_and_kept_by_the_study(tmp_path: Path) -> None:
    path = tmp_path / "forces.csv"
    lines = csv_of(ANY).splitlines()
    path.write_text("\n".join([*lines[:2], *sorted(lines[2:], reverse=True)]))
    assert has_samples(path)
    dataset = read_sample_forces(path)
    assert dataset.samples is not None
    order = np.argsort(dataset.samples.names)
    assert dataset.samples.force[order] == pytest.approx(ANY, abs=1e-6)
    assert dataset.force_covariance == pytest.approx(np.cov(ANY.T), abs=1e-5)
    paths = save_data(tmp_path, StudyData(dataset, None, None, None))
    assert paths[0].is_file()


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("S1,0.6,", "S1,0.7,", "found other travels"),
        ("S2,0.6,", "S1,0.6,", "again, expected once"),
        ("S1,0.8,", "S1,0.8,-", "expected a positive number"),
        ("S1,1.0,", "S1,1.0,x,", "found 4 values"),
        ("S2,0.6,", ",0.6,", ":8: sample: found an empty cell, expected a name"),
        ("S1,0.8,", f"S1,0.8,{'9' * 200_000}", "found a cell of more than 131072 characters"),
        (
            "S1,0.8,",
            f"S1,0.8,{'x' * 9_000}",
            r"x'\.\.\., expected a positive number",
        ),
    ],
)
def test_damaged_sample_forces_are_refused(
    old: str, new: str, expected: str, tmp_path: Path
) -> None:
    path = tmp_path / "forces.csv"
    path.write_text(csv_of(ANY).replace(old, new, 1))
    with pytest.raises(ValueError, match=expected) as error:
        read_sample_forces(path)
    assert str(path) in str(error.value) and len(str(error.value)) < 500


def test_columns_of_sample_forces_come_in_any_order(tmp_path: Path) -> None:
    path, turned = tmp_path / "forces.csv", tmp_path / "turned.csv"
    path.write_text(csv_of(ANY))
    rows = [line.split(",") for line in csv_of(ANY).splitlines() if not line.startswith("#")]
    turned.write_text("\n".join(",".join(row[::-1]) for row in rows))
    assert has_samples(turned)
    samples = [read_sample_forces(one).samples for one in (path, turned)]
    assert samples[0] is not None and samples[1] is not None
    assert samples[0].names == samples[1].names
    assert samples[0].force.tobytes() == samples[1].force.tobytes()


def test_samples_that_are_copies_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "forces.csv"
    path.write_text(csv_of(np.tile(ANY[:1], (4, 1))))
    with pytest.raises(ValueError, match=r"force_N: found .* N in all samples at 0\.6 mm"):
        read_sample_forces(path)


def test_a_sample_that_is_a_copy_of_one_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "forces.csv"
    forces = ANY.copy()
    forces[-1] = forces[1]
    path.write_text(csv_of(forces))
    with pytest.raises(ValueError, match=rf"S{len(forces)}: found the forces of S2 at all travels"):
        read_sample_forces(path)


def test_a_mesh_error_may_be_mistaken_for_the_zero_of_single_samples() -> None:
    own = SampleErrors(travel_zero_sd=0.015)
    data = measured_dataset(DataSource(source="thesis-table-5.1"))
    none, some = (NoiseSettings(travel_zero_sd=sd) for sd in (0.0, 0.02))
    assert with_own_zero(data, none, own).travel_zero_sd == 0.015
    stated = replace(data, travel_zero_sd=0.02)  # by the data where that is more
    assert with_own_zero(stated, none, own) == with_own_zero(data, some, own)
    both = with_own_zero(data, some, own).travel_zero_sd
    assert both == pytest.approx(0.025)
