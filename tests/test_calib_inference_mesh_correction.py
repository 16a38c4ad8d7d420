"""A correction to a finer mesh: first order in the inputs, alike for emulator and direct model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from analytic_models import AnalyticBlock
from test_calib_inference_forward import BLOCK, THETA, by_differences, scaled

from calib.inference import DirectForward, EmulatorForward
from calib.inference.mesh_correction import CorrectionSlopes, MeshCorrection
from fe.response import Array, Response

PLACE = np.array([0.4, 0.2])
REACH = np.array([0.3, 0.2])
N_STEP, N_POINT = BLOCK(PLACE).displacement.shape[:2]


def correction() -> MeshCorrection:
    rng = np.random.default_rng(6)
    return MeshCorrection(
        1.0 + 0.05 * rng.random(N_STEP),
        0.01 * rng.random((N_STEP, N_POINT, 3)),
        CorrectionSlopes(PLACE, REACH, 0.02 * rng.random((N_STEP, N_POINT, 3, 2))),
    )


def finer(ratios: Array) -> Response:
    """What the correction makes of the block, written out."""
    found, known = BLOCK(ratios), correction()
    assert known.slopes is not None
    away = REACH * np.tanh((ratios - PLACE) / REACH)
    return replace(
        found,
        force=found.force * known.force,
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
    # What the correction changes by is known: no variance in any direction of its own.
    assert after.weight_variance is not None and before.weight_variance is not None
    k = before.weights.shape[1]
    np.testing.assert_array_equal(after.weight_variance[:, :k], before.weight_variance)
    np.testing.assert_array_equal(after.weight_variance[:, k:], 0.0)


def test_the_correction_stays_as_it_is_beyond_its_reach() -> None:
    known = correction()
    far = known.away(PLACE + np.array([[20.0, -20.0]]) * REACH)
    assert far[0] == pytest.approx(REACH * np.array([[1.0, -1.0]]))
    assert np.abs(far[1]).max() < 1e-12
    near = known.away(PLACE + 1e-3 * REACH[None])
    assert near[0] == pytest.approx(1e-3 * REACH[None], rel=1e-6)


@pytest.mark.parametrize("slopes", ["none", "one", "of the modes", "alike"])
def test_no_mode_is_zero_or_a_sum_of_others(slopes: str) -> None:
    """Of a population with such modes the weights of single samples were not to be had."""
    plain = EmulatorForward(scaled(), with_field=True)
    assert plain.field_basis is not None and plain.field_basis.modes is not None
    modes, known = plain.field_basis.modes, correction()
    assert known.slopes is not None
    rough = known.slopes.field[..., 0]
    by_input = {
        "none": [0.0 * rough, 0.0 * rough],
        "one": [rough, 0.0 * rough],
        "of the modes": [0.1 * modes[0] - 0.3 * modes[1], 0.2 * modes[1]],
        "alike": [rough, -2.0 * rough],
    }[slopes]
    field = np.stack(by_input, axis=-1)
    changed = replace(known, slopes=CorrectionSlopes(PLACE, REACH, field))
    forward = EmulatorForward(scaled(), with_field=True, correction=changed)
    basis, found = forward.field_basis, forward.predict(THETA)
    assert basis is not None and basis.modes is not None and found.weights is not None
    assert len(basis.modes) == len(modes) + (slopes in ("one", "alike"))
    flat = basis.modes.reshape(len(basis.modes), -1)
    scaled_modes = flat / np.linalg.norm(flat, axis=1)[:, None]
    assert np.linalg.svd(scaled_modes, compute_uv=False).min() > 0.1
    away = known.away(THETA[:, 1:])[0]
    plain_fields = plain.field_basis.fields(plain.predict(THETA).weights)
    expected = plain_fields + known.field + np.einsum("md,ipxd->mipx", away, field)
    assert basis.fields(found.weights) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("kind", ["emulator", "direct"])
def test_derivatives_are_those_of_the_corrected_predictions(kind: str) -> None:
    forward = (
        EmulatorForward(scaled(), with_field=True, correction=correction())
        if kind == "emulator"
        else DirectForward(BLOCK, with_field=True, correction=correction())
    )
    slope, expected = forward.jacobian(THETA), by_differences(forward, 1e-4)
    assert slope.force == pytest.approx(expected.force, rel=1e-5, abs=1e-7)
    assert slope.weights == pytest.approx(expected.weights, rel=1e-5, abs=1e-6)


def test_a_run_that_ended_early_stays_one() -> None:
    block = AnalyticBlock(0.05, points=BLOCK.points, r_fails=0.5)
    found = DirectForward(block, correction=correction()).predict(THETA)
    assert np.isnan(found.force[1]).any()  # r = 0.77
    assert np.isfinite(found.force[[0, 2]]).all()
