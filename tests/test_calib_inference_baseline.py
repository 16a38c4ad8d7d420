"""The thesis' objective and its nine starts on a synthetic field with a known truth."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_models import AnalyticBlock, AnalyticForward

from calib.inference.baseline import FieldError, thesis_baseline, thesis_starts
from calib.inference.coordinates import theta_of_constants
from calib.inference.forward import DirectForward
from calib.optimize import METHODS, Settings

POINTS = np.random.default_rng(2).random((40, 2)) * [5.0, 2.5]
BLOCK = AnalyticBlock(points=POINTS)
FORWARD = AnalyticForward(BLOCK, field=True)
TRUTH = theta_of_constants(0.03, 0.02, 0.004)
CLEAN = BLOCK(TRUTH[1:]).displacement
NOISY = CLEAN + np.random.default_rng(3).normal(scale=0.003, size=CLEAN.shape)


def test_the_objective_is_equation_2_8() -> None:
    error = FieldError(FORWARD, NOISY)
    scaled = np.array([10.0, 2.0, 8.0])
    theta = theta_of_constants(0.010, 0.02, 0.0008)
    off = BLOCK(theta[1:]).displacement - NOISY
    by_hand = np.sqrt(off[..., 0] ** 2 + off[..., 1] ** 2 + off[..., 2] ** 2).mean()
    assert error(scaled) == pytest.approx(by_hand, rel=1e-12)
    hidden = NOISY.copy()
    hidden[:, 3] = np.nan
    assert FieldError(FORWARD, hidden)(scaled) == pytest.approx(
        np.delete(np.linalg.norm(off, axis=-1), 3, axis=1).mean(), rel=1e-12
    )


def test_exact_gradient_is_that_of_differences_and_orthogonal_to_the_ray() -> None:
    error = FieldError(FORWARD, NOISY)
    for scaled in np.random.default_rng(5).uniform(1.0, 20.0, size=(5, 3)):
        steps = 1e-6 * scaled
        numeric = [
            (error(scaled + step) - error(scaled - step)) / (2 * step.max())
            for step in np.diag(steps)
        ]
        assert error.gradient(scaled) == pytest.approx(numeric, rel=1e-5, abs=1e-9)
        assert abs(error.gradient(scaled) @ scaled) < 1e-12


def test_the_objective_cannot_see_kappa() -> None:
    error = FieldError(FORWARD, NOISY)
    scaled = np.array([10.0, 2.0, 8.0])
    assert error(7.0 * scaled) == pytest.approx(error(scaled), rel=1e-12)


def test_what_the_model_does_not_know_is_a_failure_of_the_solver() -> None:
    error = FieldError(FORWARD, NOISY)
    assert np.isnan(error(np.zeros(3)))
    assert np.isnan(error(np.array([1.0, 0.1, 100.0])))
    with pytest.raises(ValueError, match="forces only"):
        FieldError(AnalyticForward(BLOCK), NOISY)(np.ones(3))


def test_a_direct_model_gives_the_same_objective_and_its_failed_runs_are_failures() -> None:
    """A run that stopped early has displacements up to there: they are no field."""
    emulated = FieldError(FORWARD, NOISY)
    direct = FieldError(DirectForward(BLOCK, with_field=True), NOISY)
    scaled = np.array([10.0, 2.0, 8.0])
    assert direct(scaled) == pytest.approx(emulated(scaled), rel=1e-12)
    assert direct.gradient(scaled) == pytest.approx(emulated.gradient(scaled), rel=1e-9)
    fails = FieldError(
        DirectForward(AnalyticBlock(r_fails=0.3, points=POINTS), with_field=True), NOISY
    )
    assert np.isnan(fails(scaled)) and np.isnan(fails.gradient(scaled)).all()
    assert np.isfinite(fails(np.array([30.0, 0.5, 8.0])))


@pytest.mark.parametrize("method", METHODS)
def test_nine_starts_end_along_a_valley_at_one_error(method: str) -> None:
    settings = Settings(max_iterations=200)
    found = thesis_baseline(FORWARD, NOISY, exact=True, method=method, settings=settings)
    ratios = np.column_stack([found.result[:, 1], found.result[:, 2]]) / found.kappa[:, None]
    assert np.ptp(found.error) < 1e-3 * found.error.mean()
    assert np.abs(ratios - TRUTH[1:]).max() < 0.05
    assert found.kappa.max() > 2.5 * found.kappa.min()
    assert found.force[:, -1].max() > 2.5 * found.force[:, -1].min()


def test_with_the_settings_of_the_thesis_every_start_ends_with_a_status() -> None:
    found = thesis_baseline(FORWARD, NOISY)
    assert found.start[0] == pytest.approx([0.005, 0.1, 0.001])
    assert len(found.minima) == len(thesis_starts()) == 9
    assert all(minimum.n_iterations <= 15 for minimum in found.minima)
    before = [FieldError(FORWARD, NOISY)(start) for start in thesis_starts()]
    assert np.all(found.error <= before)
    assert np.all(found.result >= 0)


@pytest.mark.parametrize(("s", "known"), [(0.7, 1.0), (0.2, 0.25)])
def test_the_box_of_ratios_is_the_one_given(s: float, known: float) -> None:
    observed = BLOCK(np.array([0.4, s])).displacement
    box = ((0.0, 1.0), (0.0, known))
    settings = Settings(max_iterations=200)
    found = thesis_baseline(
        FORWARD, observed, exact=True, starts=[[20.0, 2.0, 20.0]], settings=settings, ratio_box=box
    )
    reached = theta_of_constants(*found.result[0])[1:]
    assert reached == pytest.approx([0.4, s], abs=0.01)


def test_a_start_that_the_model_does_not_know_has_no_error_and_no_force() -> None:
    starts = [[20.0, 2.0, 20.0], [1.0, 10.0, 20.0], [0.0, 0.0, 1.0]]
    box = ((0.0, 0.8), (0.0, 0.5))
    found = thesis_baseline(FORWARD, NOISY, exact=True, starts=starts, ratio_box=box)
    assert np.isfinite(found.error).tolist() == [True, False, False]
    assert np.isfinite(found.force).all(axis=1).tolist() == [True, False, False]
