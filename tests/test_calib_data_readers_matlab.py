"""MATLAB files of Ncorr and DuoDIC, and files that claim more than they hold."""

from __future__ import annotations

import io
import zlib

import h5py
import numpy as np
import pytest
import scipy.io
from reader_files import refusal

from benchmarks import matlab_samples
from benchmarks.sample_field import MM_PER_PX, N_COLUMNS, N_ROWS, grid
from calib.data.readers import (
    read_dic,
)
from calib.data.readers.matlab_file import read_variable, variable_names
from calib.data.readers.source import Source


@pytest.mark.parametrize("content", [matlab_samples.ncorr, matlab_samples.ncorr_hdf5])
def test_ncorr_fields_lie_on_a_grid_of_pixels_with_zeros_outside(content, put):
    _, displacement = grid()
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
    path = put(matlab_samples.ncorr())
    assert read_dic(path, MM_PER_PX).frames
    assert refusal(read_dic, path, 0.02).found == "0.01"


def test_duodic_pairs_are_planar_and_reconstructed_points_are_not(put):
    position, displacement = grid()
    pair = read_dic(put(matlab_samples.duodic_pair()), MM_PER_PX)
    assert len(pair.frames) == 3
    assert pair.frames[2].valid.tolist() == [True] * 5 + [False]
    np.testing.assert_allclose(pair.frames[2].position[:, :2], position[:6, :2])
    np.testing.assert_allclose(
        pair.frames[2].displacement[:5, :2], 2 * displacement[:5, :2], atol=1e-12
    )
    stereo = read_dic(put(matlab_samples.duodic_stereo()))
    np.testing.assert_allclose(stereo.frames[2].displacement, 2 * displacement, atol=1e-12)
    assert not stereo.frames[2].is_planar


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
    fields = matlab_samples.ncorr_fields() | {"padding": np.zeros(1_000_000)}
    data = matlab5({"data_dic_save": fields}, do_compression=True)
    assert len(data) < 100_000
    assert "at most 100,000 bytes" in refusal(read_dic, put(data)).expected


def test_a_small_matlab_file_that_claims_a_large_array_is_refused(put):
    data = bytearray(matlab5({"data_dic_save": matlab_samples.ncorr_fields()}))
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


def test_zlib_of_garbage_is_a_wrong_file(put):
    head = matlab5({})[:128]
    body = zlib.compress(b"garbage" * 100)
    element = np.array([15, len(body)], dtype="<u4").tobytes() + body
    assert "MATLAB" in refusal(read_dic, put(head + element)).found
