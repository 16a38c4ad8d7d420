"""Gaussian processes: the algebra of scikit-learn, exact gradients and leave-one-out, coverage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

from surrogate.design import sobol_design
from surrogate.gp import GaussianProcesses, fit_processes, fit_regressor, from_regressors

BOX = np.array([[0.0, 1.0], [0.0, 0.5]])


def _runs(n: int = 20, noise: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    x = sobol_design(n, BOX, seed=4)
    y = np.stack(
        [np.sin(3 * x[:, 0]) + x[:, 1], np.exp(x[:, 0] * x[:, 1]), 5 + np.cos(4 * x[:, 1])], axis=1
    )
    return x, y + noise * np.random.default_rng(0).normal(size=y.shape)


def _known(x: np.ndarray, y: np.ndarray, length: list[float], nugget: float) -> GaussianProcesses:
    """Processes with given hyperparameters, amplitude 1, outputs taken as they are."""
    kernel = ConstantKernel(1.0) * Matern(length, nu=2.5) + WhiteKernel(nugget)
    regressors = [
        GaussianProcessRegressor(kernel, alpha=0.0, optimizer=None).fit(x, column) for column in y.T
    ]
    d, k = x.shape[1], y.shape[1]
    return from_regressors(
        regressors, low=np.zeros(d), span=np.ones(d), offset=np.zeros(k), scale=np.ones(k)
    )


@pytest.mark.parametrize("noise", [0.0, 1e-3, 0.05])
def test_prediction_is_that_of_scikit_learn(noise: float) -> None:
    """Mean to 1e-10, and SD to 1e-10 where the runs are noisy.

    For (nearly) exact runs the variance is a small difference of numbers as large as the
    amplitude, in either program, and agrees to 1e-13 of that: SD of 1e-4 then to some 1e-9.
    """
    x, y = _runs(noise=noise)
    unit, offset, scale = x / BOX[:, 1], y.mean(axis=0), y.std(axis=0)
    regressors = [
        fit_regressor(unit, column, 1, n_restarts=2) for column in ((y - offset) / scale).T
    ]
    processes = from_regressors(
        regressors, low=BOX[:, 0], span=BOX[:, 1], offset=offset, scale=scale
    )
    new = np.random.default_rng(1).uniform(-0.1, 1.1, (200, 2))
    mean, variance = processes.predict(new * BOX[:, 1])
    for column, regressor in enumerate(regressors):
        expected, std = regressor.predict(new, return_std=True)
        scaled = (mean[:, column] - offset[column]) / scale[column]
        np.testing.assert_allclose(scaled, expected, atol=1e-10, rtol=0.0)
        own = variance[:, column] / scale[column] ** 2
        rounding = 1e-13 * processes.amplitude[column]
        np.testing.assert_allclose(own, std**2, atol=rounding, rtol=0.0)
        if noise >= 0.05:
            np.testing.assert_allclose(np.sqrt(own), std, atol=1e-10, rtol=0.0)


def test_large_batches_are_predicted_as_small_ones() -> None:
    x, y = _runs()
    processes = fit_processes(x, y, seed=1, n_restarts=1)
    new = np.random.default_rng(1).uniform(size=(5000, 2)) * BOX[:, 1]
    mean, variance = processes.predict(new)
    some_mean, some_variance = processes.predict(new[4090:4100])
    np.testing.assert_allclose(mean[4090:4100], some_mean, atol=1e-9)
    np.testing.assert_allclose(variance[4090:4100], some_variance, atol=1e-12)


def test_the_gradient_is_the_limit_of_differences_at_second_order() -> None:
    x, y = _runs(noise=1e-3)
    processes = fit_processes(x, y, seed=1, n_restarts=2)
    new = np.random.default_rng(2).uniform(0.1, 0.4, (10, 2))
    gradient = processes.gradient(new)
    errors = []
    for step in (2e-3, 1e-3):
        differences = [
            (processes.predict(new + h)[0] - processes.predict(new - h)[0]) / (2.0 * step)
            for h in step * np.eye(2)
        ]
        errors.append(np.abs(np.stack(differences, axis=2) - gradient).max())
    assert errors[1] < 1e-3 * np.abs(gradient).max()
    assert 3.0 < errors[0] / errors[1] < 5.0


def test_the_gradient_is_finite_at_a_training_point() -> None:
    x, y = _runs()
    processes = fit_processes(x, y, seed=1, n_restarts=1)
    step = np.array([1e-5, 0.0])
    difference = (processes.predict(x + step)[0] - processes.predict(x - step)[0]) / 2e-5
    np.testing.assert_allclose(processes.gradient(x)[:, :, 0], difference, atol=1e-4)


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_leave_one_out_is_prediction_from_the_other_runs(noise: float) -> None:
    x, y = _runs(noise=noise)
    unit = x / BOX[:, 1]
    processes = replace(_known(unit, y, [0.6, 0.9], 1e-4), inflation=np.full(3, 1.4))
    mean, variance = processes.leave_one_out()
    for run in range(len(x)):
        others = _known(np.delete(unit, run, 0), np.delete(y, run, 0), [0.6, 0.9], 1e-4)
        expected, expected_variance = others.predict(unit[run : run + 1])
        np.testing.assert_allclose(mean[run], expected[0], atol=1e-10)
        np.testing.assert_allclose(variance[run], 1.4 * expected_variance[0], rtol=1e-9)


def test_inflation_multiplies_the_variance_and_leaves_the_mean() -> None:
    x, y = _runs()
    known = _known(x, y, [0.6, 0.9], 1e-4)
    wide = replace(known, inflation=np.array([1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(known.predict(x + 0.01)[0], wide.predict(x + 0.01)[0])
    share = wide.predict(x + 0.01)[1] / known.predict(x + 0.01)[1]
    np.testing.assert_allclose(share, np.broadcast_to([1.0, 2.0, 3.0], share.shape), rtol=1e-12)


def test_the_fit_depends_on_the_seed_alone_and_columns_do_not_disturb_each_other() -> None:
    x, y = _runs(noise=0.02)
    first = fit_processes(x, y, seed=7, n_restarts=2)
    assert first.alpha.tobytes() == fit_processes(x, y, seed=7, n_restarts=2).alpha.tobytes()
    alone = fit_processes(x, y[:, :1], seed=7, n_restarts=2)
    assert alone.alpha[0].tobytes() == first.alpha[0].tobytes()


def test_noise_of_some_per_cent_is_found_and_not_interpolated() -> None:
    """SD of the noise from 60 runs; its relative standard error is about 0.1, bounds at 4."""
    x, y = _runs(60, noise=0.05)
    processes = fit_processes(x, y, seed=1, n_restarts=3)
    noise = np.sqrt(processes.nugget) * processes.scale
    assert ((noise > 0.03) & (noise < 0.07)).all()


def test_shifted_and_scaled_outputs_give_shifted_and_scaled_predictions() -> None:
    x, y = _runs(noise=0.02)
    mean, variance = fit_processes(x, y, seed=1, n_restarts=2).predict(x[:5] + 0.01)
    other = fit_processes(10.0 * x, 100.0 + 1e-3 * y, seed=1, n_restarts=2)
    new_mean, new_variance = other.predict(10.0 * (x[:5] + 0.01))
    np.testing.assert_allclose((new_mean - 100.0) * 1e3, mean, atol=1e-4)
    np.testing.assert_allclose(new_variance * 1e6, variance, rtol=1e-2)


def _draw(seed: int, noise: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (30, 2), a draw of a process there with noise, and its lengths."""
    rng = np.random.default_rng(seed)
    x = sobol_design(30, np.array([[0.0, 1.0], [0.0, 1.0]]), seed)
    length = rng.uniform(0.5, 1.5, 2)
    covariance = (1.0 * Matern(length, nu=2.5))(x) + (1e-9 + noise**2) * np.eye(30)
    return x, np.linalg.cholesky(covariance) @ rng.normal(size=30), length


