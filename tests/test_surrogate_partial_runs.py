"""Runs that ended early teach an emulator at the steps they reached, and claim nothing beyond."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from surrogate import Emulator, TrainingSet, sobol_design
from surrogate.emulator import _taught
from surrogate.gp import GaussianProcesses
from surrogate.gp_fit import fit_processes
from surrogate.modal import ModalEmulator, fit_modal
from surrogate.partial_runs import PartialRuns, _by_truncation, taught
from surrogate.pod import Pod

pytestmark = pytest.mark.lasting

TRAVEL = np.array([0.6, 0.8, 1.0, 1.2, 1.4])
PLACE = np.random.default_rng(4).random((30, 2))
BOX = np.array([[0.0, 1.0], [0.0, 1.0]])


def truth(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces (n, 5) N and fields (n, 5, 30, 3) mm: a hill at high r that complete runs miss."""
    hill = np.exp(-12.0 * ((x[:, 0] - 0.85) ** 2 + (x[:, 1] - 0.5) ** 2))
    bent = TRAVEL * (1.0 + x[:, :1] + 0.5 * x[:, 1:] * TRAVEL) + 0.6 * hill[:, None] * TRAVEL**2
    shape = np.stack([np.sin(3.0 * PLACE[:, 0]), PLACE[:, 1], np.cos(2.0 * PLACE[:, 1])], axis=1)
    field = 0.1 * bent[:, :, None, None] * shape + 0.02 * (hill[:, None] * TRAVEL)[
        :, :, None, None
    ] * np.roll(shape, 1, axis=1)
    return 20.0 * bent, field


def training(n_good: int | None, n: int = 40) -> TrainingSet:
    """A design whose runs within 0.25 of the hill end after `n_good` steps; None: they do not."""
    x = sobol_design(n, BOX, 3)
    force, field = truth(x)
    good = np.ones(force.shape, dtype=bool)
    if n_good is not None:
        early = np.hypot(x[:, 0] - 0.85, x[:, 1] - 0.5) < 0.25
        good[early, n_good:] = False
    return TrainingSet.from_runs(x, force, field, good.all(axis=1), good=good)


@cache
def fitted(n_good: int | None) -> Emulator:
    """The emulator of `training(n_good)`."""
    return Emulator.fit(training(n_good), 1)


def teaching(emulator: Emulator, runs: PartialRuns) -> Emulator:
    """An emulator of complete runs taught by others: what `fit` does last."""
    force, field = _taught(runs, emulator.force, emulator.force_scale, emulator.field)
    return replace(emulator, force=force, field=field)


NEW = np.column_stack([np.linspace(0.72, 0.95, 12), np.linspace(0.4, 0.6, 12)])


def errors(emulator: Emulator) -> tuple[np.ndarray, np.ndarray]:
    """RMS relative force errors (5,) and field errors (5,) mm about the hill."""
    force, field = truth(NEW)
    found, _ = emulator.unit_force(NEW)
    off = emulator.displacement(NEW) - field
    by_step = np.sqrt(np.mean((found / force - 1.0) ** 2, axis=0))
    return by_step, np.sqrt(np.mean(off**2, axis=(0, 2, 3)))


def test_early_steps_gain_by_runs_that_ended_late_steps_by_what_ties_them() -> None:
    runs = training(3)
    assert runs.partial is not None and 3 <= len(runs.partial.ratios) == runs.n_excluded
    emulator = fitted(3)
    without, known = errors(emulator.by_complete_runs), errors(emulator)
    for before, after in zip(without, known, strict=True):
        assert (after[:3] < 0.35 * before[:3]).all()
        assert (after[3:] < 1.05 * before[3:]).all()


