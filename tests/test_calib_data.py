"""The thesis' tables are transcribed exactly, and csv files are read or refused by line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.data import PUBLISHED_CONSTANTS, Dataset, read_force_csv, thesis_forces, thesis_table
from calib.data.thesis import optimization_runs, stated_average

GOOD = "travel_mm,force_mean_N,force_sd_N,n_samples\n0.6,0.9,0.1,23\n0.8,1.3,0.09,23\n"


def test_relative_sd_printed_in_table_5_1_follows_from_its_other_columns() -> None:
    table = thesis_table("Table 5.1")
    share = 100 * table.numbers("standard_deviation_N") / table.numbers("average_N")
    assert np.abs(share - table.numbers("relative_size_percent")).max() < 0.006  # printed to 0.01


def test_thesis_forces_are_23_samples_at_increments_3_to_7_of_0_2_mm() -> None:
    data = thesis_forces()
    assert data.travel.tolist() == [0.6, 0.8, 1.0, 1.2, 1.4]
    assert data.n_samples == 23
    assert not data.synthetic


def test_growth_of_thesis_forces_is_that_of_the_printed_means() -> None:
    mean = thesis_forces().force_mean
    growth = np.round(mean / mean[0], 3)
    assert growth.tolist() == [1.0, 1.497, 2.175, 3.058, 4.244]


def test_table_5_4_repeats_starts_2_and_3_to_its_printed_digits() -> None:
    runs = optimization_runs()
    published = np.array([PUBLISHED_CONSTANTS[name] for name in ("C10", "C01", "C11")])
    for start in (1, 2):
        assert np.abs(runs.result[start] - published) == pytest.approx(
            0, abs=5e-6
        )  # half of the last digit printed
    assert np.array_equal(runs.result[1], runs.result[2])


def test_table_5_4_is_not_the_average_the_text_states() -> None:
    average = stated_average()
    assert average["C10"] == pytest.approx(0.03029875, rel=1e-12)
    assert average["C01"] == pytest.approx(0.0222755, rel=1e-12)
    assert average["C11"] == pytest.approx(3.45795e-4, rel=1e-12)
    assert abs(average["C11"] / PUBLISHED_CONSTANTS["C11"] - 1) > 0.09


def test_nine_starts_reach_constants_that_differ_by_half_at_the_same_rmse() -> None:
    runs = optimization_runs()
    assert runs.start.shape == runs.result.shape == (9, 3)
    assert runs.rmse.max() - runs.rmse.min() == pytest.approx(0.0003)
    assert runs.result[:, 0].max() / runs.result[:, 0].min() > 1.5


def test_csv_is_read_with_comments_and_columns_in_any_order(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("# note\nn_samples,travel_mm,force_sd_N,force_mean_N\n\n5,0.5,0.1,1.5\n")
    data = read_force_csv(path)
    assert (data.name, data.n_samples, data.synthetic) == ("mine", 5, False)
    assert (data.travel[0], data.force_mean[0], data.force_sd[0]) == (0.5, 1.5, 0.1)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ["found no data", "travel_mm"]),
        (GOOD.splitlines()[0], ["found a header alone", "expected a line for each travel"]),
        (GOOD.replace(",", ";"), [":1:", "expected commas between the columns"]),
        (GOOD.replace("1.3", '"1,3"'), [":3:", "'1,3'", "positive number with a decimal point"]),
        (GOOD.replace("force_sd_N", "sd"), [":1:", "sd", "force_sd_N"]),
        (GOOD.replace("1.3", "abc"), [":3:", "force_mean_N", "'abc'", "positive number"]),
        (GOOD.replace("1.3", "-1.3"), [":3:", "force_mean_N", "'-1.3'"]),
        (GOOD.replace("1.3", "nan"), [":3:", "force_mean_N", "'nan'"]),
        (GOOD.replace("0.1,23", "0.1,2.5"), [":2:", "n_samples", "whole number"]),
        (GOOD.replace(",23", ",1"), [":2:", "n_samples", "found '1'", "2 or more"]),
        (GOOD.replace("0.09,23", "0.09,22"), [":3:", "n_samples", "found 22", "expected 23"]),
        (GOOD.replace("0.8,", "0.5,"), [":3:", "travel_mm", "found 0.5", "more than 0.6"]),
        (GOOD + "1.0,2.0\n", [":4:", "found 2 values", "expected 4"]),
    ],
)
def test_bad_csv_is_refused_by_line_and_column(tmp_path: Path, text: str, parts: list[str]) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(ValueError) as error:
        read_force_csv(path)
    assert "bad.csv" in str(error.value)
    for part in parts:
        assert part in str(error.value)


def test_missing_and_binary_csv_are_refused_by_name(tmp_path: Path) -> None:
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"\xff\xfe\x00\x80")
    for path in (binary, tmp_path / "absent.csv"):
        with pytest.raises(ValueError, match=path.name):
            read_force_csv(path)


@pytest.mark.parametrize("n", [0, 1.5, np.nan])
def test_dataset_refuses_numbers_of_samples_that_are_none(n: float) -> None:
    with pytest.raises(ValueError, match="n_samples: expected a whole number from 1"):
        replace(thesis_forces(), n_samples=n)  # type: ignore[arg-type]


def test_dataset_refuses_a_covariance_that_is_not_symmetric() -> None:
    data = thesis_forces()
    covariance = np.diag(data.force_sd**2)
    covariance[0, 1] = 0.5 * data.force_sd[0] * data.force_sd[1]
    with pytest.raises(ValueError, match="force_covariance: expected a symmetric matrix"):
        replace(data, force_covariance=covariance)
    covariance[0, 1] = 1e-12 * data.force_sd[0] ** 2  # what rounding leaves of nothing
    assert replace(data, force_covariance=covariance).force_covariance is covariance


@pytest.mark.parametrize("name", ["travel", "force_mean", "force_sd"])
def test_dataset_refuses_values_that_are_not_positive(name: str) -> None:
    values = {n: np.array([1.0, 2.0]) for n in ("travel", "force_mean", "force_sd")}
    values[name] = np.array([1.0, np.nan])
    with pytest.raises(ValueError, match=name):
        Dataset("d", False, **values, n_samples=3)
