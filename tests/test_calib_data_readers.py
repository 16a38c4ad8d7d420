"""Readers of DIC results and test-machine files, on small files written as the programs do."""

from __future__ import annotations

import io
import pickle
import zlib

import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from benchmarks import reader_samples
from benchmarks.reader_samples import DIC_SAMPLES, MACHINE_SAMPLES, MM_PER_PX, N_COLUMNS, N_ROWS
from calib.data.readers import (
    DIC_FORMATS,
    MACHINE_FORMATS,
    MachineRecord,
    PointFrame,
    WrongFile,
    read_dic,
    read_machine,
    write_machine,
    write_points,
)
from calib.data.readers.matlab_file import read_variable, variable_names
from calib.data.readers.source import Source

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


@pytest.fixture
def put(tmp_path):
    """Writes content to a file and gives its path."""

    def write(content, name="file.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def refusal(read, *arguments):
    with pytest.raises(WrongFile) as caught:
        read(*arguments)
    assert "\n" not in str(caught.value)
    return caught.value


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
    position, displacement = reader_samples.grid()
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
    position, displacement = reader_samples.grid()
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


def test_vic3d_in_german_with_a_title_is_read(put):
    text = "Stage 1\nX [mm];Y [mm];Z [mm];U [mm];V [mm];W [mm];sigma [pixel]\n"
    text += "1,5;2;3;0,1;0,2;0,3;0,01\n1;2;3;0;0;0;-1\n"
    (frame,) = read_dic(put(text)).frames
    assert frame.position[0].tolist() == [1.5, 2, 3]
    assert frame.valid.tolist() == [True, False]


@pytest.mark.parametrize("content", [reader_samples.ncorr, reader_samples.ncorr_hdf5])
def test_ncorr_fields_lie_on_a_grid_of_pixels_with_zeros_outside(content, put):
    _, displacement = reader_samples.grid()
    series = read_dic(put(content()))
    assert len(series.frames) == 2
    frame = series.frames[1]
    assert frame.grid_shape == (N_ROWS, N_COLUMNS)
    assert frame.valid.tolist() == [False] * 5 + [True] * 15
    # spacing 2 is every third pixel of 0.01 mm; rows of the image go down
    np.testing.assert_allclose(frame.position[7], [0.06, -0.03, 0], atol=1e-12)
    np.testing.assert_allclose(frame.displacement[5:, :2], displacement[5:, :2])
    half = series.frames[0].displacement[5:]
    np.testing.assert_allclose(half, 0.5 * frame.displacement[5:])


def test_a_scale_that_contradicts_ncorr_is_refused(put):
    path = put(reader_samples.ncorr())
    assert read_dic(path, MM_PER_PX).frames
    assert refusal(read_dic, path, 0.02).found == "0.01"


def test_duodic_pairs_are_planar_and_reconstructed_points_are_not(put):
    position, displacement = reader_samples.grid()
    pair = read_dic(put(reader_samples.duodic_pair()), MM_PER_PX)
    assert len(pair.frames) == 3
    assert pair.frames[2].valid.tolist() == [True] * 5 + [False]
    np.testing.assert_allclose(pair.frames[2].position[:, :2], position[:6, :2])
    np.testing.assert_allclose(
        pair.frames[2].displacement[:5, :2], 2 * displacement[:5, :2], atol=1e-12
    )
    stereo = read_dic(put(reader_samples.duodic_stereo()))
    np.testing.assert_allclose(stereo.frames[2].displacement, 2 * displacement, atol=1e-12)
    assert not stereo.frames[2].is_planar


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
)
def test_our_points_csv_gives_back_the_same_bits(
    tmp_path, position, displacement, valid, sigma, time, shape, is_planar
):
    displacement[~valid] = np.nan
    frame = PointFrame("B 07: x", position, displacement, valid, sigma, time, shape, is_planar)
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
    assert read.is_planar == is_planar


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


def test_our_files_refuse_a_name_that_would_not_come_back(tmp_path):
    frame = PointFrame("a\nb", np.zeros((1, 3)), np.ones((1, 3)), np.array([True]))
    with pytest.raises(ValueError, match="name"):
        write_points(tmp_path / "x.csv", frame)


def test_our_points_are_counted_so_that_a_cut_file_is_refused(put):
    lines = reader_samples.points_csv().splitlines(keepends=True)
    error = refusal(read_dic, put(b"".join(lines[:-3])))
    assert error.expected == "20 points as the head says"
    assert error.found == "17"


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


