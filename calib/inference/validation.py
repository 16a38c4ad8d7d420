"""How well a calibrated model predicts a test that it has not seen.

Pure NumPy and SciPy. `draws` (n_draw, ...) are predictive replicates of what was measured (...).
Requirement 8 of thesis 3.2.1: an error of less than 10 %, and a correlation R^2 of at least 0.95.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import wasserstein_distance

from calib.inference.predictive_checks import correlation, determination, within
from fe.response import Array

PROBABILITIES = (0.5, 0.94)


def area_metric(predicted: Array, observed: Array) -> float:
    """Area between the distribution functions of predicted (n,) and observed (m,), in their unit.

    The validation metric of Ferson, Oberkampf and Ginzburg (Comput. Methods Appl. Mech. Eng. 197,
    2008, section 4): the integral of |F - S_m|, zero only for equal distributions. It is the
    Wasserstein distance of order one.
    """
    return float(wasserstein_distance(predicted, observed))


def area_of_single_values(draws: Array, observed: Array) -> Array:
    """(...) that area where each value of observed (...) is the only one: the mean of |Y - y|."""
    area: Array = np.abs(draws - observed).mean(axis=0)
    return area


def pooled_area(draws: Array, observed: Array) -> float:
    """Area between the pooled u-values of observed (...) and the uniform distribution, at most 0.5.

    The u-pooling of the same paper (section 5): u = F(y) with F of each value's own prediction.
    0 for a perfect prediction, 0.5 where all that is measured lies on one side of all draws. Values
    that depend on one another, such as the points of a field, make it larger than independent
    ones would.
    """
    below = (draws < observed).mean(axis=0) + 0.5 * (draws == observed).mean(axis=0)
    u = np.sort(below.ravel())
    # Between two u-values the empirical distribution is constant and the uniform one is u itself:
    # the area is that of one or two triangles.
    edges = np.concatenate([[0.0], u, [1.0]])
    level = np.arange(u.size + 1) / u.size
    left, right = edges[:-1] - level, edges[1:] - level
    return float(0.5 * (right * np.abs(right) - left * np.abs(left)).sum())


@dataclass(frozen=True)
class Requirement:
    """What a prediction must reach, by default requirement 8 of thesis 3.2.1."""

    max_error: float = 0.10
    """largest relative error"""
    min_r2: float = 0.95
    """smallest coefficient of determination"""


@dataclass(frozen=True)
class Prediction:
    """One measured quantity against its prediction."""

    error: float
    """root mean square of predicted mean minus measured, over that of the measured values"""
    error_sd: float | None
    """its Monte Carlo SD, as the mean is of a few predictions; None of a single one"""
    error_by_step: list[float]
    """the same of each increment"""
    ratio: float
    """factor of the predicted mean that fits the measured values best; 1 is right, 4 is a
    prediction four times too small"""
    r2: float
    """coefficient of determination over all values"""
    r2_sd: float | None
    """its Monte Carlo SD, as of the error"""
    r2_of_noise: float
    """what it would be if nothing but the stated noise of the measurement were wrong"""
    correlation: float | None
    """Pearson's R over the increments, averaged over the points (thesis 5.6); blind to a scale"""
    coverage: dict[float, float]
    """probability of the central interval -> share of the values within"""
    area: float
    """area metric averaged over the values, in the quantity's unit"""
    area_by_step: list[float]
    pooled_area: float
    """that of the pooled u-values, 0 to 0.5"""

    def passes(self, requirement: Requirement) -> bool:
        """Whether error and R^2 meet the requirement."""
        return self.error < requirement.max_error and self.r2 >= requirement.min_r2


@dataclass(frozen=True)
class Samples:
    """Single samples of a quantity of one value an increment, and replicates of single samples."""

    observed: Array
    """(n_sample, n_step)"""
    draws: Array
    """(n_draw, n_step)"""


def judge(
    observed: Array,
    predicted: Array,
    draws: Array,
    noise_std: float,
    samples: Samples | None = None,
) -> Prediction:
    """One quantity (n_step, ...) against predictions and replicates, both (n, n_step, ...).

    `predicted` are without errors of the measurement, one a draw of the posterior; `noise_std` is
    the SD of the measurement's noise in one value. With `samples` the area metric is that between
    their distribution and the predicted one, else that of each measured value.
    """
    if samples is None:
        areas = area_of_single_values(draws, observed).reshape(len(observed), -1).mean(axis=1)
    else:
        pairs = zip(samples.draws.T, samples.observed.T, strict=True)
        areas = np.array([area_metric(drawn, found) for drawn, found in pairs])
    mean = predicted.mean(axis=0)
    error = [_relative(mean[i], observed[i]) for i in range(len(observed))]
    r = correlation(observed, mean)
    total = float(np.square(observed - observed.mean()).mean())
    return Prediction(
        error=_relative(mean, observed),
        error_sd=_jackknife_sd(predicted, observed, _relative),
        error_by_step=error,
        ratio=float((observed * mean).sum() / np.square(mean).sum()),
        r2=determination(observed, mean),
        r2_sd=_jackknife_sd(predicted, observed, lambda p, o: determination(o, p)),
        r2_of_noise=1.0 - noise_std**2 / total if total > 0.0 else np.nan,
        correlation=float(np.nanmean(r)) if np.isfinite(r).any() else None,
        coverage={p: float(within(observed, draws, p).mean()) for p in PROBABILITIES},
        area=float(areas.mean()),
        area_by_step=[float(a) for a in areas],
        pooled_area=pooled_area(draws, observed),
    )


def _relative(mean: Array, observed: Array) -> float:
    size = float(np.square(observed).mean())
    return float(np.sqrt(np.square(mean - observed).mean() / size)) if size > 0.0 else np.nan


def _jackknife_sd(
    predicted: Array, observed: Array, statistic: Callable[[Array, Array], float]
) -> float | None:
    """SD of a statistic of the mean of `predicted` (n, ...), by leaving each out in turn.

    Efron and Stein, Ann. Statist. 9 (1981), 586.
    """
    n = len(predicted)
    if n < 2:
        return None
    total = predicted.sum(axis=0)
    without = np.array([statistic((total - one) / (n - 1), observed) for one in predicted])
    return float(np.sqrt((n - 1) * without.var()))
