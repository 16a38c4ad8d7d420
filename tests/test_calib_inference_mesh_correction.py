"""A correction to a finer mesh: first order in the inputs, alike for emulator and direct model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_models import AnalyticBlock
from test_calib_inference_forward import BLOCK, THETA, scaled

from calib.inference import DirectForward, EmulatorForward
from calib.inference.mesh_correction import CorrectionSlopes, MeshCorrection
from fe.response import Array, Response

PLACE = np.array([0.4, 0.2])
N_STEP, N_POINT = BLOCK(PLACE).displacement.shape[:2]


def correction() -> MeshCorrection:
    rng = np.random.default_rng(6)
    return MeshCorrection(
        1.0 + 0.05 * rng.random(N_STEP),
        0.01 * rng.random((N_STEP, N_POINT, 3)),
        CorrectionSlopes(
            PLACE, 0.1 * rng.random((N_STEP, 2)), 0.02 * rng.random((N_STEP, N_POINT, 3, 2))
        ),
    )


def finer(ratios: Array) -> Response:
    """What the correction makes of the block, written out."""
    found, known = BLOCK(ratios), correction()
    assert known.slopes is not None
    away = ratios - PLACE
    return replace(
        found,
        force=found.force * known.force * np.exp(known.slopes.log_force @ away),
        displacement=found.displacement + known.field + known.slopes.field @ away,
    )


def test_the_direct_model_predicts_what_the_finer_mesh_does() -> None:
    direct = DirectForward(BLOCK, with_field=True, correction=correction())
    found = direct.predict(THETA)
    for row, theta in enumerate(THETA):
        expected = finer(theta[1:])
        assert found.force[row] == pytest.approx(theta[0] * expected.force, rel=1e-13)
        assert found.weights is not None
        assert found.weights[row] == pytest.approx(expected.displacement.ravel(), abs=1e-15)


def test_the_emulator_is_corrected_as_the_direct_model_is() -> None:
    plain = EmulatorForward(scaled(), with_field=True)
    forward = EmulatorForward(scaled(), with_field=True, correction=correction())
    before, after = plain.predict(THETA), forward.predict(THETA)
    factor = np.array([finer(x).force / BLOCK(x).force for x in THETA[:, 1:]])
    added = np.array([finer(x).displacement - BLOCK(x).displacement for x in THETA[:, 1:]])
    assert after.force == pytest.approx(before.force * factor, rel=1e-13)
    assert after.force_covariance is not None and before.force_covariance is not None
    by_both = factor[:, :, None] * factor[:, None, :]
    assert after.force_covariance == pytest.approx(before.force_covariance * by_both)
    assert after.weights is not None and before.weights is not None
    assert forward.field_basis is not None and plain.field_basis is not None
    fields = forward.field_basis.fields(after.weights)
    assert fields == pytest.approx(plain.field_basis.fields(before.weights) + added, abs=1e-14)
    # What the correction changes by is known: no variance, in any direction.
    assert after.weight_variance is not None and before.weight_variance is not None
    k = before.weights.shape[1]
    np.testing.assert_array_equal(after.weight_variance[:, :k], before.weight_variance)
    np.testing.assert_array_equal(after.weight_variance[:, k:], 0.0)


@pytest.mark.parametrize("kind", ["emulator", "direct"])
def test_derivatives_are_those_of_the_corrected_predictions(kind: str) -> None:
    forward = (
        EmulatorForward(scaled(), with_field=True, correction=correction())
        if kind == "emulator"
        else DirectForward(BLOCK, with_field=True, correction=correction())
    )
    slope, h = forward.jacobian(THETA), 1e-4
    assert slope.weights is not None
    for i in range(3):
        sides = []
        for sign in (1, -1):
            theta = THETA.copy()
            theta[:, i] = theta[:, i] * np.exp(sign * h) if i == 0 else theta[:, i] + sign * h
            sides.append(forward.predict(theta))
        by_force = (sides[0].force - sides[1].force) / (2 * h)
        assert slope.force[:, :, i] == pytest.approx(by_force, rel=1e-5, abs=1e-7)
        assert sides[0].weights is not None and sides[1].weights is not None
        by_weights = (sides[0].weights - sides[1].weights) / (2 * h)
        assert slope.weights[:, :, i] == pytest.approx(by_weights, rel=1e-5, abs=1e-6)


def test_a_run_that_ended_early_stays_one() -> None:
    block = AnalyticBlock(0.05, points=BLOCK.points, r_fails=0.5)
    found = DirectForward(block, correction=correction()).predict(THETA)
    assert np.isnan(found.force[1]).any()  # r = 0.77
    assert np.isfinite(found.force[[0, 2]]).all()
