"""POD: orthonormal modes, the stated truncation, and an honest covariance of what is left out."""

from __future__ import annotations

import numpy as np
import pytest

from surrogate.pod import fit_pod


def _snapshots(rng: np.random.Generator, n: int, decay: float, n_obs: int = 60) -> np.ndarray:
    """Rows 1 + sum of 12 fixed orthonormal modes with independent weights of SD decay^j."""
    basis = np.linalg.qr(np.random.default_rng(99).normal(size=(n_obs, 12)))[0]
    return 1.0 + (rng.normal(size=(n, 12)) * decay ** np.arange(12)) @ basis.T


def test_modes_are_orthonormal_and_strongest_first() -> None:
    y = _snapshots(np.random.default_rng(0), 20, 0.5)
    pod = fit_pod(y, tolerance=0.0, max_modes=6)
    np.testing.assert_allclose(pod.modes.T @ pod.modes, np.eye(6), atol=1e-12)
    assert (np.diff(pod.weights(y).std(axis=0)) < 0.0).all()


def test_all_modes_give_every_snapshot_back() -> None:
    y = _snapshots(np.random.default_rng(0), 20, 0.5)
    pod = fit_pod(y, tolerance=0.0, max_modes=60)
    assert pod.modes.shape[1] == 12
    np.testing.assert_allclose(pod.reconstruct(pod.weights(y)), y, atol=1e-12)


@pytest.mark.parametrize("tolerance", [0.3, 1e-1, 1e-2, 1e-3])
def test_the_fewest_modes_within_the_tolerance_are_kept(tolerance: float) -> None:
    y = _snapshots(np.random.default_rng(1), 24, 0.4)
    spread = np.linalg.norm(y - y.mean(axis=0))

    def share(k: int) -> float:
        pod = fit_pod(y, tolerance=0.0, max_modes=k)
        return float(np.linalg.norm(y - pod.reconstruct(pod.weights(y))) / spread)

    k = fit_pod(y, tolerance=tolerance, max_modes=12).modes.shape[1]
    assert share(k) <= tolerance < share(k - 1)


def test_never_more_than_the_largest_number_of_modes_is_kept() -> None:
    y = _snapshots(np.random.default_rng(1), 24, 0.9)
    assert fit_pod(y, tolerance=1e-3, max_modes=5).modes.shape[1] == 5


def test_the_truncation_of_a_run_is_its_residual_on_modes_fitted_without_it() -> None:
    y = _snapshots(np.random.default_rng(2), 15, 0.7)
    pod = fit_pod(y, tolerance=0.0, max_modes=4)
    for run in range(15):
        other = fit_pod(np.delete(y, run, axis=0), tolerance=0.0, max_modes=4)
        left_out = y[run] - other.reconstruct(other.weights(y[run : run + 1]))[0]
        np.testing.assert_allclose(pod.truncation[run], left_out, atol=1e-12)


def test_the_truncation_covariance_is_that_of_its_factor() -> None:
    y = _snapshots(np.random.default_rng(2), 15, 0.7)
    pod = fit_pod(y, tolerance=0.0, max_modes=4)
    covariance = pod.truncation_factor @ pod.truncation_factor.T
    np.testing.assert_allclose(covariance, pod.truncation.T @ pod.truncation / 15, atol=1e-15)
    np.testing.assert_allclose(np.diag(covariance), pod.truncation_variance, rtol=1e-12)


def test_the_truncation_covariance_holds_what_new_runs_are_left_with() -> None:
    """Mean squared residual of new runs over its estimate: 1.02 +- 0.04 over 60 sets.

    The bounds are four standard errors away, a false-alarm rate of about 1e-4. A basis judged
    on its own snapshots gives 2.5.
    """
    ratios, naive = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        y, new = _snapshots(rng, 20, 0.8), _snapshots(rng, 500, 0.8)
        pod = fit_pod(y, tolerance=0.0, max_modes=5)
        measured = np.mean((new - pod.reconstruct(pod.weights(new))) ** 2)
        ratios.append(measured / pod.truncation_variance.mean())
        naive.append(measured / np.mean((y - pod.reconstruct(pod.weights(y))) ** 2))
    assert 0.85 < np.mean(ratios) < 1.2
    assert np.mean(naive) > 1.4


def test_a_full_basis_leaves_nothing_out() -> None:
    y = np.random.default_rng(0).normal(size=(24, 5))
    pod = fit_pod(y, tolerance=0.0, max_modes=12)
    assert pod.modes.shape == (5, 5)
    assert not pod.truncation.any()


def test_fewer_runs_than_observations_leave_something_out_even_with_all_modes() -> None:
    y = np.random.default_rng(0).normal(size=(4, 5))
    pod = fit_pod(y, tolerance=0.0, max_modes=12)
    assert pod.modes.shape == (5, 3)
    assert pod.truncation_variance.mean() > 0.01


def test_the_largest_entry_of_each_mode_is_positive() -> None:
    modes = fit_pod(_snapshots(np.random.default_rng(3), 9, 0.6), tolerance=0.0, max_modes=6).modes
    assert (modes[np.argmax(np.abs(modes), axis=0), np.arange(6)] > 0.0).all()


@pytest.mark.parametrize("y", [np.ones((1, 5)), np.ones((4, 5))])
def test_snapshots_that_do_not_vary_are_refused(y: np.ndarray) -> None:
    with pytest.raises(ValueError, match="snapshots: "):
        fit_pod(y, tolerance=0.0, max_modes=3)


def test_runs_without_weight_do_not_count_in_the_truncation() -> None:
    y = _snapshots(np.random.default_rng(2), 15, 0.7)
    weight = np.where(np.arange(15) < 4, 0.0, 2.0)
    pod = fit_pod(y, tolerance=0.0, max_modes=4, weight=weight)
    covariance = pod.truncation_factor @ pod.truncation_factor.T
    expected = pod.truncation[4:].T @ pod.truncation[4:] / 11
    np.testing.assert_allclose(covariance, expected, atol=1e-15)
    np.testing.assert_allclose(np.diag(covariance), pod.truncation_variance, rtol=1e-12)
    np.testing.assert_allclose(pod.left_out_variance, np.mean(pod.truncation**2, axis=0))


def test_with_a_scale_weights_are_least_squares_over_it() -> None:
    y = _snapshots(np.random.default_rng(4), 20, 0.7)
    scale = np.random.default_rng(5).uniform(0.1, 10.0, y.shape[1])
    pod = fit_pod(y, tolerance=0.0, max_modes=4, scale=scale)
    unit = pod.modes / scale[:, None]
    np.testing.assert_allclose(unit.T @ unit, np.eye(4), atol=1e-12)
    solved = np.linalg.lstsq(unit, ((y - pod.offset) / scale).T, rcond=None)[0].T
    np.testing.assert_allclose(pod.weights(y), solved, atol=1e-10)


def test_with_a_scale_the_truncation_is_in_the_unit_of_the_snapshots() -> None:
    y = _snapshots(np.random.default_rng(2), 15, 0.7)
    scale = np.random.default_rng(5).uniform(0.5, 2.0, y.shape[1])
    pod = fit_pod(y, tolerance=0.0, max_modes=4, scale=scale)
    other = fit_pod(np.delete(y, 3, axis=0), tolerance=0.0, max_modes=4, scale=scale)
    left_out = y[3] - other.reconstruct(other.weights(y[3:4]))[0]
    np.testing.assert_allclose(pod.truncation[3], left_out, atol=1e-12)
