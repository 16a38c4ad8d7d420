"""A data set on disk: the same bits back, and one sentence for anything else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import f, kstest

from calib.data import Dataset, FieldData, read_force_csv
from calib.data.dataset import SampleData
from calib.data.dataset_file import load_dataset, save_dataset
from calib.inference.field_noise import field_covariance
from calib.inference.noise import NoiseSettings, force_errors, mean_covariance, slope_matrix

RNG = np.random.default_rng(0)
FIELD = FieldData(
    RNG.random((6, 2)),
    RNG.random((3, 6, 3)),
    np.array([0.01, 0.02, 0.03]),
    0.4,
    0.5,
    0.01 * RNG.standard_normal((2, 3, 6, 3)),
    nugget=0.1,
    smoothing=0.05,
)
FORCES = np.random.default_rng(1).normal([1.0, 2.0, 3.0], 0.1, (8, 3))
COVARIANCE = np.cov(FORCES, rowvar=False)
DATA = Dataset(
    "laboratory",
    True,
    np.array([0.6, 0.8, 1.0]),
    FORCES.mean(axis=0),
    np.sqrt(np.diag(COVARIANCE)),
    8,
    FIELD,
    COVARIANCE,
    SampleData(tuple("abcdefgh"), FORCES, RNG.random((8, 3, 6, 3)), np.array([1e-3, 2e-3, 3e-3])),
)


def assert_same(a: Dataset, b: Dataset) -> None:
    for name in ("name", "synthetic", "n_samples"):
        assert getattr(a, name) == getattr(b, name)
    for name in ("travel", "force_mean", "force_sd", "force_covariance"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert a.field is not None and b.field is not None
    for name in FieldData.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(a.field, name), getattr(b.field, name))
    assert a.samples is not None and b.samples is not None
    assert a.samples.names == b.samples.names
    np.testing.assert_array_equal(a.samples.force, b.samples.force)
    np.testing.assert_array_equal(a.samples.displacement, b.samples.displacement)
    np.testing.assert_array_equal(a.samples.noise_std, b.samples.noise_std)


def test_a_data_set_comes_back_bit_by_bit_with_the_hash_of_its_inputs(tmp_path):
    save_dataset(tmp_path / "d.npz", DATA, "1234abcd")
    found, inputs = load_dataset(tmp_path / "d.npz")
    assert_same(found, DATA)
    assert inputs == "1234abcd"


def test_a_file_that_knows_of_no_smoothing_has_exponential_noise(tmp_path):
    path = tmp_path / "dataset.npz"
    save_dataset(path, replace(DATA, field=replace(FIELD, smoothing=0.0)))
    with np.load(path) as stored:
        assert "smoothing" not in stored.files
    field = load_dataset(path)[0].field
    apart = np.linalg.norm(FIELD.points[:, None] - FIELD.points, axis=-1)
    expected = 0.9 * np.exp(-apart / 0.4) + 0.1 * np.eye(6)
    np.testing.assert_allclose(field_covariance(field).correlation, expected, atol=1e-12)


def test_the_smoothing_of_the_noise_is_part_of_the_fields_covariance():
    apart = np.linalg.norm(FIELD.points[:, None] - FIELD.points, axis=-1)
    rounded = np.hypot(apart, 0.05) - 0.05
    expected = 0.9 * np.exp(-rounded / 0.4) + 0.1 * np.eye(6)
    np.testing.assert_allclose(field_covariance(FIELD).correlation, expected, atol=1e-12)
    with pytest.raises(ValueError, match=r"smoothing: expected 0 mm or more, got -0\.1"):
        replace(FIELD, smoothing=-0.1)


def test_the_same_data_set_gives_the_same_bytes(tmp_path):
    for name in "ab":
        save_dataset(tmp_path / f"{name}.npz", DATA, "x")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_forces_alone_need_neither_field_nor_samples(tmp_path):
    plain = replace(DATA, field=None, samples=None, force_covariance=None)
    save_dataset(tmp_path / "d.npz", plain)
    found, _ = load_dataset(tmp_path / "d.npz")
    assert found.field is None and found.samples is None and found.force_covariance is None


@pytest.mark.parametrize("keep", [0, 10, 400, 2000])
def test_a_damaged_file_is_refused_in_one_sentence(tmp_path, keep):
    path = tmp_path / "d.npz"
    save_dataset(path, DATA)
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(ValueError, match=r"d\.npz: found no npz file or a damaged") as e:
        load_dataset(path)
    assert "\n" not in str(e.value)


def test_another_version_and_another_npz_are_refused(tmp_path):
    path = tmp_path / "d.npz"
    np.savez(path, version=np.array(99))
    with pytest.raises(ValueError, match="found version 99, expected 1"):
        load_dataset(path)
    np.savez(path, version=np.array(1), inputs=np.array(""))
    with pytest.raises(ValueError, match="found no name in it, expected a data set of `calib qc`"):
        load_dataset(path)
    np.savez(path, other=np.array(1))
    with pytest.raises(ValueError, match="found an npz file of another kind, expected a data set"):
        load_dataset(path)
    np.savez(path, version=np.array("new"))
    with pytest.raises(ValueError, match="found a version that is no number"):
        load_dataset(path)
    np.savez(path, version=np.array([{}], dtype=object))
    with pytest.raises(ValueError, match="found no npz file or a damaged one"):
        load_dataset(path)


def test_what_is_no_data_set_is_told_without_words_of_numpy(tmp_path):
    path = tmp_path / "plate.npz"
    path.write_bytes(b"travel,force\n0.2,0.1\n")
    with pytest.raises(ValueError) as junk:
        load_dataset(path)
    expected = "expected a data set of `calib qc`"
    assert str(junk.value) == f"{path}: found no npz file or a damaged one, {expected}"
    path.unlink()
    with pytest.raises(ValueError) as absent:
        load_dataset(path)
    assert str(absent.value) == f"{path}: found no such file, {expected}"


def test_some_of_the_steps_are_the_same_data():
    some = DATA.at_steps([0, 2])
    np.testing.assert_array_equal(some.travel, [0.6, 1.0])
    np.testing.assert_array_equal(some.force_covariance, COVARIANCE[np.ix_([0, 2], [0, 2])])
    assert some.field is not None and some.samples is not None
    np.testing.assert_array_equal(some.field.displacement, FIELD.displacement[[0, 2]])
    np.testing.assert_array_equal(some.field.patterns, FIELD.patterns[:, [0, 2]])
    np.testing.assert_array_equal(some.samples.force, FORCES[:, [0, 2]])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"force_covariance": np.eye(2)}, r"force_covariance: expected \(3, 3\)"),
        ({"force_covariance": 2 * COVARIANCE}, "squares of force_sd"),
        (
            {"force_covariance": np.outer(DATA.force_sd, DATA.force_sd)},
            "positive definite matrix, which takes more samples",
        ),
        ({"samples": SampleData(("a",), FORCES[:1], np.zeros((1, 3, 6, 3)))}, "samples: expected"),
    ],
)
def test_what_contradicts_itself_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        replace(DATA, **change)


def test_patterns_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"patterns: expected shape \(q, 3, 6, 3\)"):
        replace(FIELD, patterns=np.zeros((1, 2, 6, 3)))


@pytest.mark.parametrize("nugget", [0.0, 1.0, -0.1, np.nan])
def test_an_impossible_nugget_is_refused(nugget):
    with pytest.raises(ValueError, match="nugget: expected in"):
        replace(FIELD, nugget=nugget)


def test_the_nugget_is_part_of_the_fields_covariance():
    white = replace(FIELD, patterns=None, nugget=1 - 1e-9)
    residual = RNG.standard_normal((1, 3, 6, 3))
    # points that share nothing: only increments are correlated, half and half
    steps = np.linalg.inv(0.5 * np.eye(3) + 0.5)
    scaled = residual[0] / FIELD.noise_std
    expected = np.einsum("ipc,ij,jpc->", scaled, steps, scaled)
    found = field_covariance(white).inner(residual, residual)[0, 0]
    assert found == pytest.approx(expected, rel=1e-6)


def test_a_measured_covariance_is_that_of_the_likelihood():
    settings = NoiseSettings(load_cell_sd=0.01, sample_correlation=0.5)
    # 8 samples, 3 increments: (8 - 1) / (8 - 3 - 2)
    np.testing.assert_allclose(mean_covariance(DATA, settings), COVARIANCE / 8 * 7 / 3)
    plain = mean_covariance(replace(DATA, force_covariance=None), settings)
    assert plain[0, 1] == pytest.approx(
        0.5 * np.sqrt((DATA.force_sd[0] ** 2 - 1e-4) * (DATA.force_sd[1] ** 2 - 1e-4)) / 8
    )


@pytest.mark.lasting
def test_means_scatter_about_the_truth_as_the_measured_covariance_says():
    """False alarm below 1e-6: the mean of 4000 sums of squares, expected 3, within 5 of its SDs."""
    n, rng = 12, np.random.default_rng(5)
    sums = []
    for _ in range(4000):
        forces = rng.multivariate_normal(np.zeros(3), COVARIANCE, n)
        covariance = np.cov(forces, rowvar=False)
        drawn = replace(
            DATA,
            field=None,
            samples=None,
            n_samples=n,
            force_mean=10.0 + forces.mean(axis=0),
            force_sd=np.sqrt(np.diag(covariance)),
            force_covariance=covariance,
        )
        stated = mean_covariance(drawn, NoiseSettings())
        off = drawn.force_mean - 10.0
        sums.append(off @ np.linalg.solve(stated, off))
    error = np.std(sums) / np.sqrt(len(sums))
    assert abs(np.mean(sums) - 3.0) < 5 * error < 0.4


@pytest.mark.lasting
def test_means_scatter_as_a_student_t_whose_scale_student_t_forces_take():
    """False alarm 1e-3 (Kolmogorov-Smirnov, 4000 means): Hotelling's T2 over p is F(p, n - p)."""
    n, p, rng = 6, 3, np.random.default_rng(6)
    settings = NoiseSettings(force_freedom=n - p)
    found = []
    for _ in range(4000):
        forces = rng.multivariate_normal(np.zeros(p), COVARIANCE, n)
        measured = np.cov(forces, rowvar=False)
        drawn = replace(
            DATA,
            field=None,
            samples=None,
            n_samples=n,
            force_sd=np.sqrt(np.diag(measured)),
            force_covariance=measured,
        )
        off = forces.mean(axis=0)
        found.append(off @ np.linalg.solve(mean_covariance(drawn, settings), off) / p)
    assert kstest(found, f(p, n - p).cdf).pvalue > 1e-3


