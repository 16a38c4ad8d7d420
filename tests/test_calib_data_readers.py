"""Readers of DIC results and the door, on small files written as the programs do."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from reader_files import refusal

from benchmarks import reader_samples
from benchmarks.reader_samples import DIC_SAMPLES, MACHINE_SAMPLES
from benchmarks.sample_field import MM_PER_PX, N_COLUMNS, N_ROWS, grid
from calib.data.readers import (
    DIC_FORMATS,
    MACHINE_FORMATS,
    PointFrame,
    read_dic,
    read_machine,
    write_points,
)
from calib.data.readers.natural_order import natural_order
from calib.data.readers.source import Source
from calib.data.readers.units import FORCE, LENGTH, TIME

FORMATS = {form.name: form for form in (*DIC_FORMATS, *MACHINE_FORMATS)}
SAMPLES = [
    (name, *file) for name, files in (DIC_SAMPLES | MACHINE_SAMPLES).items() for file in files
]
STEREO = (
    reader_samples.davis_tecplot,
    reader_samples.davis_csv,
    reader_samples.davis_csv_decimal_comma,
    reader_samples.matchid_2023,
    reader_samples.matchid_2024,
    reader_samples.vic3d,
    reader_samples.points_csv,
)


@pytest.mark.parametrize(("name", "file", "content"), SAMPLES, ids=[s[1] for s in SAMPLES])
def test_a_file_is_recognised_by_its_own_reader_only_and_whatever_its_name(
    name, file, content, put
):
    path = put(content(), "any.thing")
    assert [form.name for form in FORMATS.values() if form.recognises(Source(path))] == [name]
    for other, form in FORMATS.items():
        if other != name:
            assert f"a file of {name}" in str(refusal(form.read_file, path))
    read = read_dic(path, MM_PER_PX) if name in DIC_SAMPLES else read_machine(path)
    assert read.format == name


@pytest.mark.parametrize("content", STEREO, ids=[content.__name__ for content in STEREO])
def test_stereo_files_give_reference_positions_and_displacements_in_mm(content, put):
    position, displacement = grid()
    (frame,) = read_dic(put(content())).frames
    valid = frame.valid
    assert 14 < frame.n_valid <= 20
    np.testing.assert_allclose(frame.position[valid], position[valid], atol=2e-5)
    np.testing.assert_allclose(frame.displacement[valid], displacement[valid], atol=1e-6)
    assert np.isnan(frame.displacement[~valid]).all()
    assert not frame.is_planar


def test_tecplot_gives_grid_and_time_and_masks_what_is_not_valid(put):
    (frame,) = read_dic(put(reader_samples.davis_tecplot())).frames
    assert frame.grid_shape == (N_ROWS, N_COLUMNS)
    assert frame.time == 1.5
    assert frame.valid.tolist() == [True] * 5 + [False] * 5 + [True] * 10


def test_a_point_that_is_not_valid_is_masked_whatever_it_says(put):
    head = "x [mm];y [mm];x-displacement [mm];y-displacement [mm];isValid\n"
    frame = read_dic(put(head + "1;0;0.01;0.02;1\n2;0;0.9;-0.7;0\n3;0;0.02;0.02;1\n")).frames[0]
    assert frame.valid.tolist() == [True, False, True]


def test_false_zeros_are_masked_in_a_frame_that_moved_and_kept_in_one_that_did_not(put):
    text = reader_samples.davis_tecplot().decode().replace(', "isValid"', ', "other"')
    assert read_dic(put(text)).frames[0].n_valid == 15
    head, rows = text.split("SOLUTIONTIME=1.5\r\n")
    still = [" ".join([*row.split()[:3], "0 0 0 1"]) for row in rows.splitlines()]
    static = head + "SOLUTIONTIME=0\r\n" + "\r\n".join(still)
    assert read_dic(put(static)).frames[0].n_valid == 20


def test_a_lone_point_at_the_origin_is_measured_and_several_are_not(put):
    head = "x [mm];y [mm];x-displacement [mm];y-displacement [mm]\n"
    rest = "1;0;0;0\n2;0;0;0\n"
    one = read_dic(put(head + "0;0;0;0\n" + rest)).frames[0]
    assert one.is_planar
    assert one.valid.tolist() == [True, True, True]
    two = read_dic(put(head + "0;0;0;0\n" * 2 + rest)).frames[0]
    assert two.valid.tolist() == [False, False, True, True]


def test_lengths_come_in_mm_whatever_the_header_says(put):
    head = "x [m];y [cm];x-displacement [µm];y-displacement [mm];Uncertainty Vx [µm];"
    frame = read_dic(put(head + "Uncertainty Vy [mm]\n1;2;3;4;5;6\n")).frames[0]
    np.testing.assert_allclose(frame.position, [[1000, 20, 0]])
    np.testing.assert_allclose(frame.displacement, [[0.003, 4, 0]])
    np.testing.assert_allclose(frame.sigma, [[0.005, 6, 0]])


def test_matchid_positions_are_deformed_and_its_force_is_not_believed(put):
    series = read_dic(put(reader_samples.matchid_2024()))
    assert series.frames[0].time == 6.99997
    assert any("voltage" in note for note in series.notes)


def test_dice_pixels_become_mm_and_rows_a_height(put):
    position, displacement = grid()
    path = put(reader_samples.dice())
    assert "mm_per_px" in refusal(read_dic, path).expected
    (frame,) = read_dic(path, MM_PER_PX).frames
    assert frame.is_planar
    assert frame.valid.tolist() == [True] * 19 + [False]
    np.testing.assert_allclose(frame.position[:, :2], position[:, :2], atol=1e-9)
    np.testing.assert_allclose(frame.displacement[:19, :2], displacement[:19, :2], atol=1e-9)
    np.testing.assert_allclose(frame.sigma[:19, :2], 0.02 * MM_PER_PX)
    assert np.isnan(frame.sigma[19]).all()


def test_a_dice_file_of_one_subset_is_a_series(put):
    series = read_dic(put(reader_samples.dice_subset()), MM_PER_PX)
    found = [frame.displacement[0].tolist() for frame in series.frames]
    np.testing.assert_allclose(found, [[0, 0, 0], [4e-3, -2e-3, 0], [8e-3, -4e-3, 0]])


def test_dice_files_of_one_subset_each_are_not_frames_one_after_the_other(tmp_path):
    for number in range(3):
        (tmp_path / f"DICe_solution_{number}.txt").write_bytes(reader_samples.dice_subset())
    found = refusal(read_dic, tmp_path, MM_PER_PX)
    assert "a file for each frame" in found.expected and "one subset each" in found.found


def test_dice_stereo_model_columns_are_read_instead_of_pixels(put):
    names = [f"MODEL_{kind}_{axis}" for kind in ("COORDINATES", "DISPLACEMENT") for axis in "XYZ"]
    head = "COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA,"
    rows = "9,9,9,9,0.1,1,2,3,0.1,0.2,0.3\n9,9,9,9,-1,1,2,3,0.1,0.2,0.3\n"
    (frame,) = read_dic(put(head + ",".join(names) + "\n" + rows)).frames
    assert frame.position[0].tolist() == [1, 2, 3]
    assert frame.displacement[0].tolist() == [0.1, 0.2, 0.3]
    assert frame.valid.tolist() == [True, False]


def test_vic3d_sigma_masks_and_comes_in_mm_where_the_scale_is_known(put):
    path = put(reader_samples.vic3d())
    plain, scaled = read_dic(path), read_dic(path, MM_PER_PX)
    assert plain.frames[0].sigma is None
    assert any("sigma" in note for note in plain.notes)
    assert not plain.frames[0].valid[3]
    np.testing.assert_allclose(scaled.frames[0].sigma[0], 0.01 * MM_PER_PX)


def test_a_vic3d_sigma_without_a_unit_has_that_of_its_place(put):
    head = "X [m],Y [m],Z [m],U [mm],V [mm],W [mm],sigma_X,sigma_Y,sigma_Z [mm]"
    (frame,) = read_dic(put(f"{head}\n1,2,3,.1,.2,.3,1e-5,2e-5,0.03\n")).frames
    np.testing.assert_allclose(frame.sigma, [[0.01, 0.02, 0.03]])


def test_vic3d_displacements_without_a_unit_have_that_of_their_place(put):
    (frame,) = read_dic(put("X [m],Y [m],Z [m],U,V,W [mm]\n1,2,3,1e-4,2e-4,0.3\n")).frames
    np.testing.assert_allclose(frame.position, [[1000, 2000, 3000]])
    np.testing.assert_allclose(frame.displacement, [[0.1, 0.2, 0.3]])


def test_vic3d_in_german_with_a_title_is_read(put):
    text = "Stage 1\nX [mm];Y [mm];Z [mm];U [mm];V [mm];W [mm];sigma [pixel]\n"
    text += "1,5;2;3;0,1;0,2;0,3;0,01\n1;2;3;0;0;0;-1\n"
    (frame,) = read_dic(put(text)).frames
    assert frame.position[0].tolist() == [1.5, 2, 3]
    assert frame.valid.tolist() == [True, False]


lengths = st.floats(-1e6, 1e6)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    arrays(np.float64, (6, 3), elements=lengths),
    arrays(np.float64, (6, 3), elements=lengths),
    arrays(np.bool_, 6),
    st.none() | arrays(np.float64, (6, 3), elements=st.floats(0, 1e6) | st.just(np.nan)),
    st.none() | st.floats(-1e9, 1e9),
    st.sampled_from([None, (2, 3)]),
    st.booleans(),
    st.none() | st.floats(0, 1, exclude_max=True),
    st.none() | st.floats(0, 1e5, exclude_min=True),
)
def test_our_points_csv_gives_back_the_same_bits(
    tmp_path, position, displacement, valid, sigma, time, shape, is_planar, scale_sd, length
):
    displacement[~valid] = np.nan
    frame = PointFrame(
        "B 07: x", position, displacement, valid, sigma, time, shape, is_planar, scale_sd, length
    )
    path = tmp_path / "frame.csv"
    write_points(path, frame)
    (read,) = read_dic(path).frames
    for name in ("position", "displacement", "valid", "sigma"):
        before, after = getattr(frame, name), getattr(read, name)
        assert (before is None) == (after is None)
        assert before is None or before.tobytes() == after.tobytes() or name == "displacement"
        if before is not None:
            np.testing.assert_array_equal(before, after)
    assert (read.name, read.time, read.grid_shape) == (frame.name, frame.time, frame.grid_shape)
    assert (read.is_planar, read.scale_sd) == (is_planar, scale_sd)
    assert read.correlation_length == length


def test_our_files_refuse_a_name_that_would_not_come_back(tmp_path):
    frame = PointFrame("a\nb", np.zeros((1, 3)), np.ones((1, 3)), np.array([True]))
    with pytest.raises(ValueError, match="name"):
        write_points(tmp_path / "x.csv", frame)


def test_our_points_refuse_a_deviation_below_zero(tmp_path):
    one = np.ones((1, 3))
    frame = PointFrame("a", one, one, np.array([True]), np.array([[0.1, 0.1, -0.5]]))
    write_points(tmp_path / "x.csv", frame)
    assert "no sigma below 0" in refusal(read_dic, tmp_path / "x.csv").expected


def test_our_points_are_counted_so_that_a_cut_file_is_refused(put):
    lines = reader_samples.points_csv().splitlines(keepends=True)
    error = refusal(read_dic, put(b"".join(lines[:-3])))
    assert error.expected == "20 points as the head says"
    assert error.found == "17"


DAVIS = "x [mm];y [mm];z [mm];X-displacement [mm];Y-displacement [mm];Z-displacement [mm]\n"
TECPLOT = (
    'TITLE = "B"\nVARIABLES = "x [mm]", "y [mm]", "X-displacement [mm]", "Y-displacement [mm]"\n'
)
OWN = reader_samples.points_csv()
REFUSED_DIC_FILES = {
    "a lost column": (DAVIS.replace("Z-d", "d"), 1, "'z-displacement'", "x [mm]"),
    "a unit of another kind": (DAVIS.replace("x [mm]", "x [V]") + "1;1;1;1;1;1\n", 1, "len", "'V'"),
    "a word": (DAVIS + "1;1;1;1;1;1\n1;1;1;1;1;q\n", 3, "number in column", "'q'"),
    "a lost separator": (DAVIS + "1;1;1;1;1;1\n\n1;1;1;1;1\n", 4, "6 values", "5"),
    "a kilometre": (DAVIS + "1;1;1;1;1;-1e7\n", 2, "at most 1e+06 mm", "-1e+07"),
    "a cut grid": (TECPLOT + "ZONE I=2, J=2, F=POINT\n1 1 1 1\n", 4, "2 x 2 lines", "1"),
    "a grid of billions": (
        TECPLOT + "ZONE I=999999999, J=999999999\n1 1 1 1\n", 4, "999999999 x", "1",
    ),
    "a grid of no number": (TECPLOT + "ZONE I=two\n1 1 1 1\n", 3, "whole number I", "'two'"),
    "layers": (TECPLOT + "ZONE I=1, J=1, K=3\n1 1 1 1\n", 3, "K=1", "K=3"),
    "blocks": (TECPLOT + "ZONE I=1, DATAPACKING=BLOCK\n1 1 1 1\n", 3, "F=POINT", "'BLOCK'"),
    "a machine's file": (reader_samples.bluehill_raw(), 1, "DIC points", "Instron Bluehill csv"),
    "a strange head": (OWN.replace(b"# planar", b"# plane"), 5, "planar", "plane"),
    "a scale of 1": (OWN.replace(b"# points", b"# scale_sd: 1\n# points"), 6, "scale_sd", "1"),
    "no length": (
        OWN.replace(b"# points", b"# correlation_length_mm: 0\n# points"), 6, "above 0", "0",
    ),
    "a flag of 2": (OWN.replace(b",1,", b",2,", 1), 8, "valid 0 or 1", "2"),
    "a NUL byte": (OWN + b"\0", 28, "text", "NUL"),
    "calibration": ("6.389130236e+02 # cx\n", 1, "DIC points", "# cx"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED_DIC_FILES)
def test_a_wrong_dic_file_gives_path_line_expected_and_found(case, put):
    content, line, expected, found = REFUSED_DIC_FILES[case]
    path = put(content)
    error = refusal(read_dic, path)
    assert (error.path, error.line) == (path, line)
    assert expected in error.expected
    assert found in error.found


def test_a_refusal_can_be_sent_between_processes(put):
    error = refusal(read_dic, put("nonsense"))
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error)
    assert again.line == error.line


def test_absent_files_and_impossible_scales_are_refused(tmp_path, put):
    assert "readable" in refusal(read_machine, tmp_path / "none.csv").expected
    assert "readable" in refusal(read_machine, tmp_path).expected
    for scale in (0.0, -1.0, np.nan, np.inf):
        assert "mm_per_px" in refusal(read_dic, put(reader_samples.dice()), scale).expected


def test_a_folder_is_read_in_the_natural_order_of_names(tmp_path):
    for number in (1, 2, 10):
        text = DAVIS + "1;1;1;1;1;1\n" * number
        (tmp_path / f"B{number}.csv").write_text(text)
    (tmp_path / "load.csv").write_bytes(reader_samples.davis_load())
    (tmp_path / "notes.md").write_text("hello")
    series = read_dic(tmp_path)
    assert [frame.name for frame in series.frames] == ["B1", "B2", "B10"]
    assert [frame.valid.size for frame in series.frames] == [1, 2, 10]
    assert "left out: load.csv, notes.md" in series.notes


def test_names_of_one_number_have_an_order_however_they_are_listed():
    names = ["B1", "B01", "B001", "B2"]
    orders = [sorted(listed, key=natural_order) for listed in (names, names[::-1])]
    assert orders[0] == orders[1] and orders[0][-1] == "B2"


def test_a_damaged_frame_in_a_folder_is_not_left_out(tmp_path):
    for number in (1, 2):
        (tmp_path / f"B{number}.csv").write_text(DAVIS + "1;1;1;1;1;1\n")
    (tmp_path / "B3.csv").write_text("garbage\n")
    error = refusal(read_dic, tmp_path)
    assert error.path == tmp_path / "B3.csv"


def test_a_folder_of_two_formats_or_of_none_is_refused(tmp_path):
    assert refusal(read_dic, tmp_path).found == "none"
    (tmp_path / "a.csv").write_bytes(reader_samples.davis_csv())
    (tmp_path / "b.csv").write_bytes(reader_samples.vic3d())
    assert refusal(read_dic, tmp_path).found == "DaVis csv, VIC-3D csv"


def test_utf_16_and_old_line_ends_are_read(put):
    text = DAVIS + "1;1;1;1;1;1\n2;2;2;2;2;2\n"
    for content in (text.encode("utf-16"), text.replace("\n", "\r").encode("utf-8-sig")):
        assert read_dic(put(content)).frames[0].valid.size == 2


def test_text_beyond_the_limits_is_refused(put, monkeypatch):
    path = put(DAVIS + "1;1;1;1;1;1\n" * 100)
    monkeypatch.setattr("calib.data.readers.source.MAX_TEXT_BYTES", 500)
    assert "bytes" in refusal(read_dic, path).expected
    monkeypatch.undo()
    monkeypatch.setattr("calib.data.readers.source.MAX_LINES", 20)
    assert "lines" in refusal(read_dic, path).expected
    monkeypatch.undo()
    error = refusal(read_dic, put(DAVIS + "1" * 200_000))
    assert (error.line, error.found) == (2, "200,000")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position": np.zeros((2, 2))}, "position"),
        ({"displacement": np.full((2, 3), np.nan)}, "displacement"),
        ({"valid": np.array([1, 0])}, "valid"),
        ({"grid_shape": (3, 3)}, "grid_shape"),
        ({"time": np.nan}, "time"),
    ],
)
def test_a_frame_checks_itself(change, message):
    fields = {
        "name": "a",
        "position": np.zeros((2, 3)),
        "displacement": np.zeros((2, 3)),
        "valid": np.array([True, True]),
    }
    PointFrame(**fields)
    with pytest.raises(ValueError, match=message):
        PointFrame(**(fields | change))


def test_units_are_those_of_their_definitions():
    """A pound is 0.45359237 kg, an inch 25.4 mm, standard gravity 9.80665 m/s2."""
    assert pytest.approx(0.45359237 * 9.80665, rel=1e-12) == FORCE["lbf"]
    assert pytest.approx(9.80665, rel=1e-12) == FORCE["kgf"] == 1e3 * FORCE["gf"]
    prefixes = {"k": 1e3, "m": 1e-3, "da": 10.0, "M": 1e6, "c": 1e-2, "u": 1e-6, "n": 1e-9}
    for name, size in prefixes.items():
        for table, unit in ((FORCE, "N"), (LENGTH, "m")):
            if name + unit in table:
                assert pytest.approx(size * table[unit], rel=1e-12) == table[name + unit]
    assert {LENGTH[name] for name in ("in", "inch", "inches")} == {25.4}
    assert (TIME["s"], TIME["ms"], TIME["min"], TIME["h"]) == (1.0, 1e-3, 60.0, 3600.0)
