"""The thesis' tables carry every printed digit; their notes say what is inconsistent in them."""

from __future__ import annotations

import os
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calib.data.thesis import PublishedTable, thesis_labels, thesis_table

LABELS = thesis_labels()
FIELDS = [label for label in LABELS if label.startswith("Appendix") and "," in label]
LENS_SETS_IN_COLUMNS = ("Table 2.3", "Table 3.3")


@cache
def thesis_text() -> str:
    """The thesis; SOFTCAL_THESIS names the folder of its text, else ../shared/reference is read."""
    beside = Path(__file__).parents[2] / "shared" / "reference"
    folder = Path(os.environ.get("SOFTCAL_THESIS", beside))
    files = sorted(folder.glob("*.txt"))
    if not files:
        pytest.skip(f"the text of the thesis is not in {folder}")
    return files[0].read_text(encoding="utf-8")


def printed_rows(start: str) -> list[list[str]]:
    """Cells of the first block of tab-separated lines after the line that begins with `start`."""
    lines = thesis_text().splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith(start))
    while "\t" not in lines[first]:
        first += 1
    rows = []
    while "\t" in lines[first]:
        rows.append(lines[first].split("\t"))
        first += 1
    return rows


def rows_of(table: PublishedTable) -> list[list[str]]:
    return [list(row) for row in zip(*table.columns.values(), strict=True)]


@pytest.mark.parametrize(
    "label", ["Table 3.5", "Table 3.6", "Table 3.7", "Table 5.1", "Table 5.2", "Table 5.3"]
)
def test_tables_in_rows_have_the_printed_cells(label: str) -> None:
    printed = [
        [cell.replace("NA", "NaN") for cell in row] for row in printed_rows(f"{label}: ")[1:]
    ]
    assert rows_of(thesis_table(label)) == printed


def test_tables_3_4_and_5_5_have_the_printed_cells() -> None:
    as_letter = [["phi", *row[1:]] if row[0] == "ϕ" else row for row in printed_rows("Table 3.4: ")]
    assert rows_of(thesis_table("Table 3.4")) == as_letter[1:]
    assert rows_of(thesis_table("Table 5.5")) == printed_rows("Table 5.5: ")[1:]


@pytest.mark.parametrize("label", LENS_SETS_IN_COLUMNS)
def test_tables_with_lens_sets_in_columns_have_the_printed_cells(label: str) -> None:
    printed = {row[0]: tuple(row[1:]) for row in printed_rows(f"{label}: ")}
    columns = dict(thesis_table(label).columns)
    assert columns.pop("lens_set") == printed.pop("Lens Set")
    printed.pop("Special Features", None)
    if label == "Table 2.3":  # one row of ranges there, two rows in Table 3.3
        ranges = [cell.split(" - ") for cell in printed.pop("Focal Length [mm]")]
        assert columns.pop("minimum_focal_length_mm") == tuple(ends[0] for ends in ranges)
        assert columns.pop("maximum_focal_length_mm") == tuple(ends[-1] for ends in ranges)
    assert sorted(columns.values()) == sorted(printed.values())


def test_table_5_4_has_the_printed_constants() -> None:
    names, values = printed_rows("Table 5.4: ")
    assert list(thesis_table("Table 5.4").cells("variable")) == names[1:]
    plain = [re.sub(r"×10\^\{-(\d)\}", r"e-\1", value) for value in values[1:]]
    assert list(thesis_table("Table 5.4").cells("value_MPa")) == plain


IN_A_2 = {
    "HFD": r"= ([\d.]+) \\text\{ m\}",
    "D_near": r"D_\{near\} &=.*?= ([\d.]+) \\text",
    "D_far": r"D_\{far\} &=.*?= ([\d.]+) \\text",
    "DOF": r"DOF &=.*?= ([\d.]+) \\text",
    "FOV": r"\$\$FOV = .*? = ([\d.]+) \\text",
    "CoC": r"\$\$CoC = .*? = ([\d.]+) \\text",
    "d": r"\$\$d = ([\d.]+) \\text",
    "FL": r"\$\$FL = ([\d.]+) \\text",
    "OD": r"\$\$OD = ([\d.]+) \\text",
    "F_stop": r"\$\$F_\{stop\} = (\d+)\$\$",
    "AR": r"AR &= .*?= \\frac\{6\}\{5\}",
    "phi": r"arctan\(AR\) = (\S+)\^",
    "L_x": r"L_x &= .*?= ([\d.]+) \\text",
    "L_y": r"L_y &= .*?= ([\d.]+) \\text",
    "B": r"\$\$B = .*? = ([\d.]+) \\text",
    "A": r"\$\$A = .*? = ([\d.]+) \\text",
    "P_x": r"\$\$P_x = .*? = ([\d.]+) \\text",
    "P_y": r"\$\$P_y = .*? = ([\d.]+) \\text",
    "NP_x": r"\$\$NP_x = .*? = ([\d.]+) \\text",
    "NP_y": r"\$\$NP_y = .*? = ([\d.]+) \\text",
    "Subsets_x": r"\$\$Subsets_x = (\d+)\$\$",
    "Subsets_y": r"\$\$Subsets_y = (\d+)\$\$",
    "Subsets": r"Subsets_x \\times Subsets_y = (\d+)\$\$",
}


def test_appendix_a_2_has_the_printed_values() -> None:
    table = thesis_table("Appendix A.2")
    section = (
        thesis_text().partition("\nA.2 Sample Lens Calculations\n")[2].partition("Appendix B")[0]
    )
    printed = {}
    for symbol, pattern in IN_A_2.items():
        match = re.search(pattern, section)
        assert match, symbol
        printed[symbol] = match[1] if match.groups() else "6/5"
    assert dict(zip(table.cells("symbol"), table.cells("value"), strict=True)) == printed