REFUSED_MACHINE_FILES = {
    "a force in volts": ("Time (s),Extension (mm),Load (V)\n0,0,0\n", 1, "unit of force", "'V'"),
    "no unit": ("Time,Extension,Load\n0,0,0\n", 2, "line of units", "'0,0,0'"),
    "torsion": ("Time (s),Rotation (deg),Torque (Nm)\n0,0,0\n", 1, "column 'Load'", "Torque"),
    "two loads": ("Time (s),Extension (mm),Load (N),Load (kN)\n0,0,0,0\n", 1, "one column", "2"),
    "a word": ("Time (s),Extension (mm),Load (N)\n0,0,0\n1,x,0\n", 3, "number in column", "'x'"),
    "a lost value": ("Time (s),Extension (mm),Load (N)\n0,0\n", 2, "3 values", "2"),
    "no force": ("Time (s),Extension (mm),Load (N)\n0,0,0\n1,1,\n", 3, "a force of", "nan"),
    "no rows": ("Time (s),Extension (mm),Load (N)\n", 1, "lines of numbers", "end of the file"),
    "time back": ("Time (s),Extension (mm),Load (N)\n5,0,0\n4,0,0\n", 3, "time of 5 s", "4 s"),
    "a huge force": ("Time (s),Extension (mm),Load (N)\n5,0,1e300\n", 2, "a force of", "1e+300"),
    "thousands or decimals": (
        'Time (s),Extension (mm),Load (N)\n"0","0","1,234"\n', 2, "thousands", "'1,234'",
    ),
    "volts named N": (
        "File;TimeStamp;Force [V];Force [N]\na_1_0.tif;1;0.2818;0.2818\n", 1, "a force", "volts",
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


def matlab5(variables, **options):
    file = io.BytesIO()
    scipy.io.savemat(file, variables, **options)
    return file.getvalue()


@pytest.mark.parametrize("do_compression", [True, False])
def test_the_decoder_of_matlab_5_reads_what_scipy_writes(do_compression, tmp_path):
    """An independent writer: all number types, shapes, texts, nested cells and structs."""
    rng = np.random.default_rng(3)
    cell = np.empty((1, 3), dtype=object)
    cell[0, :] = [np.arange(6.0).reshape(2, 3), "text", np.zeros((0, 0))]
    values = {
        kind: rng.integers(0, 100, (3, 4)).astype(kind)
        for kind in ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8")
    }
    one = {
        "a_field": np.float64(2.5),
        "text": "mm",
        "cell": cell,
        "cube": rng.normal(size=(2, 3, 4)),
        "left_out": 1.0,
        "deep": {"a_field": np.array([[1.0, np.nan, np.inf]])},
        **values,
    }
    data = matlab5({"before": np.arange(5), "wanted": one}, do_compression=do_compression)
    path = tmp_path / "x.mat"
    path.write_bytes(data)
    source = Source(path)
    assert variable_names(source) == {"before", "wanted"}
    read = read_variable(source, "wanted", set(one) - {"left_out"})
    assert set(read) == set(one) - {"left_out"}
    for kind, array in values.items():
        np.testing.assert_array_equal(read[kind], array)
    np.testing.assert_array_equal(read["cube"], one["cube"])
    np.testing.assert_array_equal(read["deep"]["a_field"], one["deep"]["a_field"])
    assert (read["a_field"].tolist(), read["text"]) == ([[2.5]], "mm")
    np.testing.assert_array_equal(read["cell"][0], cell[0, 0])
    assert (read["cell"][1], read["cell"][2].size) == ("text", 0)


def test_a_compressed_variable_that_swells_is_refused_before_it_does(put, monkeypatch):
    monkeypatch.setattr("calib.data.readers.matlab_file.MAX_VARIABLE_BYTES", 100_000)
    fields = reader_samples.ncorr_fields() | {"padding": np.zeros(1_000_000)}
    data = matlab5({"data_dic_save": fields}, do_compression=True)
    assert len(data) < 100_000
    assert "at most 100,000 bytes" in refusal(read_dic, put(data)).expected


def test_a_small_matlab_file_that_claims_a_large_array_is_refused(put):
    data = bytearray(matlab5({"data_dic_save": reader_samples.ncorr_fields()}))
    shape = np.array([N_ROWS, N_COLUMNS], dtype="<i4").tobytes()
    start = data.index(shape)
    data[start : start + 8] = np.array([2**30, 2**30], dtype="<i4").tobytes()
    assert "an array of (1073741824, 1073741824)" in refusal(read_dic, put(bytes(data))).found


def test_a_small_hdf5_file_that_claims_a_large_array_is_refused(tmp_path):
    path = tmp_path / "big.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("DIC2DpairResults")
        group.create_dataset("Points", shape=(10**6, 10**6), chunks=(1000, 1000), dtype="f8")
        group["nImages"] = np.array([[1.0]])
    assert "values" in refusal(read_dic, path, MM_PER_PX).expected


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


def test_zlib_of_garbage_is_a_wrong_file(put):
    head = matlab5({})[:128]
    body = zlib.compress(b"garbage" * 100)
    element = np.array([15, len(body)], dtype="<u4").tobytes() + body
    assert "MATLAB" in refusal(read_dic, put(head + element)).found


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
