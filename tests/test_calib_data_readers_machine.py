"""Readers of test-machine files, on small files written as the programs do."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from reader_files import refusal

from benchmarks import reader_samples
from calib.data.readers import (
    MachineRecord,
    read_machine,
    write_machine,
)

lengths = st.floats(-1e6, 1e6)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    arrays(np.float64, 5, elements=st.floats(0, 1e6)),
    arrays(np.float64, 5, elements=lengths),
    st.none() | arrays(np.float64, 5, elements=lengths),
    st.none() | arrays(np.float64, 5, elements=st.floats(0, 1e6) | st.just(np.nan)),
    st.sampled_from(["compression", "tension", "unknown"]),
)
def test_our_machine_csv_gives_back_the_same_bits(tmp_path, time, force, travel, frame, positive):
    record = MachineRecord(
        "x", np.sort(time), force, travel, positive, {"force": "Load [N]"}, {"D": "5 mm"}, frame
    )
    path = tmp_path / "machine.csv"
    write_machine(path, record)
    read = read_machine(path)
    for name in ("time", "force", "travel", "frame"):
        np.testing.assert_array_equal(getattr(record, name), getattr(read, name))
    assert (read.positive, read.channels, read.metadata) == (
        positive,
        record.channels,
        record.metadata,
    )


def test_bluehill_raw_reads_thousands_and_head(put):
    record = read_machine(put(reader_samples.bluehill_raw()))
    assert record.force[-1] == 1450.0
    assert record.metadata["Length"] == "26.00000 mm"
    assert record.positive == "tension"
    assert record.channels["travel"] == "Extension [mm]"


def test_the_sign_of_the_file_is_kept_and_compression_made_positive_on_demand(put):
    record = read_machine(put(reader_samples.bluehill_compression()))
    assert record.force[-1] == pytest.approx(-6.05)
    turned = record.in_compression()
    assert turned.force[-1] == pytest.approx(6.05)
    assert turned.travel[-1] == pytest.approx(0.22)
    assert turned.in_compression() is turned
    unknown = read_machine(put(reader_samples.wavematrix()))
    assert unknown.positive == "unknown"
    with pytest.raises(ValueError, match="positive"):
        unknown.in_compression()


@pytest.mark.parametrize(
    ("names", "positive"),
    [
        ("Extension (mm),Load (N)", "tension"),
        ("Compressive extension (mm),Compressive load (N)", "compression"),
        ("Compressive extension (mm),Load (N)", "unknown"),
        ("Displacement (mm),Force (N)", "unknown"),
    ],
)
def test_what_positive_means_is_taken_from_the_names_and_never_from_the_numbers(
    names, positive, put
):
    assert read_machine(put(f"Time (s),{names}\n0,0,0\n1,-1,-2\n")).positive == positive


def test_load_files_give_the_number_of_the_image(put):
    davis = read_machine(put(reader_samples.davis_load()))
    assert davis.time[1] == pytest.approx(0.5005)
    assert davis.force[-1] == pytest.approx(110)
    assert davis.frame[3] == 1 and np.isnan(davis.frame[4])
    matchid = read_machine(put(reader_samples.matchid_load()))
    assert matchid.frame.tolist() == list(range(12))
    assert matchid.force[1] == 72.5
    assert davis.travel is None and matchid.travel is None


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        (["a_0012_0.tif", "a_0013_0.tif"], [12, 13]),
        (["sample12_0003.tif", "sample12_0004.tif"], [3, 4]),
        (["S1_1.tif", "S1_2.tif", "S1_10.tif"], [1, 2, 10]),
        (["S1_8.tif", "S1_9.tif"], [8, 9]),
        (["a_3.tif"], [3]),
        (["B7.tif"], [7]),
        (["a_1_0.tif", "a_9_0.tif", "dark.tif"], [1, 9, np.nan]),
    ],
)
def test_the_number_of_an_image_is_its_last_but_for_that_of_a_camera(names, numbers, put):
    lines = [f"{name};{time};72,5" for time, name in enumerate(names)]
    record = read_machine(put("\n".join(["File;TimeStamp;Force [N]", *lines, ""])))
    np.testing.assert_array_equal(record.frame, numbers)
    assert record.force.tolist() == [72.5] * len(names)


def test_commas_in_remarks_and_in_other_columns_say_nothing_of_points(put):
    text = "Time (s);Extension (mm);Load (N);Note\n0.5;0.1;1.5;\n1.5;0.2;2.5;a, b, slowly\n"
    assert read_machine(put(text)).force.tolist() == [1.5, 2.5]
    mixed = read_machine(put("File;TimeStamp;Force [N]\na_0001.tif;0.5;72,5\n"))
    assert (mixed.time[0], mixed.force[0]) == (0.5, 72.5)


def test_kilonewtons_may_be_as_many_as_volts(put):
    text = "File;TimeStamp;Force [V];Force [kN]\na_1_0.tif;1;0.2818;0.2818\n"
    assert read_machine(put(text)).force.tolist() == [281.8]


def test_decimal_commas_in_quotes_are_read_where_no_number_has_a_point(put):
    text = 'Time (s);Extension (mm);Load (N)\n"0,5";"1,25";"1,234"\n"1,5";"2";"-3,5"\n'
    record = read_machine(put(text))
    assert record.time.tolist() == [0.5, 1.5]
    assert record.travel.tolist() == [1.25, 2.0]
    assert record.force.tolist() == [1.234, -3.5]


REFUSED_MACHINE_FILES = {
    "a force in volts": ("Time (s),Extension (mm),Load (V)\n0,0,0\n", 1, "unit of force", "'V'"),
    "no unit": ("Time,Extension,Load\n0,0,0\n", 2, "line of units", "'0,0,0'"),
    "torsion": ("Time (s),Rotation (deg),Torque (Nm)\n0,0,0\n", 1, "column 'Load'", "Torque"),
    "two loads": ("Time (s),Extension (mm),Load (N),Load (kN)\n0,0,0,0\n", 1, "one column", "2"),
    "a word": ("Time (s),Extension (mm),Load (N)\n0,0,0\n1,x,0\n", 3, "number in column", "'x'"),
    "a lost value": ("Time (s),Extension (mm),Load (N)\n0,0\n", 2, "3 values", "2"),
    "no force": ("Time (s),Extension (mm),Load (N)\n0,0,0\n1,1,\n", 3, "a number for the", "none"),
    "no rows": ("Time (s),Extension (mm),Load (N)\n", 1, "lines of numbers", "end of the file"),
    "time back": ("Time (s),Extension (mm),Load (N)\n5,0,0\n4,0,0\n", 3, "time of 5 s", "4 s"),
    "a huge force": ("Time (s),Extension (mm),Load (N)\n5,0,1e300\n", 2, "a force of", "1e+300"),
    "thousands or decimals": (
        'Time (s),Extension (mm),Load (N)\n"0","0","1,234"\n', 2, "thousands", "'1,234'",
    ),
    "volts named N": (
        "File;TimeStamp;Force [V];Force [N]\na_1_0.tif;1;0.2818;0.2818\n", 1, "a force", "volts",
    ),
    "points in some cells": (
        "File;TimeStamp;Force [N]\na;1;0.9\na;2;1,234\n", 2, "decimal comma", "'0.9'",
    ),
    "points in some quotes": (
        'Time (s);Extension (mm);Load (N)\n"0";"0";"1,234"\n"1";"0";"0.5"\n', 2, "thousands",
        "'1,234'",
    ),
    "volts only": ("Index;ADC 1 channel 1 [V]\n1;0.1\n", 1, "unit of force", "ADC 1"),
    "two decimal marks": ("File;TimeStamp;Force [N]\na;1;1.234,5\n", 2, "decimal", "'1.234,5'"),
    "points of DIC": (reader_samples.davis_csv(), 1, "test-machine file", "DaVis csv"),
    "nothing": (b"", 1, "test-machine file", "empty"),
    "bytes": (b"\0\1\2", 1, "test-machine file", "binary"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED_MACHINE_FILES)
def test_a_wrong_machine_file_gives_path_line_expected_and_found(case, put):
    content, line, expected, found = REFUSED_MACHINE_FILES[case]
    path = put(content)
    error = refusal(read_machine, path)
    assert (error.path, error.line) == (path, line)
    assert expected in error.expected
    assert found in error.found
    assert str(error) == f"{path}:{line}: expected {error.expected}, found {error.found}"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time": np.array([1.0, 0.0])}, "time"),
        ({"force": np.array([1.0])}, "force"),
        ({"travel": np.array([1.0, np.nan])}, "travel"),
        ({"positive": "up"}, "positive"),
    ],
)
def test_a_record_checks_itself(change, message):
    fields = {
        "format": "x",
        "time": np.array([0.0, 1.0]),
        "force": np.zeros(2),
        "travel": None,
        "positive": "tension",
    }
    MachineRecord(**fields)
    with pytest.raises(ValueError, match=message):
        MachineRecord(**(fields | change))
