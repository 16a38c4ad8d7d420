"""Distribution of one parameter between two bounds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtr, ndtri

from fe.response import Array

DISTRIBUTIONS = ("uniform", "log_uniform", "normal", "lognormal", "half_cauchy")
LEAST_MASS = 1e-200
"""of a normal between its bounds: what it has 30 SDs from its mean"""
LEAST_SHARE = 1e-10
"""of a half-Cauchy: a difference of numbers near one"""


@dataclass(frozen=True)
class Marginal:
    """Distribution of one parameter, truncated to [low, high].

    `mean` and `sd` are those of the normal or lognormal variable before truncation, in the
    parameter's own unit; the half-Cauchy takes its `median` before truncation above, the uniform
    ones none.
    Raises ValueError when the distribution is unknown or the numbers do not fit it.
    """

    distribution: str
    low: float
    high: float
    mean: float | None = None
    sd: float | None = None
    median: float | None = None

    def __post_init__(self) -> None:
        if self.distribution not in DISTRIBUTIONS:
            known = ", ".join(DISTRIBUTIONS)
            raise ValueError(f"distribution: got {self.distribution!r}, expected one of {known}")
        if not (np.isfinite(self.low) and np.isfinite(self.high) and self.low < self.high):
            raise ValueError(f"low, high: expected finite low < high, got {self.low}, {self.high}")
        if self.on_log and self.low <= 0:
            raise ValueError(f"low: must be positive for {self.distribution}, got {self.low}")
        if (self.distribution == "half_cauchy") != (self.median is not None):
            raise ValueError(f"median: {self.distribution} with median {self.median}")
        if self.median is not None:
            self._check_half_cauchy(self.median)
        if self.is_normal:
            self._check_normal()
        elif self.mean is not None or self.sd is not None:
            raise ValueError(f"mean, sd: {self.distribution} takes neither; leave them out")

    def _check_half_cauchy(self, median: float) -> None:
        if not (0 < median < np.inf and self.low >= 0):
            got = f"{median}, {self.low}"
            raise ValueError(f"median, low: expected a positive median and low >= 0, got {got}")
        if not self._mass >= LEAST_SHARE:
            raise ValueError(
                f"low, high: [{self.low}, {self.high}] holds almost no probability of "
                f"half_cauchy with median {median}; widen the bounds"
            )

    def _check_normal(self) -> None:
        if self.mean is None or self.sd is None or not self.sd > 0:
            got = f"mean {self.mean}, sd {self.sd}"
            raise ValueError(f"mean, sd: {self.distribution} needs both and sd > 0, got {got}")
        if self.on_log and self.mean <= 0:
            raise ValueError(f"mean: must be positive for lognormal, got {self.mean}")
        if not self._mass >= LEAST_MASS:
            raise ValueError(
                f"low, high: [{self.low}, {self.high}] holds almost no probability of "
                f"{self.distribution} with mean {self.mean} and sd {self.sd}; widen the bounds"
            )

    @property
    def on_log(self) -> bool:
        """Whether the distribution is stated on the logarithm of the parameter."""
        return self.distribution in ("log_uniform", "lognormal")

    @property
    def is_normal(self) -> bool:
        """Whether the distribution is normal (of the parameter or of its logarithm)."""
        return self.distribution in ("normal", "lognormal")

    @cached_property
    def _range(self) -> tuple[float, float]:
        """Bounds of the parameter or of its logarithm, on which the density is simple."""
        if self.on_log:
            return float(np.log(self.low)), float(np.log(self.high))
        return self.low, self.high

    @cached_property
    def _normal(self) -> tuple[float, float]:
        """Mean and SD of the normal variable: the parameter or its logarithm."""
        assert self.mean is not None and self.sd is not None
        if not self.on_log:
            return self.mean, self.sd
        variance = float(np.log1p((self.sd / self.mean) ** 2))
        return float(np.log(self.mean)) - 0.5 * variance, variance**0.5

    @cached_property
    def _tails(self) -> tuple[float, float]:
        if self.median is not None:
            low, high = (2.0 / np.pi * np.arctan(end / self.median) for end in self._range)
            return float(low), float(high)
        low, high = sorted(self._side * (end - self._normal[0]) for end in self._range)
        return float(ndtr(low / self._normal[1])), float(ndtr(high / self._normal[1]))

    @cached_property
    def _side(self) -> float:
        """-1 where a normal variable is above its mean, and is mirrored: tails round off at one."""
        return -1.0 if self._range[0] > self._normal[0] else 1.0

    @property
    def _mass(self) -> float:
        return self._tails[1] - self._tails[0]

    @cached_property
    def _log_norm(self) -> float:
        """Logarithm of the constant that makes the density integrate to one."""
        if self.median is not None:
            return -float(np.log(0.5 * np.pi * self.median * self._mass))
        if self.is_normal:
            return -float(np.log(self._normal[1] * np.sqrt(2.0 * np.pi) * self._mass))
        low, high = self._range
        return -float(np.log(high - low))

    def log_density(self, value: Array) -> Array:
        """Log density with respect to the parameter itself; -inf outside [low, high]."""
        inside = (value >= self.low) & (value <= self.high)
        # Outside, any admissible number will do: the result is overwritten.
        safe = np.where(inside, value, self.low)
        position = np.log(safe) if self.on_log else safe
        result = np.full(np.shape(value), self._log_norm)
        if self.is_normal:
            centre, sd = self._normal
            result = result - 0.5 * ((position - centre) / sd) ** 2
        if self.median is not None:
            result = result - np.log1p((position / self.median) ** 2)
        if self.on_log:
            result = result - position  # d(ln v)/dv = 1/v
        return np.where(inside, result, -np.inf)

    def quantile(self, probability: Array) -> Array:
        """Parameter value below which the given probability in [0, 1] lies."""
        low, high = self._range
        if self.is_normal:
            centre, sd = self._normal
            share = probability if self._side > 0.0 else 1.0 - probability
            position = centre + self._side * sd * ndtri(self._tails[0] + share * self._mass)
        elif self.median is not None:
            share = self._tails[0] + probability * self._mass
            position = self.median * np.tan(0.5 * np.pi * share)
        else:
            position = low + probability * (high - low)
        value = np.exp(position) if self.on_log else position
        clipped: Array = np.clip(value, self.low, self.high)
        return clipped

    def cut(self, low: float, high: float) -> tuple[Marginal, float]:
        """The same distribution within [low, high] and its own bounds, and ln of its share there.

        Raises ValueError when the two ranges do not overlap.
        """
        kept = replace(self, low=max(low, self.low), high=min(high, self.high))
        inside = np.array([0.5 * (kept.low + kept.high)])
        return kept, float((self.log_density(inside) - kept.log_density(inside))[0])
