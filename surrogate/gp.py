"""Independent Gaussian processes over the same inputs: fitted one by one, evaluated together."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_triangular
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

Array = npt.NDArray[np.float64]

AMPLITUDE_BOUNDS = (1e-2, 1e2)
"""Variance of a process over that of its outputs; more would only add rounding to exact data"""
LENGTH_BOUNDS = (0.05, 20.0)
NUGGET_BOUNDS = (1e-10, 2.0)
"""Nugget, as a share of the variance of the outputs: from exact data to nothing but noise."""

_CHUNK = 4096


@dataclass(frozen=True)
class GaussianProcesses:
    """k posterior processes with a Matern-5/2 covariance, one length for each input, and a nugget.

    Inputs are scaled to the unit box of the training points, outputs to mean 0 and variance 1.
    The predicted variance holds the nugget: it is that of a new run, numerical noise included.
    It is that of the fitted process times `inflation`, which stands for the hyperparameters
    having been estimated from the same few runs (see `fit_processes`).
    """

    low: Array
    """(d,) lowest training input"""
    span: Array
    """(d,) extent of the training inputs"""
    inputs: Array
    """(n, d) training inputs in the unit box"""
    offset: Array
    """(k,) mean of the training outputs"""
    scale: Array
    """(k,) standard deviation of the training outputs"""
    targets: Array
    """(k, n) scaled training outputs"""
    amplitude: Array
    """(k,) variance of each process, scaled outputs"""
    length: Array
    """(k, d) correlation lengths, unit box"""
    nugget: Array
    """(k,) noise variance, scaled outputs"""
    alpha: Array
    """(k, n) inverse covariance times targets"""
    cholesky: Array
    """(k, n, n) lower Cholesky factor of the training covariance"""
    inflation: Array
    """(k,) factor of the predicted variance, 1 for known hyperparameters"""

    def __post_init__(self) -> None:
        n, d, k = *self.inputs.shape, len(self.offset)
        shapes = {
            **dict.fromkeys(("low", "span"), (d,)),
            **dict.fromkeys(("offset", "scale", "amplitude", "nugget", "inflation"), (k,)),
            **dict.fromkeys(("targets", "alpha"), (k, n)),
            "length": (k, d),
            "cholesky": (k, n, n),
        }
        for name, shape in shapes.items():
            found = getattr(self, name).shape
            if found != shape:
                raise ValueError(f"{name}: expected shape {shape}, got {found}")

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Mean (m, k) and variance (m, k) of new runs at inputs x (m, d), in output units."""
        if len(x) <= _CHUNK:
            return self._predict(x)
        parts = [self._predict(x[i : i + _CHUNK]) for i in range(0, len(x), _CHUNK)]
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])

    def gradient(self, x: Array) -> Array:
        """(m, k, d) derivative of the mean by the inputs at x (m, d), in output per input units."""
        distance = self._distance(x)
        slope = (1.0 + distance) * np.exp(-distance) * self._weights[:, None, :]
        difference = self._scaled(x)[:, None, :] - self.inputs
        summed = np.einsum("kmn,mnd->mkd", slope, difference)
        factor = -5.0 / 3.0 * self.scale[:, None] / self.length**2 / self.span
        gradient: Array = summed * factor
        return gradient

    def leave_one_out(self) -> tuple[Array, Array]:
        """Mean (n, k) and variance (n, k) at each training input given the other runs only.

        Closed form with the hyperparameters held (Rasmussen & Williams 2006, eqs 5.10-5.12).
        """
        precision = np.sum(self._inverse_factor**2, axis=1)
        mean = self.targets - self.alpha / precision
        variance = self._variance_scale[:, None] / precision
        return (self.offset[:, None] + self.scale[:, None] * mean).T, variance.T

    def _predict(self, x: Array) -> tuple[Array, Array]:
        q = self._distance(x)
        correlation = np.exp(-q)
        polynomial = q / 3.0
        polynomial += 1.0
        polynomial *= q
        polynomial += 1.0
        correlation *= polynomial
        mean = np.matmul(correlation, self._weights[:, :, None])[:, :, 0]
        explained = np.matmul(correlation, self._explaining)
        rest = self.amplitude[:, None] - np.einsum("kmn,kmn->km", explained, explained)
        # Rounding may take the rest below its least value, zero, near the training points.
        variance = np.maximum(rest, 0.0) + self.nugget[:, None]
        variance *= self._variance_scale[:, None]
        return (self.offset[:, None] + self.scale[:, None] * mean).T, variance.T

    def _scaled(self, x: Array) -> Array:
        scaled: Array = (x - self.low) / self.span
        return scaled

    def _distance(self, x: Array) -> Array:
        """(k, m, n) sqrt(5) times the scaled distance from x to each training input."""
        # Differences first: the expanded square would cancel next to the training points.
        difference = self._scaled(x).T[:, :, None] - self.inputs.T[:, None, :]
        difference *= difference
        squared = self._inverse_square_length @ difference.reshape(len(difference), -1)
        np.sqrt(squared, out=squared)
        return squared.reshape(len(self.offset), len(x), len(self.inputs))

    @cached_property
    def _inverse_square_length(self) -> Array:
        scaled: Array = 5.0 / self.length**2
        return scaled

    @cached_property
    def _variance_scale(self) -> Array:
        scale: Array = self.inflation * self.scale**2
        return scale

    @cached_property
    def _weights(self) -> Array:
        weights: Array = self.amplitude[:, None] * self.alpha
        return weights

    @cached_property
    def _inverse_factor(self) -> Array:
        """(k, n, n) inverse of the lower Cholesky factors."""
        identity = np.eye(len(self.inputs))
        return np.array([solve_triangular(c, identity, lower=True) for c in self.cholesky])

    @cached_property
    def _explaining(self) -> Array:
        explaining: Array = self.amplitude[:, None, None] * self._inverse_factor.transpose(0, 2, 1)
        return np.ascontiguousarray(explaining)


