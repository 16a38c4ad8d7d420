"""Hyperparameters of processes of values alone, searched by scikit-learn's regressor."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, WhiteKernel

from surrogate.evidence import (
    LENGTH_BOUNDS,
    NUGGET_BOUNDS,
    ROUGHNESS_BOUNDS,
    Fitted,
    Hyperparameters,
)

Array = npt.NDArray[np.float64]

AMPLITUDE_BOUNDS = (1e-2, 1e4)
"""variance of a process over that of its outputs"""
_MATERN_NU = {"matern32": 1.5, "matern52": 2.5}


class _Search:
    """Scikit-learn's search, which keeps what it found from its first start, or knows it already.

    The first start is the same for all fits of the same outputs and family; the others are random.
    """

    def __init__(self, known: tuple[Array, float] | None = None) -> None:
        self.known = known
        self.first: tuple[Array, float] | None = None

    def __call__(
        self, negative: Callable[[Array], Any], start: Array, bounds: Any
    ) -> tuple[Array, float]:
        found = self.known if self.first is None else None
        if found is None:
            result = minimize(negative, start, method="L-BFGS-B", jac=True, bounds=bounds)
            found = result.x, float(result.fun)
        if self.first is None:
            self.first = found
        return found


def fit_regressor(
    x: Array,
    y: Array,
    seed: int,
    family: str,
    *,
    n_restarts: int,
    begun: GaussianProcessRegressor | None = None,
) -> GaussianProcessRegressor:
    """Scikit-learn's regressor of scaled outputs y (n, k) over inputs x (n, d) of the unit box.

    `begun` is one without restarts of the same outputs and family, whose search is not made again.
    """
    lengths = np.full(x.shape[1], 1.0)
    shape = RBF(lengths, LENGTH_BOUNDS)
    if family in _MATERN_NU:
        shape = Matern(lengths, LENGTH_BOUNDS, nu=_MATERN_NU[family])
    noise = WhiteKernel(1e-4, (NUGGET_BOUNDS[0], 2.0))
    regressor = GaussianProcessRegressor(
        ConstantKernel(1.0, AMPLITUDE_BOUNDS) * shape + noise,
        alpha=0.0,
        optimizer=_Search(None if begun is None else begun.optimizer.first),
        n_restarts_optimizer=n_restarts,
        random_state=seed,
    )
    with warnings.catch_warnings():
        # A nugget at its lower bound (exact data) or a length at its upper bound (an input
        # without influence) is an answer, not a failure; `at_bounds` tells it.
        warnings.simplefilter("ignore", ConvergenceWarning)
        regressor.fit(x, y)
    return regressor


def from_regressor(regressor: GaussianProcessRegressor, family: int) -> Fitted:
    """Hyperparameters at unit amplitude of a fitted regressor of `fit_regressor`."""
    kernel = regressor.kernel_
    amplitude, shape = kernel.k1.k1.constant_value, kernel.k1.k2
    length = np.array(np.broadcast_to(shape.length_scale, regressor.X_train_.shape[1]), dtype=float)
    nugget = max(kernel.k2.noise_level / amplitude, NUGGET_BOUNDS[0])
    parameters = Hyperparameters(length, ROUGHNESS_BOUNDS[0])  # there are no derivatives
    n = len(regressor.X_train_)
    value = float(regressor.log_marginal_likelihood_value_)
    return Fitted(family, parameters, np.array([nugget]), value, np.arange(n), n)
