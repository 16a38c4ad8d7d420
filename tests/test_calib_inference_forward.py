"""EmulatorForward passes on what the fitted emulator says, in the coordinates of the inference."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from analytic_models import AnalyticBlock

from calib.inference import DirectForward, EmulatorForward
from calib.inference.forward import ForwardModel, GivenInputs, Jacobian
from calib.inference.mesh_correction import MeshCorrection
from surrogate import Emulator, ScaledEmulator, TrainingSet, sobol_design

POINTS = np.random.default_rng(4).random((9, 2)) * 3
BLOCK = AnalyticBlock(0.05, points=POINTS)
THETA = np.array([[0.02, 0.31, 0.12], [0.04, 0.77, 0.33], [0.03, 0.5, 0.02]])


@cache
def scaled() -> ScaledEmulator:
    ratios = sobol_design(24, np.array([[0.0, 1.0], [0.0, 0.5]]), 1)
    runs = [BLOCK(x) for x in ratios]
    training = TrainingSet(
        ratios=ratios,
        force=np.array([run.force for run in runs]),
        displacement=np.array([run.displacement for run in runs]),
        n_excluded=0,
    )
    return ScaledEmulator(Emulator.fit(training, 1, n_restarts=2))


def test_emulator_of_a_smooth_model_predicts_its_forces_and_fields() -> None:
    forward, direct = EmulatorForward(scaled(), with_field=True), DirectForward(BLOCK)
    found, exact = forward.predict(THETA), direct.predict(THETA)
    assert found.force == pytest.approx(exact.force, rel=5e-3)
    assert forward.field_basis is not None and found.weights is not None
    fields = forward.field_basis.fields(found.weights)
    for field, theta in zip(fields, THETA, strict=True):
        assert np.abs(field - BLOCK(theta[1:]).displacement).max() < 5e-3


def by_differences(forward: ForwardModel, h: float) -> Jacobian:
    """Central differences of the predictions at THETA by ln kappa, r and s."""
    found = []
    for i in range(3):
        sides = []
        for sign in (1, -1):
            theta = THETA.copy()
            theta[:, i] = theta[:, i] * np.exp(sign * h) if i == 0 else theta[:, i] + sign * h
            sides.append(forward.predict(theta))
        found.append(sides)
    force = [(up.force - down.force) / (2 * h) for up, down in found]
    weights = None
    if found[0][0].weights is not None:
        weights = np.stack([(up.weights - down.weights) / (2 * h) for up, down in found], axis=2)
    return Jacobian(np.stack(force, axis=2), weights)


@pytest.mark.parametrize("with_field", [False, True])
def test_jacobian_is_the_derivative_by_ln_kappa_r_s(with_field: bool) -> None:
    forward = EmulatorForward(scaled(), with_field=with_field)
    slope, expected = forward.jacobian(THETA), by_differences(forward, 1e-3)
    assert slope.force == pytest.approx(expected.force, rel=1e-3, abs=1e-4)
    assert (slope.weights is not None) is with_field
    if with_field:
        assert slope.weights == pytest.approx(expected.weights, rel=1e-3, abs=1e-4)


def test_a_mesh_correction_is_the_same_for_emulator_and_direct_model() -> None:
    rng = np.random.default_rng(6)
    shape = BLOCK(THETA[0, 1:]).displacement.shape
    correction = MeshCorrection(1.0 + 0.05 * rng.random(shape[0]), 0.01 * rng.random(shape))
    for make in (lambda **k: EmulatorForward(scaled(), **k), lambda **k: DirectForward(BLOCK, **k)):
        plain, corrected = make(with_field=True), make(with_field=True, correction=correction)
        before, after = plain.predict(THETA), corrected.predict(THETA)
        assert after.force == pytest.approx(before.force * correction.force, rel=1e-14)
        if before.force_covariance is not None:
            assert after.force_covariance is not None
            factor = np.outer(correction.force, correction.force)
            assert after.force_covariance == pytest.approx(before.force_covariance * factor)
        fields = [f.field_basis.fields(p.weights) for f, p in ((plain, before), (corrected, after))]
        assert fields[1] == pytest.approx(fields[0] + correction.field, abs=1e-15)
        slopes = [model.jacobian(THETA) for model in (plain, corrected)]
        by_force = slopes[0].force * correction.force[:, None]
        assert slopes[1].force == pytest.approx(by_force, rel=1e-13)
        assert slopes[1].weights == pytest.approx(slopes[0].weights)


def test_field_of_an_emulator_trained_on_forces_is_refused() -> None:
    ratios = sobol_design(12, np.array([[0.0, 1.0], [0.0, 0.5]]), 1)
    force = np.array([BLOCK(x).force for x in ratios])
    bare = TrainingSet(ratios=ratios, force=force, displacement=None, n_excluded=0)
    emulator = ScaledEmulator(Emulator.fit(bare, 1, n_restarts=1))
    assert EmulatorForward(emulator).field_basis is None
    with pytest.raises(ValueError, match="forces only"):
        EmulatorForward(emulator, with_field=True)


def test_given_inputs_are_those_of_the_whole_model_at_fixed_values() -> None:
    # s is given: the model is one of (kappa, r) alone.
    whole = EmulatorForward(scaled(), with_field=True)
    given = GivenInputs(whole, np.array([0.12]))
    theta = np.column_stack([THETA[:, :2], np.full(3, 0.12)])
    found, known = given.predict(THETA[:, :2]), whole.predict(theta)
    np.testing.assert_array_equal(found.force, known.force)
    np.testing.assert_array_equal(found.weights, known.weights)
    slope, exact = given.jacobian(THETA[:, :2]), whole.jacobian(theta)
    np.testing.assert_array_equal(slope.force, exact.force[..., :2])
    assert slope.weights is not None and exact.weights is not None
    np.testing.assert_array_equal(slope.weights, exact.weights[..., :2])
    assert given.field_basis is whole.field_basis


def test_runs_that_reached_the_end_are_told_in_the_order_of_solving() -> None:
    direct = DirectForward(BLOCK)
    direct.predict(THETA)
    np.testing.assert_array_equal(direct.solved, THETA[:, 1:])
