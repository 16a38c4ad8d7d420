"""The Gaussian processes behind scikit-learn's interface."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from surrogate.covariance import FAMILIES
from surrogate.gp import GaussianProcesses
from surrogate.gp_fit import Sharing, fit_processes

Array = npt.NDArray[np.float64]


class GaussianProcessModes(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Independent Gaussian processes of reduced coefficients, with derivatives where known.

    A scikit-learn regressor of y (n, k) over X (n, d); see `surrogate.gp_fit.fit_processes` for
    the parameters. Inputs and outputs that do not vary are accepted and predicted as constants.
    After `fit`, `processes_` holds the posterior (None when no output varies).
    """

    def __init__(
        self,
        *,
        families: tuple[str, ...] = FAMILIES,
        sharing: Sharing = "auto",
        n_restarts: int = 1,
        random_state: int = 0,
    ) -> None:
        self.families = families
        self.sharing = sharing
        self.n_restarts = n_restarts
        self.random_state = random_state

    def fit(self, X: Any, y: Any, slopes: Array | None = None) -> GaussianProcessModes:
        """Fit to y (n,) or (n, k) and to its derivatives `slopes` (n, k, d), if any.

        Raises ValueError for fewer than 3 runs (scikit-learn's "n_samples=1" among them) and for
        slopes of another shape.
        """
        X, y = validate_data(
            self, X, y, multi_output=True, y_numeric=True, dtype=np.float64, ensure_min_samples=3
        )
        outputs = np.asarray(y, dtype=np.float64).reshape(len(y), -1)
        self._flat = np.ndim(y) == 1
        self.used_inputs_ = np.ptp(X, axis=0) > 0.0
        # An SD of what is constant is one of rounding, that of numbers near the smallest is 0.
        self.used_outputs_ = (np.ptp(outputs, axis=0) > 0.0) & (outputs.std(axis=0) > 0.0)
        self.constant_ = outputs.mean(axis=0)
        self.processes_: GaussianProcesses | None = None
        if self.used_inputs_.any() and self.used_outputs_.any():
            known = None
            if slopes is not None:
                slopes = np.asarray(slopes, dtype=np.float64)
                if slopes.shape != (*outputs.shape, X.shape[1]):
                    raise ValueError(
                        f"slopes: expected shape {(*outputs.shape, X.shape[1])}, got {slopes.shape}"
                    )
                known = slopes[:, self.used_outputs_][:, :, self.used_inputs_]
            self.processes_ = fit_processes(
                X[:, self.used_inputs_],
                outputs[:, self.used_outputs_],
                self.random_state,
                slopes=known,
                n_restarts=self.n_restarts,
                sharing=self.sharing,
                families=tuple(self.families),
            )
        return self

    def predict(
        self, X: Any, return_std: bool = False, return_cov: bool = False
    ) -> Array | tuple[Array, Array]:
        """Mean (m,) or (m, k) of new runs at X (m, d).

        With `return_std` also their SD, of the mean's shape; with `return_cov` the covariance
        among the points, (m, m) or (m, m, k) as in scikit-learn's `GaussianProcessRegressor`.
        Raises ValueError when both are asked for.
        """
        check_is_fitted(self)
        X = validate_data(self, X, reset=False, dtype=np.float64)
        if return_std and return_cov:
            raise ValueError("return_std: cannot be asked for together with return_cov")
        m, k = len(X), len(self.constant_)
        mean = np.tile(self.constant_, (m, 1))
        std, joint = np.zeros((m, k)), np.zeros((m, m, k))
        if self.processes_ is not None:
            x = X[:, self.used_inputs_]
            mean[:, self.used_outputs_], variance = self.processes_.predict(x)
            std[:, self.used_outputs_] = np.sqrt(variance)
            if return_cov:
                joint[:, :, self.used_outputs_] = self._joint(self.processes_, x, variance)
        if self._flat:
            mean, std, joint = mean[:, 0], std[:, 0], joint[:, :, 0]
        if return_cov:
            return mean, joint
        return (mean, std) if return_std else mean

    @staticmethod
    def _joint(processes: GaussianProcesses, x: Array, variance: Array) -> Array:
        """(m, m, k) covariance with the noise of new runs on its diagonal."""
        joint = processes.covariance(x, x).transpose(1, 2, 0)
        joint[np.diag_indices(len(x))] = variance
        return joint