def test_stated_errors_are_those_of_the_complete_runs_and_hold_better() -> None:
    """At the hill, which complete runs miss by 3.5 of their SDs (RMS)."""
    emulator = fitted(3)
    bare = emulator.by_complete_runs
    force, covariance = emulator.unit_force(NEW)
    weights, variance = emulator.field_weights(NEW)
    np.testing.assert_array_equal(variance, bare.field_weights(NEW)[1])
    sd = np.sqrt(np.einsum("nii->ni", covariance))
    z, missed = (force - truth(NEW)[0]) / sd, (bare.unit_force(NEW)[0] - truth(NEW)[0]) / sd
    assert np.mean(z**2) < 0.12 * np.mean(missed**2) and np.mean(missed**2) > 9.0
    assert not np.array_equal(weights, bare.field_weights(NEW)[0])


def test_complete_runs_left_out_say_what_they_said() -> None:
    emulator = fitted(3)
    for one, other in zip(
        emulator.unit_force_leave_one_out(),
        emulator.by_complete_runs.unit_force_leave_one_out(),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, rtol=1e-9)


def test_without_such_runs_every_bit_stays() -> None:
    runs = training(None)
    assert runs.partial is None
    kept = replace(training(3), partial=None)
    with_none, never = Emulator.fit(kept, 1), fitted(3).by_complete_runs
    np.testing.assert_array_equal(with_none.displacement(NEW), never.displacement(NEW))
    assert kept.fingerprint != training(3).fingerprint
    partial = training(3).partial
    assert partial is not None
    again = teaching(with_none, partial)
    np.testing.assert_array_equal(again.displacement(NEW), fitted(3).displacement(NEW))
    np.testing.assert_array_equal(again.unit_force(NEW)[0], fitted(3).unit_force(NEW)[0])


def test_the_gradient_is_the_limit_of_differences() -> None:
    emulator, step = fitted(3), 1e-6
    force, field = emulator.unit_force_gradient(NEW), emulator.field_weights_gradient(NEW)
    for axis, change in enumerate(step * np.eye(2)):
        high, low = (emulator.unit_force(NEW + sign * change)[0] for sign in (1.0, -1.0))
        difference = (high - low) / (2.0 * step)
        np.testing.assert_allclose(force[:, :, axis], difference, rtol=1e-5, atol=1e-5)
        high, low = (emulator.field_weights(NEW + sign * change)[0] for sign in (1.0, -1.0))
        difference = (high - low) / (2.0 * step)
        np.testing.assert_allclose(field[:, :, axis], difference, rtol=1e-4, atol=1e-6)


def test_a_saved_emulator_predicts_the_same_bits(tmp_path: Path) -> None:
    runs = training(3)
    emulator = fitted(3)
    emulator.save(tmp_path / "emulator.npz")
    again = Emulator.load(tmp_path / "emulator.npz", runs.fingerprint)
    np.testing.assert_array_equal(again.displacement(NEW), emulator.displacement(NEW))
    np.testing.assert_array_equal(again.unit_force(NEW)[0], emulator.unit_force(NEW)[0])


def _one_mode(x: np.ndarray, y: np.ndarray) -> ModalEmulator:
    """Values y (n,) over x as an emulator of one output, which its mode holds whole."""
    processes = fit_processes(x, y[:, None], 0, families=("rbf",))
    pod = Pod(
        np.zeros(1),
        np.ones((1, 1)),
        np.ones(1),
        np.zeros((len(x), 1)),
        np.full(len(x), 1.0 / len(x)),
    )
    return ModalEmulator(pod, processes)


