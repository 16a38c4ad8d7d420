"""How far a posterior mean moves by errors that its emulator states and by those seen of it.

What an emulator foretells of its error is a model: it takes for independent noise what it cannot
follow, and states what its modes leave out for all of its box. Two things do not rest on it. With
no error stated at all the data say more, and the mean of what they then say lies elsewhere. And
runs left out in turn where the posterior is show what the emulator misses, all alike or each in its
own way; modes and what these leave out both count.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from calib.inference.coordinates import theta_of
from calib.inference.field_likelihood import FieldLikelihood
from calib.inference.forward import EmulatorForward, FieldBasis, Prediction
from calib.inference.likelihood import Likelihood
from fe.response import Array
from surrogate import Emulator, Residuals, TrainingSet, leave_one_out_residuals

WITHIN = 3.0
"""posterior SDs from its mean, in each input, within which a run is where the posterior is"""


class SeenShift(NamedTuple):
    """Changes of the mean of (ln kappa, r, s, ...), in SDs of the posterior."""

    stated: Array
    """(n,) were the emulator without the errors that it states, and right"""
    sd_ratio: Array
    """(n,) SD of the posterior over what it would then be"""
    seen: Array
    """(n,) by the errors at runs left out; NaN where there are none"""

    @property
    def total(self) -> Array:
        """(n,) both, in root sum of squares; what was not seen does not count."""
        both: Array = np.sqrt(self.stated**2 + np.nan_to_num(self.seen) ** 2)
        return both


def seen_shift(
    emulator: Emulator,
    runs: TrainingSet,
    likelihood: Likelihood,
    forward: EmulatorForward,
    x: Array,
) -> SeenShift:
    """Of the posterior whose draws are x (m, n), by the likelihood with the emulator `forward`.

    `runs` trained the emulator; those within `WITHIN` SDs of the mean of the draws are left out in
    turn. Their errors are taken for a linear function of the inputs over the posterior: its value
    moves the mean, and its slope says what the emulator mistakes of the response itself. What
    leaving one of them out changes of that (jackknife) counts beside it. Where runs are too few for
    a slope, the error of each is taken for that of all, and the root mean square counts.
    """
    inputs = x[:, 1 : 1 + runs.ratios.shape[1]]
    centre, scale = inputs.mean(axis=0), inputs.std(axis=0)
    places = (runs.ratios - centre) / scale
    near = (np.abs(places) < WITHIN).all(axis=1) & _inner(runs.ratios)
    exact = _Exact.of(likelihood, forward, x, leave_one_out_residuals(emulator, runs), near)
    weight = _shares(exact.base - likelihood.log_prob(exact.theta))
    mean, sd, middle = x.mean(axis=0), x.std(axis=0), weight @ x
    spread = np.sqrt(weight @ (x - middle) ** 2)

    def moved(part: Array) -> Array:
        """By errors that are `part` (m, k) of those of the runs."""
        shift: Array = (exact.weight_without(part, weight) @ x - middle) / sd
        return shift

    seen = _seen(places[near], (inputs - centre) / scale, moved, x.shape[1])
    return SeenShift(np.abs(middle - mean) / sd, sd / spread, seen)


def _seen(places: Array, draws: Array, moved: Callable[[Array], Array], n: int) -> Array:
    """(n,) see `seen_shift`; places (k, d) of the runs and of the draws (m, d), in SDs."""
    k, d = places.shape
    if not k:
        return np.full(n, np.nan)
    if k < d + 3:
        each = [moved(np.tile(row, (len(draws), 1))) for row in np.eye(k)]
        size: Array = np.sqrt(np.mean(np.square(each), axis=0))
        return size
    at_runs, at_draws = _with_one(places), _with_one(draws)
    whole = moved(at_draws @ np.linalg.pinv(at_runs))
    without = []
    for run in range(k):
        part = np.zeros((len(draws), k))
        others = np.delete(np.arange(k), run)
        part[:, others] = at_draws @ np.linalg.pinv(at_runs[others])
        without.append(moved(part))
    scatter = (k - 1) / k * np.sum((without - np.mean(without, axis=0)) ** 2, axis=0)
    found: Array = np.sqrt(whole**2 + scatter)
    return found


def _inner(ratios: Array) -> npt.NDArray[np.bool_]:
    """(n,) False for corners of the box of all runs: without one, the others must extrapolate."""
    low, high = ratios.min(axis=0), ratios.max(axis=0)
    kept: npt.NDArray[np.bool_] = ((ratios > low) & (ratios < high)).any(axis=1)
    return kept


def _with_one(places: Array) -> Array:
    columns: Array = np.column_stack([np.ones(len(places)), places])
    return columns


def _shares(log_weight: Array) -> Array:
    """(m,) weights that sum to one."""
    share = np.exp(log_weight - log_weight.max())
    weights: Array = share / share.sum()
    return weights


@dataclass(frozen=True)
class _Exact:
    """The likelihood of an emulator taken as exact, at draws, with and without some errors."""

    likelihood: Likelihood
    field: FieldLikelihood | None
    """that of the likelihood, in the basis of the prediction"""
    theta: Array
    """(m, n)"""
    prediction: Prediction
    """no covariance; weights of the modes, then one for each error, zero"""
    relative: Array
    """(k, n_step) errors of the force"""
    base: Array
    """(m,) ln likelihood"""

    @classmethod
    def of(
        cls,
        likelihood: Likelihood,
        forward: EmulatorForward,
        x: Array,
        errors: Residuals,
        chosen: npt.NDArray[np.bool_],
    ) -> _Exact:
        """At draws `x` (m, n) of the posterior, with the `chosen` (n_run,) of the errors."""
        theta = theta_of(x)
        relative = errors.force_error[chosen] / errors.force[chosen]
        basis, found = forward.field_basis, likelihood.predict(theta)
        weights, field = None, None
        if basis is not None and found.weights is not None:
            assert errors.field_error is not None and basis.modes is not None
            modes = np.concatenate([basis.modes, errors.field_error[chosen]])
            basis = FieldBasis(basis.offset, modes, basis.truncation[:0])
            weights = np.pad(found.weights, ((0, 0), (0, len(relative))))
            field = None if likelihood.field is None else likelihood.field.with_basis(basis)
        prediction = Prediction(found.force, None, weights)
        base = likelihood.log_prob_of(theta, prediction, field)
        return cls(likelihood, field, theta, prediction, relative, base)

    def weight_without(self, part: Array, weight: Array) -> Array:
        """(m,) weights of the draws were the model without `part` (m, k) of the errors.

        `weight` (m,) are those with it.
        """
        weights = self.prediction.weights
        if weights is not None:
            weights = weights.copy()
            weights[:, weights.shape[1] - len(self.relative) :] = -part
        force = self.prediction.force / (1.0 + part @ self.relative)
        without = Prediction(force, None, weights)
        change = self.likelihood.log_prob_of(self.theta, without, self.field) - self.base
        with np.errstate(divide="ignore"):
            return _shares(np.log(weight) + change)
