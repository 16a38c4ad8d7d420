"""The processes as a scikit-learn regressor."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.utils.estimator_checks import parametrize_with_checks

from surrogate import GaussianProcessModes, sobol_design

X = sobol_design(12, np.array([[0.0, 1.0], [0.0, 1.0]]), seed=1)
Y = np.stack([np.sin(3 * X[:, 0]) + X[:, 1], np.exp(X[:, 0] * X[:, 1])], axis=1)
NEW = np.random.default_rng(0).random((6, 2))


@parametrize_with_checks(
    [GaussianProcessModes(n_restarts=0, families=("matern52",), sharing="all")]
)
def test_it_keeps_scikit_learns_conventions(estimator: object, check: object) -> None:
    check(estimator)  # type: ignore[operator]


def test_standard_deviation_and_covariance_agree() -> None:
    model = GaussianProcessModes(n_restarts=0).fit(X, Y)
    mean, std = model.predict(NEW, return_std=True)
    again, joint = model.predict(NEW, return_cov=True)
    np.testing.assert_array_equal(mean, again)
    assert joint.shape == (6, 6, 2)
    np.testing.assert_allclose(np.sqrt(np.einsum("iik->ik", joint)), std, rtol=1e-12)
    assert np.linalg.eigvalsh(joint[:, :, 0]).min() > 0.0
    with pytest.raises(ValueError, match="return_std: cannot be asked for together"):
        model.predict(NEW, return_std=True, return_cov=True)


@pytest.mark.parametrize("constant", [0.1, 0.7, 1.1, 2.3])
@pytest.mark.parametrize("n", [5, 8, 14])
def test_an_output_that_does_not_vary_is_predicted_as_it_is(n: int, constant: float) -> None:
    """Also where the sum of its values, over their number, is not the constant to the last bit."""
    x = sobol_design(n, np.array([[0.0, 1.0], [0.0, 1.0]]), seed=1)
    y = np.stack([np.sin(3 * x[:, 0]) + x[:, 1], np.full(n, constant)], axis=1)
    model = GaussianProcessModes(n_restarts=0).fit(x, y)
    assert model.used_outputs_.tolist() == [True, False]
    mean, std = model.predict(NEW, return_std=True)
    assert mean[:, 1] == pytest.approx(constant, rel=1e-15) and not std[:, 1].any()


def test_derivatives_are_accepted_and_make_it_better() -> None:
    by_first = np.stack([3 * np.cos(3 * X[:, 0]), X[:, 1] * Y[:, 1]], axis=1)
    by_second = np.stack([np.ones(12), X[:, 0] * Y[:, 1]], axis=1)
    slopes = np.stack([by_first, by_second], axis=2)
    truth = np.stack([np.sin(3 * NEW[:, 0]) + NEW[:, 1], np.exp(NEW[:, 0] * NEW[:, 1])], axis=1)
    plain, better = GaussianProcessModes(n_restarts=0, families=("matern52",)), None
    better = clone(plain).fit(X, Y, slopes=slopes)
    error = np.abs(better.predict(NEW) - truth).max()
    assert error < 0.5 * np.abs(plain.fit(X, Y).predict(NEW) - truth).max()


def test_outputs_that_do_not_vary_are_predicted_as_they_are() -> None:
    model = GaussianProcessModes(n_restarts=0).fit(X, np.column_stack([Y[:, 0], np.full(12, 4.0)]))
    mean, std = model.predict(NEW, return_std=True)
    np.testing.assert_array_equal(mean[:, 1], 4.0)
    assert (std[:, 1] == 0.0).all() and (std[:, 0] > 0.0).all()


@pytest.mark.parametrize("shape", [(12, 2, 1), (12, 3, 2), (12, 2)])
def test_slopes_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"slopes: expected shape \(12, 2, 2\)"):
        GaussianProcessModes(n_restarts=0).fit(X, Y, slopes=np.zeros(shape))