def conditioned(processes: GaussianProcesses, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Mean at NEW given y (q,) at x (q, 2) too, from the covariance: the textbook's formula."""
    noise = (processes.nugget * processes.variance_scale)[0] * np.eye(len(x))
    cross, own = processes.covariance(NEW, x)[0], processes.covariance(x, x)[0] + noise
    off = y - processes.mean(x)[:, 0]
    found: np.ndarray = processes.mean(NEW)[:, 0] + cross @ np.linalg.solve(own, off)
    return found


def test_what_is_known_whole_conditions_as_a_gaussian_process_does() -> None:
    rng = np.random.default_rng(2)
    x, more = rng.random((14, 2)), 0.2 + 0.6 * rng.random((3, 2))
    y = np.sin(4.0 * x[:, 0]) + x[:, 1] ** 2
    known = np.sin(4.0 * more[:, 0]) + more[:, 1] ** 2
    modal = _one_mode(x, y)
    found = taught(modal, more, known[:, None]).processes.mean(NEW)[:, 0]
    np.testing.assert_allclose(found, conditioned(modal.processes, more, known), rtol=1e-6)


def test_a_gradient_enhanced_emulator_is_conditioned_alike() -> None:
    rng = np.random.default_rng(2)
    x, more = rng.random((14, 2)), 0.2 + 0.6 * rng.random((3, 2))
    y = np.sin(4.0 * x[:, :1]) + x[:, 1:] ** 2
    slopes = np.stack([4.0 * np.cos(4.0 * x[:, :1]), 2.0 * x[:, 1:]], axis=2)
    modal = fit_modal(
        x,
        np.hstack([y, y**2]),
        0,
        slopes=np.concatenate([slopes, 2.0 * y[:, :, None] * slopes], axis=1),
    )
    known = np.sin(4.0 * more[:, :1]) + more[:, 1:] ** 2
    found = taught(modal, more, np.hstack([known, known**2]))
    for mode in range(found.pod.modes.shape[1]):
        processes = modal.processes
        weights = found.pod.weights(np.hstack([known, known**2]))[:, mode]
        noise = (processes.nugget * processes.variance_scale)[mode] * np.eye(3)
        own = processes.covariance(more, more)[mode] + noise
        cross = processes.covariance(NEW, more)[mode]
        expected = processes.mean(NEW)[:, mode] + cross @ np.linalg.solve(
            own, weights - processes.mean(more)[:, mode]
        )
        np.testing.assert_allclose(
            found.processes.mean(NEW)[:, mode], expected, rtol=1e-5, atol=1e-7
        )


def test_teaching_the_same_again_changes_nothing() -> None:
    runs = training(3)
    assert runs.partial is not None
    emulator = fitted(3)
    again = taught(
        emulator.force, runs.partial.ratios, emulator.force_scale.values(runs.partial.force)
    )
    np.testing.assert_allclose(
        again.processes.mean(NEW), emulator.force.processes.mean(NEW), rtol=1e-9
    )


@pytest.mark.parametrize("off", [0.02, 0.5])
def test_a_run_on_another_branch_does_not_bend_the_mean(off: float) -> None:
    """Its force lies off by 2 or 50 %, where the complete runs state 0.1 % or less."""
    straight = fitted(None)
    x = np.array([[0.41, 0.37]])
    force, field = truth(x)
    branch = np.arange(5) < 3
    other = PartialRuns(
        x,
        np.where(branch, (1.0 + off) * force, np.nan),
        np.where(branch[:, None, None], (1.0 + off) * field, np.nan),
    )
    bent = teaching(straight, other)
    stated = np.sqrt(np.einsum("nii->ni", straight.unit_force(x)[1]))[0]
    assert (stated < 1e-3 * force[0]).all()
    moved = bent.unit_force(x)[0][0] - straight.unit_force(x)[0][0]
    assert (np.abs(moved) < 2.6 * stated).all()  # 99 % of a normal are within 2.58
    # A run that agrees counts whole.
    agrees = replace(other, force=np.where(branch, force, np.nan), displacement=None)
    near = teaching(straight, agrees).unit_force(x)[0][0]
    before = np.abs(straight.unit_force(x)[0][0] / force[0] - 1.0)
    assert (np.abs(near / force[0] - 1.0)[:3] < 0.5 * before[:3]).all()


def test_a_run_outside_the_box_of_the_complete_ones_teaches_nothing() -> None:
    modal = _one_mode(np.random.default_rng(1).random((12, 2)), np.arange(12.0))
    assert taught(modal, np.array([[1.5, 0.5]]), np.array([[3.0]])) is modal


def test_runs_that_are_good_nowhere_or_everywhere_are_refused() -> None:
    for force in (np.full((1, 5), np.nan), np.ones((1, 5))):
        with pytest.raises(ValueError, match="at some steps of every run"):
            PartialRuns(np.zeros((1, 2)), force, None)


def test_a_run_that_ended_early_though_all_its_steps_are_good_is_left_out() -> None:
    x = sobol_design(6, BOX, 3)
    force, field = truth(x)
    reached = np.arange(6) > 0
    runs = TrainingSet.from_runs(x, force, field, reached, good=np.ones(force.shape, dtype=bool))
    assert runs.partial is None and runs.n_excluded == 1


def test_good_steps_of_another_shape_are_refused() -> None:
    x = sobol_design(6, BOX, 3)
    force, field = truth(x)
    with pytest.raises(ValueError, match=r"good: expected shape \(6, 5\), got \(6, 4\)"):
        TrainingSet.from_runs(x, force, field, np.arange(6) > 0, good=np.ones((6, 4), dtype=bool))


def test_steps_from_one_without_compression_on_are_not_good() -> None:
    x = sobol_design(6, BOX, 3)
    force, field = truth(x)
    good = np.ones(force.shape, dtype=bool)
    good[0, 3:] = False
    force[0, 1] = -1.0
    reached = np.arange(6) > 0
    partial = TrainingSet.from_runs(x, force, field, reached, good=good).partial
    assert partial is not None
    assert np.isfinite(partial.force[0]).tolist() == [True, False, False, False, False]
    with pytest.raises(ValueError, match="expected positive forces"):
        PartialRuns(x[:1], np.where(np.arange(5) < 3, force[:1], np.nan), None)


def test_runs_of_other_steps_or_factors_than_the_complete_ones_are_refused() -> None:
    runs = training(3)
    early = runs.partial
    assert early is not None
    with pytest.raises(ValueError, match="expected 2 ratios a run as of the complete runs, got 1"):
        replace(runs, partial=replace(early, ratios=early.ratios[:, :1]))
    shorter = replace(early, force=early.force[:, :4], displacement=None)
    with pytest.raises(ValueError, match=r"a force of \(5,\) a run as of the complete runs"):
        replace(runs, partial=shorter)
    with pytest.raises(ValueError, match=r"a displacement of .* as of the complete runs, got None"):
        replace(runs, partial=replace(early, displacement=None))


def test_lists_are_taken_as_arrays() -> None:
    x = sobol_design(8, BOX, 3)
    force, field = truth(x)
    good = np.ones(force.shape, dtype=bool)
    good[0, 3:] = False
    arrays = TrainingSet.from_runs(x, force, field, good.all(axis=1), good=good)
    lists = TrainingSet.from_runs(
        *(values.tolist() for values in (x, force, field, good.all(axis=1))), good=good.tolist()
    )
    assert lists.fingerprint == arrays.fingerprint


def test_what_modes_leave_out_is_noise_in_every_direction() -> None:
    """Of a few runs it spans few; its mean over the values counts once more for each by itself."""
    rng = np.random.default_rng(6)
    modes, factor = rng.standard_normal((20, 3)), rng.standard_normal((20, 2))
    covariance = factor @ factor.T
    white = np.trace(covariance) / 20
    expected = np.linalg.solve(covariance + white * np.eye(20), modes)
    np.testing.assert_allclose(_by_truncation(modes, factor, 0.0), expected, rtol=1e-9)
    expected = np.linalg.solve(covariance + 5.0 * white * np.eye(20), modes)
    np.testing.assert_allclose(_by_truncation(modes, factor, 5.0 * white), expected, rtol=1e-9)
