"""Repeated force curves of one material: what is common, what differs, what the model lacks.

In logarithms, so that stiffness is additive: the curve of repeat k is

    ln F_k = ln f(theta) + delta + t_k 1 + z_k g + w_k + e_k

with f the model, delta its discrepancy (one for all repeats, smooth over the levels), t_k the
repeat's stiffness, z_k the zero of its travel with g = d ln F / d travel, w_k what else is its own
(rough, correlated over the levels) and e_k independent noise. All are normal. Then the mean of the
curves and their scatter about it are independent, and only the mean knows of theta and delta.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from calib.inference.gaussian import LOG_2PI
from fe.response import Array


class Scatter(NamedTuple):
    """Scales of m models, each (m,)."""

    stiffness_sd: Array
    """relative SD of the repeats' stiffness"""
    zero_sd: Array
    """SD of the repeats' zero of the travel, mm"""
    own_sd: Array
    """relative SD of what else is a repeat's own"""
    discrepancy_sd: Array
    """relative SD of the model's discrepancy"""


class Predictive(NamedTuple):
    """Normal distribution of the logarithm of a further repeat's curve, for m models."""

    mean: Array
    """(m, n_step)"""
    covariance: Array
    """(m, n_step, n_step)"""


@dataclass(frozen=True)
class Repeats:
    """Force curves of repeated tests at common travels.

    Raises ValueError when shapes disagree, forces are not positive, or there are fewer than two.
    """

    travel: Array
    """(n_step,) increasing, mm"""
    force: Array
    """(n_repeat, n_step) positive, N"""
    noise_sd: float
    """SD of independent noise of one force, N"""
    length: float
    """length over which the discrepancy and what is a repeat's own are correlated, mm of travel"""
    common_zero_sd: float = 0.0
    """SD of an error in the zero of the travel that all repeats share, mm"""

    def __post_init__(self) -> None:
        if self.force.ndim != 2 or self.force.shape[1] != self.travel.size:
            expected = f"(n_repeat, {self.travel.size})"
            raise ValueError(f"force: expected {expected}, found {self.force.shape}")
        if len(self.force) < 2:
            raise ValueError("force: expected two repeats or more, found one: no scatter to see")
        if not (self.force > 0.0).all():
            raise ValueError(f"force: expected positive values, found {self.force.min():g} N")
        for name in ("noise_sd", "length"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name}: expected more than 0, found {getattr(self, name)}")

    @cached_property
    def mean(self) -> Array:
        """(n_step,) mean of the logarithms."""
        average: Array = np.log(self.force).mean(axis=0)
        return average

    @cached_property
    def slope(self) -> Array:
        """(n_step,) d ln F / d travel of the mean curve, 1/mm."""
        gradient: Array = np.gradient(self.mean, np.log(self.travel), edge_order=2) / self.travel
        return gradient

    @cached_property
    def _scattered(self) -> Array:
        deviation = np.log(self.force) - self.mean
        product: Array = deviation.T @ deviation
        return product

    def between(self, scatter: Scatter) -> Array:
        """(m, n_step, n_step) covariance of one repeat about the common curve.

        What is a repeat's own has the correlation exp(-distance / length).
        """
        one = np.ones((self.travel.size, self.travel.size))
        noise = np.diag((self.noise_sd / np.exp(self.mean)) ** 2)
        stiffness = np.square(scatter.stiffness_sd)[:, None, None] * one
        zero = np.square(scatter.zero_sd)[:, None, None] * np.outer(self.slope, self.slope)
        away = np.abs(self.travel[:, None] - self.travel[None, :]) / self.length
        own = np.square(scatter.own_sd)[:, None, None] * np.exp(-away)
        total: Array = stiffness + zero + own + noise
        return total

    def discrepancy(self, scatter: Scatter, extra: Array | None = None) -> Array:
        """(m, n_step, n_step) covariance of the model's error; `extra` is the emulator's, in ln F.

        Half of it is common to all levels, half falls off over `length` (squared exponential). The
        zero that all repeats share is with it: neither is seen in the scatter of the repeats.
        """
        away = (self.travel[:, None] - self.travel[None, :]) / self.length
        shape = 0.5 + 0.5 * np.exp(-0.5 * away**2)
        total: Array = np.square(scatter.discrepancy_sd)[:, None, None] * shape
        total = total + self.common_zero_sd**2 * np.outer(self.slope, self.slope)
        return total if extra is None else total + extra

    def log_likelihood(
        self, log_force: Array, scatter: Scatter, extra: Array | None = None
    ) -> Array:
        """(m,) ln p(all curves) where the model says ln f = log_force (m, n_step)."""
        n, p = self.force.shape
        between = self.between(scatter)
        common = self.discrepancy(scatter, extra) + between / n
        off = self.mean - log_force
        value = -0.5 * (_logdet(common) + _square(common, off) + p * LOG_2PI)
        scattered = np.linalg.solve(between, np.broadcast_to(self._scattered, between.shape))
        trace = np.trace(scattered, axis1=1, axis2=2)
        deviations = (n - 1) * (_logdet(between) + p * LOG_2PI) + trace + p * np.log(n)
        total: Array = value - 0.5 * deviations
        return total

    def predictive(
        self, log_force: Array, scatter: Scatter, extra: Array | None = None
    ) -> Predictive:
        """A further repeat, given these: the discrepancy is what is left of the mean curve."""
        between = self.between(scatter)
        model = self.discrepancy(scatter, extra)
        common = model + between / len(self.force)
        gain = np.linalg.solve(common, model).transpose(0, 2, 1)  # model common^-1
        mean = log_force + np.einsum("mij,mj->mi", gain, self.mean - log_force)
        return Predictive(mean, model - gain @ model + between)

    def without(self, index: int) -> Repeats:
        """All repeats but one."""
        kept = np.delete(self.force, index, axis=0)
        return replace(self, force=kept)


def log_density(predictive: Predictive, log_force: Array) -> Array:
    """(m,) ln density of one curve ln F (n_step,) under each of m predictives."""
    off = log_force - predictive.mean
    covariance = predictive.covariance
    value: Array = -0.5 * (
        _logdet(covariance) + _square(covariance, off) + log_force.size * LOG_2PI
    )
    return value


def _logdet(covariance: Array) -> Array:
    value: Array = np.linalg.slogdet(covariance)[1]
    return value


def _square(covariance: Array, off: Array) -> Array:
    solved = np.linalg.solve(covariance, off[:, :, None])[:, :, 0]
    value: Array = np.einsum("mi,mi->m", off, solved)
    return value
