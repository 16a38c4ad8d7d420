"""Emulators with derivatives: better at equal runs, exact files, honest when derivatives fail."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from surrogate import Emulator, TrainingSet, diagnose, named_gradient, sobol_design

BOX = np.array([[0.0, 1.0], [0.0, 0.5]])
TRAVEL = np.array([0.6, 0.8, 1.0, 1.2, 1.4])
P = np.linspace(0.05, 1.0, 20)


def _model(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Force (n, 5), field (n, 5, 20, 3) and their exact derivatives by (r, s)."""
    r, s = x[:, :1], x[:, 1:]
    exponent = 1.5 + 0.3 * r + 0.8 * s
    bend = 1.0 + 0.2 * np.sin(4 * r) * TRAVEL
    force = 30.0 * TRAVEL**exponent * bend
    log_r = 0.3 * np.log(TRAVEL) + 0.8 * np.cos(4 * r) * TRAVEL / bend
    log_s = np.broadcast_to(0.8 * np.log(TRAVEL), force.shape)
    force_gradient = force[:, :, None] * np.stack([log_r, log_s], axis=2)
    phase = 3.0 * P + 2.0 * r
    side, out = np.sin(phase), np.exp(-P * (1.0 + 2.0 * r * s))
    down = -(P ** (1.0 + s))
    zero = np.zeros_like(side)
    by_r = [2.0 * np.cos(phase), zero, -2.0 * P * s * out]
    by_s = [zero, down * np.log(P), -2.0 * P * r * out]
    shape = np.stack([side, down, out], axis=2)
    gradient = np.stack([np.stack(by_r, axis=2), np.stack(by_s, axis=2)], axis=3)
    travel = TRAVEL[:, None, None]
    return (
        force,
        travel * shape[:, None],
        force_gradient,
        travel[..., None] * gradient[:, None],
    )


@cache
def _runs(n: int = 10) -> TrainingSet:
    x = sobol_design(n, BOX, seed=5)
    force, field, force_gradient, field_gradient = _model(x)
    return TrainingSet(x, force, field, 0, force_gradient, field_gradient)


@cache
def _emulator() -> Emulator:
    return Emulator.fit(_runs(), 3, n_restarts=0)


def _new(n: int = 60) -> np.ndarray:
    return np.random.default_rng(8).uniform(BOX[:, 0], BOX[:, 1], (n, 2))


def test_the_derivatives_of_the_toy_are_limits_of_differences() -> None:
    x = _new(4)
    for axis, step in enumerate(1e-6 * np.eye(2)):
        above, below = _model(x + step), _model(x - step)
        for value, gradient in ((0, 2), (1, 3)):
            difference = (above[value] - below[value]) / 2e-6
            np.testing.assert_allclose(_model(x)[gradient][..., axis], difference, atol=1e-6)


@pytest.mark.lasting
def test_derivatives_make_force_and_field_better_at_equal_runs() -> None:
    """RMS errors on new points from 10 runs: at least three times smaller."""
    plain = Emulator.fit(_runs().without_gradients, 3, n_restarts=0)
    force, field, _, _ = _model(_new())
    for name, truth in (("unit_force", force), ("displacement", field)):
        errors = []
        for emulator in (_emulator(), plain):
            found = getattr(emulator, name)(_new())
            mean = found[0] if isinstance(found, tuple) else found
            errors.append(np.sqrt(np.mean((mean - truth) ** 2)))
        assert errors[0] < errors[1] / 3.0


def test_the_gradient_of_the_emulated_force_is_that_of_the_model() -> None:
    gradient = _emulator().unit_force_gradient(_new())
    expected = _model(_new())[2]
    assert np.abs(gradient - expected).max() < 0.02 * np.abs(expected).max()


@pytest.mark.parametrize("log", [False, True])
def test_the_gradient_is_the_limit_of_differences_on_either_scale(log: bool) -> None:
    emulator = replace(_emulator(), force_scale=replace(_emulator().force_scale, log=log))
    x = _new(5) * 0.9 + 0.01
    for axis, step in enumerate(1e-5 * np.eye(2)):
        difference = emulator.unit_force(x + step)[0] - emulator.unit_force(x - step)[0]
        found = emulator.unit_force_gradient(x)[:, :, axis]
        np.testing.assert_allclose(found, difference / 2e-5, rtol=1e-4, atol=1e-4)


