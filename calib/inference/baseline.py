"""The thesis' own calibration as a baseline: field error alone, scaled constants, nine starts.

Thesis Eq. 2.8 to 2.11 and sections 4.4.2, 4.4.3, 5.4. What the text calls RMSE is by its Eq. 2.8
the mean over the points of the length of the error vector; that is what is minimised. Forces do
not enter, and the field does not depend on kappa = C10 + C01 (see docs/inference.md): along every
ray through the origin of (C10, C01, C11) the objective is constant, and the answer keeps the
stiffness that its start and the steps of the search happen to give it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.data.thesis import optimization_runs
from calib.data.thesis.forces import SCALE
from calib.inference.coordinates import theta_of_constants
from calib.inference.forward import ForwardModel
from calib.optimize import DifferenceSteps, Minimum, Problem, Settings, multistart
from calib.optimize.minimum import THESIS
from fe.response import Array

THESIS_STEPS = DifferenceSteps(relative=0.1, absolute=0.1)
"""central differences of thesis 4.4.3, in scaled constants"""
RatioBox = tuple[tuple[float, float], tuple[float, float]]
RATIO_BOX: RatioBox = ((0.0, 1.0), (0.0, 0.5))
"""(r, s) within which a forward model is asked unless told otherwise: outside it has failed"""


@dataclass(frozen=True)
class FieldError:
    """Mean length of the field's error over points and increments, of scaled constants.

    Scaled: SC10 = C10 / 1e-3, SC01 = C01 / 1e-2, SC11 = C11 / 1e-4 with C in MPa; Eqs. 5.1 to 5.3
    print the inverse. NaN, a failed solve, where the forward model fails or the constants leave
    the ratios that it knows.
    """

    forward: ForwardModel
    observed: Array
    """(n_step, n_point, 3) displacement, mm; NaN marks points that were not seen"""
    ratio_box: RatioBox = RATIO_BOX

    def __call__(self, scaled: Array) -> float:
        """Mean error at scaled constants (3,), mm."""
        theta = self._theta(scaled)
        if theta is None:
            return float("nan")
        error = self._error(theta)
        if error is None:
            return float("nan")
        return float(np.nanmean(np.linalg.norm(error, axis=-1)))

    def gradient(self, scaled: Array) -> Array:
        """(3,) exact derivatives by the scaled constants, mm; NaN where the model failed."""
        theta = self._theta(scaled)
        if theta is None:
            return np.full(3, np.nan)
        error = self._error(theta)
        if error is None:
            return np.full(3, np.nan)
        length = np.linalg.norm(error, axis=-1, keepdims=True)
        unit = error / np.maximum(length, 1e-300)
        slope = self.forward.jacobian(theta[None]).weights
        assert slope is not None  # a model with a field has weights
        fields = self._shapes(slope[0])
        by_x = np.array([np.nanmean(np.sum(unit * field, axis=-1)) for field in fields])
        by_scaled: Array = by_x @ _x_by_constants(theta) * SCALE
        return by_scaled

    def _theta(self, scaled: Array) -> Array | None:
        constants = scaled * SCALE
        if not constants[0] + constants[1] > 0:
            return None
        theta = theta_of_constants(*constants)
        return theta if is_known(theta, self.ratio_box) else None

    def _error(self, theta: Array) -> Array | None:
        """(n_step, n_point, 3) field minus observed, mm; None where the model failed."""
        weights = self.forward.predict(theta[None]).weights
        basis = self.forward.field_basis
        if weights is None or basis is None:
            raise ValueError("forward: expected a model with a field, found one of forces only")
        field = basis.fields(weights)[0]
        return field - self.observed if np.isfinite(field).all() else None

    def _shapes(self, slope: Array) -> Array:
        """(3, n_step, n_point, 3) change of the field by x from that (k, 3) of its weights."""
        basis = self.forward.field_basis
        assert basis is not None
        still = replace(basis, offset=np.zeros_like(basis.offset))
        return still.fields(slope.T)


def is_known(theta: Array, ratio_box: RatioBox) -> bool:
    """Whether the ratios of theta (3,) are in a box."""
    return all(low <= t <= high for t, (low, high) in zip(theta[1:], ratio_box, strict=True))


def _x_by_constants(theta: Array) -> Array:
    """(3, 3) derivatives of x = (ln kappa, r, s) by (C10, C01, C11), 1/MPa."""
    kappa, r, s = theta
    rows = np.array([[1.0, 1.0, 0.0], [-r, 1.0 - r, 0.0], [-s, -s, 1.0]])
    by_constants: Array = rows / kappa
    return by_constants


@dataclass(frozen=True)
class Baseline:
    """Where the thesis' method ends from each start."""

    start: Array
    """(n, 3) constants (C10, C01, C11) put in, MPa"""
    result: Array
    """(n, 3) constants reached, MPa"""
    error: Array
    """(n,) mean field error reached, mm; infinite where the model failed at the start"""
    force: Array
    """(n, n_step) force of the whole sample that each result predicts, N; NaN for such a start"""
    minima: tuple[Minimum, ...]
    exact: bool
    """whether the gradients were exact; else central differences of 0.1"""
    method: str

    @property
    def kappa(self) -> Array:
        """(n,) C10 + C01 reached, MPa"""
        total: Array = self.result[:, :2].sum(axis=1)
        return total


def thesis_starts() -> Array:
    """(9, 3) scaled starts of thesis Table 5.3."""
    starts: Array = optimization_runs().start / SCALE
    return starts


def thesis_baseline(
    forward: ForwardModel,
    observed: Array,
    *,
    exact: bool = False,
    method: str = "feasible-directions",
    starts: Sequence[Array] | Array | None = None,
    settings: Settings = THESIS,
    ratio_box: RatioBox = RATIO_BOX,
) -> Baseline:
    """Minimise the field error from every start, all constants bounded below by zero.

    `observed` (n_step, n_point, 3) mm; `starts` (n, 3) scaled constants, those of Table 5.3 by
    default. `exact` takes the model's derivatives instead of central differences of 0.1. Outside
    `ratio_box`, where an emulator was trained, the model counts as failed.
    Raises ValueError for a forward model without a field.
    """
    objective = FieldError(forward, observed, ratio_box)
    given = thesis_starts() if starts is None else np.asarray(starts, dtype=np.float64)
    problem = Problem(
        objective,
        np.zeros(3),
        np.full(3, np.inf),
        gradient=objective.gradient if exact else None,
        steps=THESIS_STEPS,
    )
    minima = multistart(problem, list(given), settings, method)
    result = np.array([found.x for found in minima]) * SCALE
    error = np.array([found.value for found in minima])
    known = np.isfinite(error)
    force = np.full((len(minima), observed.shape[0]), np.nan)
    if known.any():
        theta = np.array([theta_of_constants(*constants) for constants in result[known]])
        force[known] = forward.predict(theta).force
    return Baseline(
        start=given * SCALE,
        result=result,
        error=error,
        force=force,
        minima=minima,
        exact=exact,
        method=method,
    )
