"""Scale symmetry: exact in kappa, and jacobians that are their derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from surrogate import Emulator, ScaledEmulator, TrainingSet, sobol_design

BOX = np.array([[0.0, 1.0], [0.0, 0.5]])


@pytest.fixture(scope="module")
def scaled() -> ScaledEmulator:
    x = sobol_design(14, BOX, seed=2)
    travel = np.array([0.6, 1.0, 1.4])
    noise = 0.02 * np.random.default_rng(0).normal(size=(14, 3))
    force = 40.0 * travel ** (1.5 + 0.4 * x[:, :1]) * np.exp(x[:, 1:] + noise)
    rows = np.sin(np.arange(1.0, 13.0) * (1.0 + 0.1 * x[:, :1] + 0.2 * x[:, 1:]))
    displacement = travel[:, None, None] * rows.reshape(14, 1, 4, 3)
    return ScaledEmulator(Emulator.fit(TrainingSet(x, force, displacement), 1, n_restarts=1))


def _theta(n: int = 20) -> np.ndarray:
    rng = np.random.default_rng(4)
    return np.column_stack([rng.uniform(0.005, 0.06, n), rng.uniform(BOX[:, 0], BOX[:, 1], (n, 2))])


@pytest.mark.lasting
@pytest.mark.parametrize("factor", [2.0, 0.25])
def test_force_is_proportional_and_its_covariance_quadratic_in_kappa_to_the_last_bit(
    scaled: ScaledEmulator, factor: float
) -> None:
    """Powers of two, so that the factor itself rounds nothing."""
    mean, covariance = scaled.force(_theta())
    other_mean, other_covariance = scaled.force(_theta() * [factor, 1.0, 1.0])
    np.testing.assert_array_equal(other_mean, factor * mean)
    np.testing.assert_array_equal(other_covariance, factor**2 * covariance)


def test_the_field_does_not_depend_on_kappa_at_all(scaled: ScaledEmulator) -> None:
    other = _theta() * [7.3, 1.0, 1.0]
    for a, b in zip(scaled.field_weights(_theta()), scaled.field_weights(other), strict=True):
        assert a.tobytes() == b.tobytes()
    assert not scaled.field_weights_jacobian(_theta())[:, :, 0].any()


def test_at_one_megapascal_the_force_is_that_of_the_emulator(scaled: ScaledEmulator) -> None:
    theta = _theta() * [0.0, 1.0, 1.0] + [1.0, 0.0, 0.0]
    mean, covariance = scaled.force(theta)
    expected, expected_covariance = scaled.emulator.unit_force(theta[:, 1:])
    np.testing.assert_array_equal(mean, expected)
    np.testing.assert_array_equal(covariance, expected_covariance)


def test_jacobians_are_the_limit_of_differences(scaled: ScaledEmulator) -> None:
    theta = _theta()
    force, field = scaled.force_jacobian(theta), scaled.field_weights_jacobian(theta)
    for axis, h in enumerate([1e-5, 1e-4, 1e-4]):
        step = h * np.eye(3)[axis]
        difference = (scaled.force(theta + step)[0] - scaled.force(theta - step)[0]) / (2.0 * h)
        np.testing.assert_allclose(force[:, :, axis], difference, rtol=1e-4, atol=1e-5)
        w = scaled.field_weights(theta + step)[0] - scaled.field_weights(theta - step)[0]
        np.testing.assert_allclose(field[:, :, axis], w / (2.0 * h), rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize(
    ("theta", "message"),
    [
        (np.ones(3), r"theta: expected shape \(m, 3\), got \(3,\)"),
        (np.ones((4, 2)), r"theta: expected shape \(m, 3\), got \(4, 2\)"),
        (np.array([[0.0, 0.5, 0.1]]), "theta: kappa must be positive"),
        (np.array([[1.0, 0.5, 0.1], [np.nan, 0.5, 0.1]]), "theta: kappa must be .* got nan"),
        (np.array([[np.inf, 0.5, 0.1]]), "theta: kappa must be positive and finite"),
    ],
)
def test_theta_that_is_none_is_refused(
    scaled: ScaledEmulator, theta: np.ndarray, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        scaled.force(theta)