def test_patterns_of_the_data_are_part_of_the_fields_covariance():
    residual = RNG.standard_normal((1, 3, 6, 3))
    found = field_covariance(FIELD).inner(residual, residual)[0, 0]
    bare = replace(FIELD, patterns=None)
    by_hand = field_covariance(bare, patterns=FIELD.patterns).inner(residual, residual)[0, 0]
    assert found == pytest.approx(by_hand, rel=1e-12)
    assert found < field_covariance(bare).inner(residual, residual)[0, 0]


def test_forces_of_a_csv_have_no_covariance(tmp_path):
    path = tmp_path / "forces.csv"
    path.write_text("travel_mm,force_mean_N,force_sd_N,n_samples\n0.6,0.9,0.1,23\n")
    assert read_force_csv(path).force_covariance is None


@pytest.mark.parametrize("study", [0.0, 0.02])
def test_the_common_error_of_contact_reaches_the_likelihood_where_it_is_the_larger(study, tmp_path):
    save_dataset(tmp_path / "d.npz", replace(DATA, travel_zero_sd=0.007))
    data, _ = load_dataset(tmp_path / "d.npz")
    assert data.travel_zero_sd == 0.007
    zero = force_errors(data, NoiseSettings(travel_zero_sd=study)).shared[0]
    expected = max(study, 0.007)
    assert zero.sd == expected
    np.testing.assert_allclose(zero.field, expected * slope_matrix(data.travel), rtol=1e-12)


def test_an_impossible_common_error_of_contact_is_refused():
    with pytest.raises(ValueError, match="travel_zero_sd: expected 0 mm or more"):
        replace(DATA, travel_zero_sd=-0.01)