def fit_processes(x: Array, y: Array, seed: int, *, n_restarts: int = 6) -> GaussianProcesses:
    """Fit one process to each column of y (n, k) over x (n, d) by maximum marginal likelihood.

    Each process starts its optimiser from a fixed point and `n_restarts` points drawn with its
    own seed, spawned from `seed`, so it does not depend on the other columns. Maximum likelihood
    takes a variance too small, as in regression, so variances are inflated by n / (n - p) with
    the p = d + 3 fitted numbers of a process: mean, amplitude, lengths and nugget.
    Raises ValueError for fewer than 3 runs, inputs that do not vary, or constant outputs.
    """
    low, span = x.min(axis=0), np.ptp(x, axis=0)
    outputs = np.ascontiguousarray(y.T)  # rows are summed alike however many there are
    offset, scale = outputs.mean(axis=1), outputs.std(axis=1)
    if len(x) < 3 or not (span > 0.0).all():
        raise ValueError(f"x: need at least 3 runs that vary in every input, got {x.shape}")
    if not (scale > 0.0).all():
        raise ValueError(f"y: column {int(np.argmin(scale))} is constant; leave it out")
    unit = (x - low) / span
    targets = (outputs - offset[:, None]) / scale[:, None]
    seeds = [
        int(child.generate_state(1)[0])
        for child in np.random.SeedSequence(seed).spawn(len(targets))
    ]
    regressors = [
        fit_regressor(unit, target, child, n_restarts=n_restarts)
        for target, child in zip(targets, seeds, strict=True)
    ]
    inflation = len(x) / max(len(x) - x.shape[1] - 3, 1)
    return from_regressors(
        regressors, low=low, span=span, offset=offset, scale=scale, inflation=inflation
    )


def fit_regressor(x: Array, y: Array, seed: int, *, n_restarts: int) -> GaussianProcessRegressor:
    """Scikit-learn's regressor of scaled outputs y (n,) over inputs x (n, d) of the unit box."""
    kernel = ConstantKernel(1.0, AMPLITUDE_BOUNDS) * Matern(
        np.full(x.shape[1], 1.0), LENGTH_BOUNDS, nu=2.5
    ) + WhiteKernel(1e-4, NUGGET_BOUNDS)
    regressor = GaussianProcessRegressor(
        kernel, alpha=0.0, n_restarts_optimizer=n_restarts, random_state=seed
    )
    with warnings.catch_warnings():
        # A nugget at its lower bound (exact data) or a length at its upper bound (an input
        # without influence) is an answer, not a failure.
        warnings.simplefilter("ignore", ConvergenceWarning)
        regressor.fit(x, y)
    return regressor


def from_regressors(
    regressors: Sequence[GaussianProcessRegressor],
    *,
    low: Array,
    span: Array,
    offset: Array,
    scale: Array,
    inflation: float = 1.0,
) -> GaussianProcesses:
    """Take the arrays of fitted regressors (Constant * Matern-5/2 + White over the unit box)."""
    kernels = [regressor.kernel_ for regressor in regressors]
    inputs = np.array(regressors[0].X_train_, dtype=np.float64)
    d = inputs.shape[1]
    return GaussianProcesses(
        low=low,
        span=span,
        inputs=inputs,
        offset=offset,
        scale=scale,
        targets=np.array([r.y_train_ for r in regressors]),
        amplitude=np.array([k.k1.k1.constant_value for k in kernels]),
        length=np.array([np.broadcast_to(k.k1.k2.length_scale, d) for k in kernels]),
        nugget=np.array([k.k2.noise_level for k in kernels]),
        alpha=np.array([r.alpha_ for r in regressors]),
        cholesky=np.array([r.L_ for r in regressors]),
        inflation=np.full(len(regressors), inflation),
    )


def to_arrays(processes: GaussianProcesses) -> dict[str, Array]:
    """All arrays by name, as the constructor takes them."""
    return {field.name: getattr(processes, field.name) for field in fields(GaussianProcesses)}
