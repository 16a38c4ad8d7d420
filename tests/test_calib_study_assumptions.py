"""What a report says is assumed is what is used, also where the data set states it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.data import Dataset, FieldData
from calib.study import Study
from calib.study.assumptions import assumptions_table
from calib.study.config import read_study
from calib.study.data_stage import measured
from tests.test_calib_study_config import AS_VIRTUAL, BASE, FORCES
from tests.test_calib_study_population import ANY, STUDY, csv_of


@pytest.fixture
def study(tmp_path: Path) -> Study:
    (tmp_path / "forces.csv").write_text(FORCES)
    return read_study(BASE.encode(), file="own.toml", folder=tmp_path)


@pytest.fixture
def virtual(tmp_path: Path) -> Study:
    text = AS_VIRTUAL.replace("travel_zero_sd", "field_scale_sd = 0.002\ntravel_zero_sd")
    return read_study(text.encode(), file="own.toml", folder=tmp_path)


def with_field(dataset: Dataset, scale_sd: float) -> Dataset:
    points, noise = np.array([[0.5, 1.0], [1.5, 1.0]]), np.full(3, 0.01)
    field = FieldData(points, np.ones((2, 2, 3)), noise, 0.5, 0.5, scale_sd=scale_sd)
    return replace(dataset, field=field)


def scale_rows(study: Study, dataset: Dataset) -> list[tuple[str, str]]:
    rows = assumptions_table(study, dataset).rows
    return [(name, value) for name, value, _ in rows if name.startswith("scale of the field")]


def test_the_scale_of_the_calibration_is_told_where_it_is_the_larger(study, virtual):
    own, stated = (f"scale of the field, relative SD{end}" for end in ("", ", stated by the data"))
    dataset = measured(study).dataset
    assert scale_rows(study, dataset) == []
    assert scale_rows(study, with_field(dataset, 0.0003)) == [(stated, "0.0003")]
    assert scale_rows(virtual, with_field(dataset, 0.0003)) == [(own, "0.002")]
    assert scale_rows(virtual, with_field(dataset, 0.005)) == [(stated, "0.005")]


def test_the_zero_of_the_travel_is_told_where_the_data_state_more(study):
    dataset = measured(study).dataset
    own = study.noise.travel_zero_sd
    for sd, end in ((0.0, ""), (0.5 * own, ""), (2 * own, ", stated by the data")):
        rows = assumptions_table(study, replace(dataset, travel_zero_sd=sd)).rows
        assert (f"zero of the travel, SD{end}", f"{max(sd, own):g}", "mm") in rows


def test_a_measured_covariance_takes_the_place_of_the_assumed_correlation(study):
    dataset = measured(study).dataset
    assumed = {name for name, _, _ in assumptions_table(study, dataset).rows}
    covariance = np.diag(dataset.force_sd**2)
    known = assumptions_table(study, replace(dataset, force_covariance=covariance)).rows
    assert ("covariance of the mean force", "measured between the samples", "-") in known
    gone = assumed - {name for name, _, _ in known}
    assert "correlation of one sample's deviation between neighbouring increments" in gone


def test_lengths_of_a_fields_mesh_error_are_told_where_there_is_a_field(study):
    dataset = measured(study).dataset
    length = "correlation length of the field's mesh error"

    def told(used: Dataset) -> set[str]:
        return {name for name, _, _ in assumptions_table(study, used).rows}

    assert length in told(with_field(dataset, 0.0)) and length not in told(dataset)


def test_what_is_assumed_of_samples_one_by_one_is_told(study: Study, tmp_path: Path) -> None:
    plain = assumptions_table(study, measured(study).dataset).rows
    assert not [name for name, _, _ in plain if "between samples," in name]
    (tmp_path / "forces.csv").write_text(csv_of(ANY))
    text = STUDY.replace("{ kappa = 0.3 }", "{ kappa = 0.3, s = 0.1 }\nfreedom = 4.0")
    each = read_study(text.encode(), file="own.toml", folder=tmp_path)
    told = assumptions_table(each, measured(each).dataset).rows
    kind = "half Student-t of 4 degrees of freedom of size"
    assert (f"SD of kappa between samples, relative, {kind}", "0.3", "-") in told
    assert (f"SD of s between samples, {kind}", "0.1", "-") in told
    assert ("zero of a sample's travel about that of all, SD", "0.015", "mm") in told
    assert ("a sample's own forces, SD by the load cell", "0.01", "N") in told
