"""Emulator: accuracy on a smooth truth, gradients, files, determinism, and honest diagnostics."""

from __future__ import annotations

import errno
import json
import os
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import surrogate.emulator_file as emulator_file
from surrogate import Emulator, TrainingSet, diagnose, leave_one_out_residuals, sobol_design
from surrogate.force_scale import ForceScale
from tests.dense_processes import dense_covariance

BOX = np.array([[0.0, 1.0], [0.0, 0.5]])
TRAVEL = np.array([0.6, 0.8, 1.0, 1.2, 1.4])
N_POINT = 30


def _truth(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smooth stand-in for the FE model: force (n, 5) N, displacement (n, 5, 30, 3) mm."""
    r, s = x[:, :1], x[:, 1:]
    force = 30.0 * TRAVEL ** (1.5 + 0.3 * r + 0.4 * s**1.5) * (1.0 + 0.2 * np.sin(2 * r) * TRAVEL)
    p = np.linspace(0.0, 1.0, N_POINT)
    sideways = np.sin(3.0 * p + 0.3 * r)
    down = -(np.maximum(p, 1e-3) ** (1.0 + 0.3 * s))
    out = np.exp(-p * (1.0 + 0.4 * r * s))
    shape = np.stack([sideways, down, out], axis=2)
    return force * np.exp(0.5 * s), TRAVEL[:, None, None] * shape[:, None]


@cache
def _runs(
    n: int = 20, first: int = 0, noise: float = 0.0, with_field: bool = True, seed: int = 0
) -> TrainingSet:
    x = sobol_design(n, BOX, seed=5)[first:]
    force, displacement = _truth(x)
    force = force * np.exp(noise * np.random.default_rng(seed).normal(size=force.shape))
    return TrainingSet(x, force, displacement if with_field else None, n_excluded=1)


@cache
def _emulator(noise: float = 0.0, with_field: bool = True, seed: int = 3) -> Emulator:
    return Emulator.fit(_runs(noise=noise, with_field=with_field), seed, n_restarts=0)


def _new(n: int = 40) -> np.ndarray:
    return np.random.default_rng(8).uniform(BOX[:, 0], BOX[:, 1], (n, 2))


@pytest.mark.lasting
def test_unseen_forces_and_fields_are_met_to_a_thousandth() -> None:
    force, displacement = _truth(_new())
    mean, _ = _emulator().unit_force(_new())
    assert np.abs(mean / force - 1.0).max() < 1e-3
    assert np.sqrt(np.mean((_emulator().displacement(_new()) - displacement) ** 2)) < 1e-3


def test_shapes_are_those_of_steps_and_modes() -> None:
    emulator, x = _emulator(), _new(7)
    k = emulator.field_modes.shape[1]
    n_obs = 5 * N_POINT * 3
    assert [a.shape for a in emulator.unit_force(x)] == [(7, 5), (7, 5, 5)]
    assert [a.shape for a in emulator.field_weights(x)] == [(7, k), (7, k)]
    assert emulator.unit_force_gradient(x).shape == (7, 5, 2)
    assert emulator.field_weights_gradient(x).shape == (7, k, 2)
    assert emulator.field_offset.shape == (n_obs,) and emulator.field_modes.shape == (n_obs, k)
    assert emulator.field_truncation_std.shape == (5, 3)
    assert emulator.field_truncation_factor.shape == (n_obs, 20)
    assert emulator.n_step == 5 and k <= 20
    np.testing.assert_allclose(emulator.bounds, BOX, atol=1e-15)


def test_the_force_covariance_is_symmetric_and_positive_definite() -> None:
    _, covariance = _emulator(noise=0.02).unit_force(_new())
    np.testing.assert_array_equal(covariance, covariance.transpose(0, 2, 1))
    assert np.linalg.eigvalsh(covariance).min() > 0.0


def test_gradients_are_the_limit_of_differences() -> None:
    emulator, x, h = _emulator(), _new(5) * 0.9 + 0.01, 1e-4
    for axis, step in enumerate(h * np.eye(2)):
        force = (emulator.unit_force(x + step)[0] - emulator.unit_force(x - step)[0]) / (2 * h)
        np.testing.assert_allclose(emulator.unit_force_gradient(x)[:, :, axis], force, atol=1e-2)
        field = emulator.field_weights(x + step)[0] - emulator.field_weights(x - step)[0]
        gradient = emulator.field_weights_gradient(x)[:, :, axis]
        np.testing.assert_allclose(gradient, field / (2 * h), atol=1e-4 * np.abs(gradient).max())


def test_the_truncation_description_is_the_diagonal_of_its_factor() -> None:
    emulator = _emulator()
    variance = np.sum(emulator.field_truncation_factor**2, axis=1).reshape(5, N_POINT, 3)
    np.testing.assert_allclose(emulator.field_truncation_std, np.sqrt(variance.mean(axis=1)))
    assert (emulator.field_truncation_std < 1e-2).all()


@pytest.mark.lasting
def test_noise_in_the_runs_appears_in_the_covariance() -> None:
    """Relative SD of a new noisy run, from 20 runs of 3 % noise in 5 steps.

    Over 40 seeds 0.032 +- 0.004 (SD), so the bounds have a false-alarm rate of about 1e-4.
    """
    mean, covariance = _emulator(noise=0.03).unit_force(_new())
    std = np.sqrt(np.einsum("nii->ni", covariance)) / mean
    assert 0.015 < np.median(std) < 0.06


def test_a_saved_emulator_predicts_the_same_bits(tmp_path: Path) -> None:
    emulator, x = _emulator(noise=0.02), _new()
    emulator.save(tmp_path / "emulator.npz")
    loaded = Emulator.load(tmp_path / "emulator.npz", _runs(noise=0.02).fingerprint)
    for name in ("unit_force", "field_weights"):
        for a, b in zip(getattr(emulator, name)(x), getattr(loaded, name)(x), strict=True):
            assert a.tobytes() == b.tobytes()
    for name in ("unit_force_gradient", "field_weights_gradient", "displacement"):
        assert getattr(emulator, name)(x).tobytes() == getattr(loaded, name)(x).tobytes()
    assert loaded.field_truncation_factor.tobytes() == emulator.field_truncation_factor.tobytes()
    assert loaded.header == emulator.header and loaded.header.n_excluded == 1
    assert list(tmp_path.iterdir()) == [tmp_path / "emulator.npz"]


def test_an_emulator_of_forces_only_saves_and_refuses_fields(tmp_path: Path) -> None:
    _emulator(with_field=False).save(tmp_path / "emulator.npz")
    loaded = Emulator.load(tmp_path / "emulator.npz")
    assert loaded.field is None
    with pytest.raises(ValueError, match="trained on forces only"):
        loaded.field_weights(_new())


def test_an_emulator_of_other_runs_is_refused_by_name(tmp_path: Path) -> None:
    _emulator().save(tmp_path / "emulator.npz")
    with pytest.raises(ValueError, match=r"emulator\.npz: emulator trained on other runs"):
        Emulator.load(tmp_path / "emulator.npz", _runs(noise=0.02).fingerprint)


def test_an_emulator_of_another_version_is_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(emulator_file, "EMULATOR_VERSION", 99)
        _emulator().save(tmp_path / "emulator.npz")
    with pytest.raises(ValueError, match=r"emulator\.npz: emulator of version 99, this program"):
        Emulator.load(tmp_path / "emulator.npz")


@pytest.mark.parametrize("damage", ["empty", "truncated", "flipped", "foreign"])
def test_a_damaged_or_foreign_file_is_refused_by_name(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "emulator.npz"
    _emulator().save(path)
    content = bytearray(path.read_bytes())
    content[bytes(content).index(_emulator().field_offset.tobytes()) + 9] ^= 1
    if damage == "foreign":
        np.savez(path, a=np.ones(3))
    else:
        path.write_bytes({"empty": b"", "truncated": content[:3000], "flipped": content}[damage])
    with pytest.raises(ValueError, match=r"emulator\.npz: not a readable emulator"):
        Emulator.load(path)


@pytest.mark.parametrize("missing", ["force_alpha", "scale", "field_pod_modes"])
def test_a_file_without_one_of_its_arrays_is_refused(tmp_path: Path, missing: str) -> None:
    path = tmp_path / "emulator.npz"
    _emulator().save(path)
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files if name != missing}
    np.savez(path, **arrays)
    with pytest.raises(ValueError, match="not a complete emulator"):
        Emulator.load(path)


@pytest.mark.parametrize("name", ["force_pod_modes", "field_pod_truncation", "force_inputs"])
@pytest.mark.parametrize("damage", ["flat", "short", "nan"])
def test_a_file_with_arrays_that_do_not_fit_is_refused_by_name(
    tmp_path: Path, name: str, damage: str
) -> None:
    path = tmp_path / "emulator.npz"
    _emulator().save(path)
    with np.load(path) as stored:
        arrays = dict(stored)
    whole = arrays[name]
    arrays[name] = {"flat": whole.ravel(), "short": whole[:-1], "nan": np.nan * whole}[damage]
    np.savez(path, **arrays)
    with pytest.raises(ValueError, match=r"emulator\.npz: not a complete emulator .*expected"):
        Emulator.load(path)


def test_as_many_modes_of_the_force_as_increments_are_kept() -> None:
    """16 increments that vary in 16 ways: nothing is left out of the training forces."""
    x = sobol_design(24, BOX, seed=5)
    noise = np.random.default_rng(1).normal(size=(24, 16))
    force = np.linspace(1.0, 5.0, 16) * np.exp(0.3 * x[:, :1] + 0.02 * noise)
    emulator = Emulator.fit(TrainingSet(x, force, None, n_excluded=0), 3, n_restarts=0)
    assert emulator.force.pod.modes.shape == (16, 16)
    assert not emulator.force.pod.truncation.any()


@pytest.mark.lasting
def test_the_same_runs_and_seed_give_the_same_bits() -> None:
    again = Emulator.fit(_runs(), 3, n_restarts=0)
    for a, b in zip(again.unit_force(_new()), _emulator().unit_force(_new()), strict=True):
        assert a.tobytes() == b.tobytes()
    assert (
        again.field_weights(_new())[0].tobytes() == _emulator().field_weights(_new())[0].tobytes()
    )


def test_the_unit_of_a_step_does_not_change_its_relative_prediction() -> None:
    """Powers of two, so that the factors round nothing."""
    runs, factor = _runs(with_field=False), 2.0 ** np.arange(-4, 6, 2)
    other = Emulator.fit(replace(runs, force=runs.force * factor), 3, n_restarts=0)
    mean, covariance = _emulator(with_field=False).unit_force(_new())
    found, found_covariance = other.unit_force(_new())
    np.testing.assert_array_equal(found, factor * mean)
    np.testing.assert_array_equal(found_covariance, factor[:, None] * factor * covariance)


@pytest.mark.parametrize("scale", [np.ones(4), np.zeros(5), np.full(5, np.nan)])
def test_a_force_scale_that_is_none_is_refused(scale: np.ndarray) -> None:
    with pytest.raises(ValueError, match="force_scale: expected 5 positive forces"):
        replace(_emulator(), force_scale=ForceScale(scale, log=False))


def test_ratios_of_another_shape_are_refused() -> None:
    with pytest.raises(ValueError, match=r"ratios: expected shape \(m, 2\), got \(2,\)"):
        _emulator().unit_force(np.ones(2))


def test_diagnostics_agree_with_the_errors_on_held_out_runs() -> None:
    emulator, held_out = _emulator(), _runs(28, first=20)
    found = diagnose(emulator, _runs(), held_out).held_out
    assert found is not None and held_out.displacement is not None and found.field_rms is not None
    relative = emulator.unit_force(held_out.ratios)[0] / held_out.force - 1.0
    np.testing.assert_allclose(found.force_rms, np.sqrt(np.mean(relative**2, axis=0)))
    assert found.force_max == pytest.approx(np.abs(relative).max())
    error = emulator.displacement(held_out.ratios) - held_out.displacement
    np.testing.assert_allclose(found.field_rms, np.sqrt(np.mean(error**2, axis=(0, 2, 3))))
    assert found.field_max == pytest.approx(np.abs(error).max())


def test_leave_one_out_errors_are_those_of_emulators_with_the_same_hyperparameters() -> None:
    """Against conditioning on the other runs by the dense formula, mode by mode."""
    emulator, runs = _emulator(noise=0.02), _runs(noise=0.02)
    p, pod = emulator.force.processes, emulator.force.pod
    weights = pod.weights(emulator.force_scale.values(runs.force))
    expected = np.empty_like(weights)
    for mode in range(5):
        covariance = dense_covariance(p, mode)
        target = (weights[:, mode] - p.offset[mode]) / p.scale[mode]
        for run in range(20):
            others = np.arange(20) != run
            gain = np.linalg.solve(covariance[np.ix_(others, others)], covariance[others, run])
            expected[run, mode] = p.offset[mode] + p.scale[mode] * (gain @ target[others])
    y = pod.reconstruct(expected)
    predicted, _ = emulator.force_scale.force(y, np.zeros((20, 5, 5)))
    relative = predicted / runs.force - 1.0
    found = diagnose(emulator, runs).leave_one_out
    np.testing.assert_allclose(found.force_rms, np.sqrt(np.mean(relative**2, axis=0)), rtol=1e-6)


def test_leave_one_out_foretells_the_errors_on_unseen_runs() -> None:
    """With 2 % noise both errors are near 2 %.

    Over 40 seeds (mean +- SD) their ratio is 1.11 +- 0.16, the RMS z 1.09 +- 0.21 and the coverage
    0.924 +- 0.053, the last two with long tails (to 1.87 and 0.73); the bounds are four to six SD
    away, a false-alarm rate of about 1e-3 together.
    """
    diagnostics = diagnose(
        _emulator(noise=0.02), _runs(noise=0.02), _runs(40, first=20, noise=0.02, seed=1)
    )
    assert diagnostics.held_out is not None
    inside = np.mean(diagnostics.leave_one_out.force_rms)
    assert 0.5 < np.mean(diagnostics.held_out.force_rms) / inside < 1.8
    assert 0.4 < diagnostics.held_out.force_rms_z < 2.3
    assert diagnostics.held_out.force_coverage_95 > 0.65


def test_an_emulator_that_is_surer_than_it_is_good_is_reported() -> None:
    runs, emulator = _runs(noise=0.02), _emulator(noise=0.02)
    sure = replace(emulator.force.processes, inflation=np.full(5, 1e-2))
    emulator = replace(emulator, force=replace(emulator.force, processes=sure))
    violated = diagnose(emulator, runs, _runs(28, first=20, noise=0.02, seed=1)).within(0.1, 0.1, 3)
    assert len(violated) == 1 and "held-out force error over its predicted SD" in violated[0]


def test_each_violated_rule_is_named_with_value_and_limit() -> None:
    diagnostics = diagnose(_emulator(), _runs())
    assert diagnostics.within(0.05, 0.01, 5.0) == []
    violated = diagnostics.within(0.0, 0.0, 0.0)
    assert len(violated) == 4
    assert all(v.startswith("emulator: leave-one-out ") and "above 0" in v for v in violated)


def test_without_a_limit_of_the_field_no_rule_is_about_it() -> None:
    diagnostics = diagnose(_emulator(), _runs())
    violated = diagnostics.within(0.0, None, 0.0)
    assert len(violated) == 2 and all(" force error" in v for v in violated)


def test_a_rule_is_violated_by_a_number_that_is_not_one() -> None:
    diagnostics = diagnose(_emulator(), _runs())
    broken = replace(diagnostics.leave_one_out, force_rms_z=float("nan"))
    assert len(replace(diagnostics, leave_one_out=broken).within(1.0, 1.0, 9.0)) == 1


def test_diagnostics_are_json_with_counts() -> None:
    content = json.loads(json.dumps(diagnose(_emulator(), _runs(), _runs(28, first=20)).to_dict()))
    assert content["n_train"] == 20 and content["n_excluded"] == 1
    assert content["held_out"]["n_runs"] == 8 and content["n_held_out_excluded"] == 1


def test_diagnostics_of_forces_only_have_no_field() -> None:
    diagnostics = diagnose(_emulator(with_field=False), _runs(with_field=False))
    assert diagnostics.leave_one_out.field_rms is None
    assert len(diagnostics.within(0.0, 0.0, 0.0)) == 2


def test_diagnostics_refuse_the_runs_of_another_emulator() -> None:
    with pytest.raises(ValueError, match="training_set: is not the one"):
        diagnose(_emulator(), _runs(noise=0.02))
    for other in (_runs(28, first=8), _runs(16)):
        with pytest.raises(ValueError, match="training_set: is not the one"):
            leave_one_out_residuals(_emulator(), other)


def test_diagnostics_refuse_held_out_runs_without_the_field_of_the_emulator() -> None:
    with pytest.raises(ValueError, match="displacement: the emulator has a field"):
        diagnose(_emulator(), _runs(), _runs(28, first=20, with_field=False))


def test_an_emulator_file_may_be_read_by_whom_the_umask_lets(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        _emulator(with_field=False).save(tmp_path / "emulator.npz")
    finally:
        os.umask(before)
    assert (tmp_path / "emulator.npz").stat().st_mode & 0o777 == 0o640


def test_diagnostics_refuse_runs_of_training_as_held_out_and_those_of_other_shapes() -> None:
    runs, other = _runs(), _runs(24, first=20)
    with pytest.raises(ValueError, match="took no part in training"):
        diagnose(_emulator(), runs, runs)
    assert other.displacement is not None
    one_step = TrainingSet(other.ratios, other.force[:, :1], other.displacement[:, :1])
    with pytest.raises(ValueError, match="runs: expected 5 steps, found 1"):
        diagnose(_emulator(), runs, one_step)
    one_point = replace(other, displacement=other.displacement[:, :, :1])
    with pytest.raises(ValueError, match="runs: expected fields"):
        diagnose(_emulator(), runs, one_point)


@pytest.mark.parametrize(("step", "constant"), [(1, 1.7), (2, 1.7), (3, 1.0), (4, 1.7)])
def test_a_force_that_is_the_same_in_all_runs_is_met_and_judged(step: int, constant: float) -> None:
    """Its error is rounding and its SD none: their ratio was anything, or NaN."""
    runs = _runs()
    force = runs.force.copy()
    force[:, step] = constant
    own = replace(runs, force=force)
    emulator = Emulator.fit(own, 1, n_restarts=0)
    assert 0.2 < diagnose(emulator, own).leave_one_out.force_rms_z < 2.0


def test_the_precision_of_the_numbers_given_does_not_change_the_bits() -> None:
    runs = _runs()
    assert runs.displacement is not None
    single = [x.astype(np.float32) for x in (runs.ratios, runs.force, runs.displacement)]
    first, second = TrainingSet(*single), TrainingSet(*(x.astype(np.float64) for x in single))
    assert first.fingerprint == second.fingerprint
    found = [Emulator.fit(own, 1, n_restarts=0, sharing="all") for own in (first, second)]
    np.testing.assert_array_equal(found[0].unit_force(_new())[0], found[1].unit_force(_new())[0])


def test_an_emulator_that_cannot_be_read_is_not_called_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "emulator.npz"
    _emulator().save(path)

    def failing(*_: object, **__: object) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(np, "load", failing)
    with pytest.raises(OSError, match="Input/output error"):
        Emulator.load(path)


ONE_COLUMN = np.array([[0.1, 0.2], [0.1, 0.3], [0.1, 0.4]])


@pytest.mark.parametrize(
    ("x", "force", "message"),
    [
        (np.eye(2), np.ones((2, 3)), "expected 3 runs or more, found 2"),
        (ONE_COLUMN, np.eye(3) + 1.0, "found input 1 of 2 at 0.1 in all runs"),
        (np.eye(3)[:, :2], np.ones((3, 3)), "expected forces that vary"),
    ],
)
def test_runs_that_teach_nothing_are_refused_by_what_does_not_vary(
    x: np.ndarray, force: np.ndarray, message: str
) -> None:
    with pytest.raises(ValueError, match=f"training_set: .*{message}"):
        Emulator.fit(TrainingSet(x, force, None), 0)


@pytest.mark.parametrize(("n", "few"), [(5, True), (9, True), (10, False)])
def test_runs_that_hardly_tell_the_covariance_are_noted(n: int, few: bool) -> None:
    emulator = Emulator.fit(_runs(n=n, with_field=False), 3, n_restarts=0)
    said = [note for note in emulator.notes if "stated errors mean little" in note]
    assert bool(said) == few
    assert not few or said == [
        f"force emulator: {n} values and derivatives of each process, expected 10 or more: "
        "its stated errors mean little"
    ]


def test_a_missing_folder_is_named_by_the_path_that_was_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "missing" / "emulator.npz"
    with pytest.raises(FileNotFoundError) as caught:
        _emulator(with_field=False).save(path)
    assert caught.value.filename == str(path)


def test_restarts_and_ranks_that_are_no_counts_are_refused() -> None:
    with pytest.raises(ValueError, match="n_restarts: expected a whole number of 0 or more"):
        Emulator.fit(_runs(), 3, n_restarts=-1)
    with pytest.raises(ValueError, match="rank: expected a whole number of 0 or more directions"):
        _emulator().predict_field(_new(2), n_truncation=2.5)  # type: ignore[arg-type]
