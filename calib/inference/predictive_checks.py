"""Measured against predicted: p-values, coverage, correlation and error, by increment and region.

Pure NumPy. `draws` are posterior predictive replicates of what was measured, with every error of
the likelihood; `model` is what the model says at the same draws without any error. Fields are
(n_step, n_point, n_component), mm; forces (n_step,), N.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fe.response import Array

BoolArray = npt.NDArray[np.bool_]

REGIONS = ("near pin", "middle", "edge")


def tail_probability(observed: Array, draws: Array) -> Array:
    """(...) two-sided p-value of each value of observed (...) among draws (n_draw, ...).

    Twice the smaller share of draws on one side, a draw that equals the value on both; it is at
    least 1 / (n_draw + 1), as one value more among the draws.
    """
    n = len(draws)
    below = (1.0 + (draws <= observed).sum(axis=0)) / (n + 1.0)
    above = (1.0 + (draws >= observed).sum(axis=0)) / (n + 1.0)
    p: Array = np.minimum(1.0, 2.0 * np.minimum(below, above))
    return p


def within(observed: Array, draws: Array, probability: float) -> BoolArray:
    """(...) whether each value lies in the central interval of that probability of the draws."""
    tail = 0.5 * (1.0 - probability)
    low, high = np.quantile(draws, [tail, 1.0 - tail], axis=0)
    inside: BoolArray = (low <= observed) & (observed <= high)
    return inside


def misfit_p_value(observed: Array, draws: Array, model: Array) -> float:
    """Posterior predictive p-value of the root mean square misfit (Gelman, Meng, Stern 1996).

    Share of the draws whose replicate is further from the model at that draw than the measurement
    is; observed (...), draws and model (n_draw, ...). Small: the measurement is further away than
    the stated errors explain. Near 1: nearer, so that the errors are stated too large.
    """
    axes = tuple(range(1, draws.ndim))
    measured = np.square(observed - model).mean(axis=axes)
    replicated = np.square(draws - model).mean(axis=axes)
    return float((1.0 + (replicated >= measured).sum()) / (len(draws) + 1.0))


def correlation(observed: Array, predicted: Array) -> Array:
    """(...) Pearson's R over the increments of observed and predicted (n_step, ...).

    What the thesis maps (sections 5.5 and 5.6, appendices D and F) and calls R^2; it is negative
    where the two run against each other, and does not see a wrong scale. NaN where one is constant.
    """
    a = observed - observed.mean(axis=0)
    b = predicted - predicted.mean(axis=0)
    scale = np.sqrt(np.square(a).sum(axis=0) * np.square(b).sum(axis=0))
    # Rounding of a constant leaves a scale that is not quite 0.
    size = np.abs(observed).max(axis=0) * np.abs(predicted).max(axis=0)
    constant = scale <= 1e-24 + 1e-12 * size
    r: Array = np.where(constant, np.nan, (a * b).sum(axis=0) / np.where(constant, 1.0, scale))
    return r


def rms_error(observed: Array, predicted: Array) -> Array:
    """(...) root mean square difference over the increments (n_step, ...), as thesis appendix E."""
    error: Array = np.sqrt(np.square(observed - predicted).mean(axis=0))
    return error


def determination(observed: Array, predicted: Array) -> float:
    """Coefficient of determination 1 - SS_residual / SS_total over all values; sees the scale.

    NaN where all observed values are the same.
    """
    total = float(np.square(observed - observed.mean()).sum())
    return 1.0 - float(np.square(observed - predicted).sum()) / total if total > 0.0 else np.nan


def face_regions(
    points: Array, width: float, pin_width: float, pin_shift: float = 0.0
) -> dict[str, BoolArray]:
    """Parts of the front face, name of `REGIONS` -> (n_point,) whether a point is in it.

    points (n_point, 2) x from the sample's centre plane, from which the pin's is `pin_shift` away,
    mm. Near pin: below the pin. Edge: the outer third of what lies beside it. Middle: between.
    Regions without a point are left out.
    """
    from_pin = points[:, 0] - pin_shift
    away, pin = np.abs(from_pin), 0.5 * pin_width
    side = 0.5 * width - np.sign(from_pin) * pin_shift
    edge = pin + 2.0 / 3.0 * (side - pin)
    found = {
        "near pin": away <= pin,
        "middle": (away > pin) & (away <= edge),
        "edge": away > edge,
    }
    return {name: inside for name, inside in found.items() if inside.any()}


@dataclass(frozen=True)
class Check:
    """One part of the data against its posterior predictive distribution."""

    p_value: float
    """two-sided of a single force, else of the RMS misfit (`misfit_p_value`)"""
    coverage: dict[float, float]
    """probability of the central interval -> share of the values within it"""
    rmse: float
    """of the prediction, in the unit of the data: the median of forces, the mean field"""
    relative: float
    """of a force the prediction over the measured one less 1, else `rmse` over the root mean
    square of the measured values"""


def check_forces(
    observed: Array, draws: Array, probabilities: tuple[float, ...] = (0.5, 0.94)
) -> list[Check]:
    """One check an increment; observed (n_step,) and draws (n_draw, n_step), N."""
    p = tail_probability(observed, draws)
    inside = {prob: within(observed, draws, prob) for prob in probabilities}
    # Not the mean: a discrepancy is a factor, whose mean is above 1.
    middle = np.median(draws, axis=0)
    return [
        Check(
            p_value=float(p[i]),
            coverage={prob: float(found[i]) for prob, found in inside.items()},
            rmse=float(abs(middle[i] - observed[i])),
            relative=float(middle[i] / observed[i] - 1.0),
        )
        for i in range(observed.size)
    ]


def check_field(
    observed: Array,
    draws: Array,
    model: Array,
    regions: Mapping[str, BoolArray],
    probabilities: tuple[float, ...] = (0.5, 0.94),
) -> dict[str, list[list[Check]]]:
    """Region -> increment -> component; observed (n_step, n_point, 3), draws (n_draw, ...), mm."""
    inside = {prob: within(observed, draws, prob) for prob in probabilities}
    mean = model.mean(axis=0)
    n_step, _, n_component = observed.shape
    return {
        name: [
            [
                _check_part((i, mask, c), observed, draws, model, mean, inside)
                for c in range(n_component)
            ]
            for i in range(n_step)
        ]
        for name, mask in regions.items()
    }


def _check_part(
    at: tuple[int, BoolArray, int],
    observed: Array,
    draws: Array,
    model: Array,
    mean: Array,
    inside: Mapping[float, BoolArray],
) -> Check:
    part, every = observed[at], (slice(None), *at)
    error = float(np.sqrt(np.square(mean[at] - part).mean()))
    size = float(np.sqrt(np.square(part).mean()))
    return Check(
        p_value=misfit_p_value(part, draws[every], model[every]),
        coverage={prob: float(found[at].mean()) for prob, found in inside.items()},
        rmse=error,
        relative=error / size if size > 0.0 else np.nan,
    )