def test_the_lognormal_covariance_is_that_of_draws() -> None:
    """10^5 draws of the logarithm; standard error of a variance is 0.5 %, bound at 5."""
    scale = replace(_emulator().force_scale, log=True)
    y = np.array([[0.1, -0.2, 0.0, 0.3, 0.1]])
    root = 0.05 * np.random.default_rng(0).normal(size=(5, 5))
    _, covariance = scale.force(y, (root @ root.T)[None])
    draws = scale.mean * np.exp(y + np.random.default_rng(1).normal(size=(100_000, 5)) @ root.T)
    np.testing.assert_allclose(np.diag(covariance[0]), draws.var(axis=0), rtol=0.05)


def test_a_saved_emulator_with_derivatives_predicts_the_same_bits(tmp_path: Path) -> None:
    emulator = _emulator()
    emulator.save(tmp_path / "emulator.npz")
    loaded = Emulator.load(tmp_path / "emulator.npz", _runs().fingerprint)
    for name in ("unit_force", "field_weights"):
        for a, b in zip(
            getattr(emulator, name)(_new()), getattr(loaded, name)(_new()), strict=True
        ):
            assert a.tobytes() == b.tobytes()
    assert loaded.unit_force_gradient(_new()).tobytes() == (
        emulator.unit_force_gradient(_new()).tobytes()
    )
    assert loaded.force_scale.log == emulator.force_scale.log and loaded.notes == emulator.notes


def test_an_emulator_of_the_values_alone_is_another_file(tmp_path: Path) -> None:
    _emulator().save(tmp_path / "emulator.npz")
    with pytest.raises(ValueError, match="trained on other runs"):
        Emulator.load(tmp_path / "emulator.npz", _runs().without_gradients.fingerprint)


def test_runs_whose_derivatives_are_unusable_give_their_values() -> None:
    """Of runs in an unstable equilibrium, and of an input without derivatives."""
    runs = _runs()
    assert runs.force_gradient is not None and runs.displacement_gradient is not None
    smooth = np.arange(10) % 3 > 0
    only_s = [
        named_gradient(gradient[..., 1:], ("s",), ("r", "s"))
        for gradient in (runs.force_gradient, runs.displacement_gradient)
    ]
    some = TrainingSet.from_runs(
        runs.ratios,
        runs.force,
        runs.displacement,
        np.ones(10, dtype=bool),
        force_gradient=only_s[0],
        displacement_gradient=only_s[1],
        smooth=smooth,
    )
    processes = Emulator.fit(some, 3, n_restarts=0).force.processes
    np.testing.assert_array_equal(processes.usable, np.stack([0 * smooth, smooth], axis=1))
    assert processes.rows.n_rows == 10 + smooth.sum()


def test_columns_are_taken_by_name_and_missing_ones_are_nan() -> None:
    gradient = np.arange(6.0).reshape(2, 3)
    found = named_gradient(gradient, ("r", "s", "bulk"), ("bulk", "height", "r"))
    np.testing.assert_array_equal(found, [[2.0, np.nan, 0.0], [5.0, np.nan, 3.0]])
    with pytest.raises(ValueError, match=r"gradient: expected 2 columns \(r, s\), found 3"):
        named_gradient(gradient, ("r", "s"), ("r",))


def test_gradients_of_another_shape_are_refused_and_part_of_the_fingerprint() -> None:
    runs = _runs()
    with pytest.raises(ValueError, match=r"force_gradient: expected shape \(10, 5, 2\)"):
        replace(runs, force_gradient=np.zeros((10, 5, 3)))
    with pytest.raises(ValueError, match="displacement_gradient: expected shape None"):
        replace(runs, displacement=None)
    assert runs.force_gradient is not None
    other = runs.force_gradient.copy()
    other[2, 1, 0] = np.nextafter(other[2, 1, 0], 1e9)
    assert replace(runs, force_gradient=other).fingerprint != runs.fingerprint
    assert runs.subset(slice(10)).fingerprint == runs.fingerprint


def test_diagnostics_tell_coverage_worst_points_and_notes() -> None:
    found = diagnose(_emulator(), _runs()).leave_one_out
    assert found.field_coverage is not None and found.worst_points is not None
    assert len(found.force_coverage.by_step) == 5 and found.force_coverage.joint is not None
    errors = [point.error for point in found.worst_points]
    assert errors == sorted(errors, reverse=True) and errors[0] == found.field_max
    assert isinstance(diagnose(_emulator(), _runs()).notes, tuple)