def test_standardised_residuals_are_normal_when_hyperparameters_are_known() -> None:
    """200 draws, one new run each: the sum of z^2 is chi-square; false-alarm rate 1e-4."""
    z = []
    for seed in range(200):
        x, y, length = _draw(seed, noise=0.05)
        processes = _known(x[:20], y[:20, None], list(length), 0.05**2 + 1e-9)
        mean, variance = processes.predict(x[20:21])
        z.append((y[20] - mean[0, 0]) / np.sqrt(variance[0, 0]))
    low, high = chi2.ppf([5e-5, 1.0 - 5e-5], 200)
    assert low < np.sum(np.square(z)) < high


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_most_residuals_are_covered_when_hyperparameters_are_fitted_to_20_runs(
    noise: float,
) -> None:
    """Central 95 % intervals cover 92 % (exact data) and 87 % (noisy) of new runs, not 95 %.

    That is what maximum likelihood leaves of it with 20 runs, after the inflation (without it
    89 and 82 %, over 80 draws): the held-out z of a study is to be looked at. With 40 draws of
    10 runs the standard error is 0.025, so the bound has a false-alarm rate of about 1e-4.
    """
    covered = []
    for seed in range(40):
        x, y, _ = _draw(seed, noise)
        processes = fit_processes(x[:20], y[:20, None], seed, n_restarts=2)
        mean, variance = processes.predict(x[20:])
        covered.append(np.abs(y[20:] - mean[:, 0]) < 1.96 * np.sqrt(variance[:, 0]))
    assert 0.77 < np.mean(covered) < 0.99


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        (np.ones((2, 2)), np.ones((2, 1)), "x: need at least 3 runs"),
        (np.array([[0.0, 1], [1, 1], [2, 1]]), np.arange(3.0)[:, None], "vary in every input"),
        (np.eye(3), np.ones((3, 2)), "y: column 0 is constant"),
    ],
)
def test_runs_that_teach_nothing_are_refused(x: np.ndarray, y: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        fit_processes(x, y, seed=0)


def test_arrays_of_another_shape_are_refused() -> None:
    x, y = _runs()
    with pytest.raises(ValueError, match=r"length: expected shape \(3, 2\)"):
        replace(_known(x, y, [1.0, 1.0], 1e-4), length=np.ones(3))