@pytest.mark.parametrize("label", FIELDS)
def test_fields_of_appendices_d_to_f_have_the_printed_cells(label: str) -> None:
    variable = label.partition(", ")[2]
    rows = printed_rows(f"MATLAB Variable: {variable}")
    assert rows[0] == ["", "1", "2", "3", "4", "5", "6"]
    assert rows_of(thesis_table(label)) == rows[1:]


@pytest.mark.parametrize("label", [label for label in LABELS if label.startswith("Table")])
def test_titles_of_tables_are_those_printed(label: str) -> None:
    assert f"\n{label}: {thesis_table(label).title}\n" in thesis_text()


def test_all_tables_asked_for_are_packaged() -> None:
    numbers = [f"Table 3.{n}" for n in range(3, 8)] + [f"Table 5.{n}" for n in range(1, 6)]
    assert set(numbers) <= set(LABELS)
    assert len(FIELDS) == 8
    for label in FIELDS:
        n_row = 17 if label.startswith("Appendix F") else 24
        assert thesis_table(label).matrix().shape == (n_row, 6)


def test_every_table_names_its_source() -> None:
    for label in LABELS:
        table = thesis_table(label)
        assert table.label == label
        assert table.source.endswith(f"section {table.section}, {label}")
        assert table.title


def test_a_label_or_column_that_is_not_there_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match=r"label: found Table 9\.9, expected one of: .*Table 3\.3"):
        thesis_table("Table 9.9")
    table = thesis_table("Table 5.2")
    with pytest.raises(ValueError, match=r"Table 5\.2: found column samples, expected one of crit"):
        table.cells("samples")
    with pytest.raises(ValueError, match=r"Table 5\.2: criteria: found text"):
        table.numbers("criteria")


def test_errors_of_table_3_5_and_their_mean_follow_from_the_steps() -> None:
    table = thesis_table("Table 3.5")
    error = 100 * np.abs(table.numbers("dic_step_mm") / table.numbers("utm_step_mm") - 1)
    printed = table.numbers("absolute_relative_error_percent")
    assert np.abs(error - printed).max() < 0.005
    assert round(float(printed.mean()), 2) == 3.55


def test_one_convergence_of_table_3_7_has_its_digits_exchanged() -> None:
    table = thesis_table("Table 3.7")
    y = table.numbers("maximum_y_displacement_mm")
    change = 100 * (y[1:] / y[:-1] - 1)
    printed = table.numbers("relative_convergence_percent")[1:]
    off = np.abs(change - printed) > 6e-5
    assert off.tolist() == [False, True, False, False]
    assert round(float(change[1]), 4) == 0.8629
    assert "0.8629" in table.notes[0]


def test_counts_of_table_5_2_leave_no_sample_that_fails_on_x_shift_alone() -> None:
    table = thesis_table("Table 5.2")
    criteria, counts = table.cells("criteria"), table.numbers("number_of_samples")
    count = dict(zip(criteria, counts, strict=True))
    assert count["Total"] - count["Eliminated"] == count["Remaining"]
    assert count["Fails on Deviation"] == count["Eliminated"]


def test_largest_y_displacement_implied_by_section_5_5_4_is_below_its_rmse() -> None:
    rmse = thesis_table("Table 5.5").numbers("rmse_mm")
    largest = rmse / np.array([0.0722, 1.3348, 0.0507])
    assert np.round(largest, 3).tolist() == [0.568, 0.108, 0.789]
    assert "0.568, 0.108 and 0.789" in " ".join(thesis_table("Table 5.5").notes)
    assert largest[1] < rmse[1]


@pytest.mark.parametrize(("variable", "direction"), [("EMX", 0), ("EMY", 1), ("EMZ", 2)])
def test_printed_columns_of_appendix_e_do_not_average_to_table_5_5(
    variable: str, direction: int
) -> None:
    table = thesis_table(f"Appendix E, {variable}")
    mean = float(np.nanmean(table.matrix()))
    printed = float(thesis_table("Table 5.5").numbers("rmse_mm")[direction])
    assert abs(mean / printed - 1) > 0.3
    assert f"{mean:.4f}" in " ".join(table.notes)


@pytest.mark.parametrize("label", ["Appendix D, Mccx3", "Appendix F, rxexp"])
def test_values_called_r_squared_are_negative_at_points(label: str) -> None:
    assert np.nanmin(thesis_table(label).matrix()) < 0


def test_table_6_1_and_the_requirements_have_the_printed_text() -> None:
    assert rows_of(thesis_table("Table 6.1")) == printed_rows("Table 6.1: ")[1:]
    section = thesis_text().partition("\nDesign Requirements:\n")[2].partition("\n3.2.2 ")[0]
    table = thesis_table("Requirements 3.2.1")
    starts = [int(match) for match in re.findall(r"^(\d)\. ", section, flags=re.MULTILINE)]
    assert starts == list(range(1, 9))
    paragraphs = re.split(r"^\d\. ", section, flags=re.MULTILINE)
    for number, words in zip(table.cells("number"), table.cells("printed"), strict=True):
        assert words in paragraphs[int(number)]


def test_section_5_6_has_the_printed_averages() -> None:
    section = thesis_text().partition("\n5.6 Validation of Material Model\n")[2]
    section = section.partition("Chapter 6")[0]
    table = thesis_table("Section 5.6")
    r, signed, absolute = (table.cells(name) for name in list(table.columns)[1:])
    assert re.findall(r"R\^2 = (\S+)\$", section) == list(r)
    assert re.findall(r"varepsilon_[xy] = (\S+)\$", section) == list(signed)
    assert re.findall(r"varepsilon_\{[xy]abs\} = (\S+)\$", section) == list(absolute)
