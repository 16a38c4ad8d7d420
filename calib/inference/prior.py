"""Prior of all unknowns as a density in the sampling coordinates x = (ln kappa, r, s, ...)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from calib.inference.coordinates import Space, Unknown, theta_of
from calib.inference.laws import DEFAULT_LAW, LawCoordinates
from fe.response import Array

DISTRIBUTIONS = ("uniform", "log_uniform", "normal", "lognormal")
CONSTANTS_OF = ("mooney-rivlin-2", "mooney-rivlin-3")
"""laws whose constants may have priors of their own"""


@dataclass(frozen=True)
class Marginal:
    """Distribution of one parameter, truncated to [low, high].

    `mean` and `sd` are those of the normal or lognormal variable before truncation, in the
    parameter's own unit; the uniform ones take neither.
    Raises ValueError when the distribution is unknown or the numbers do not fit it.
    """

    distribution: str
    low: float
    high: float
    mean: float | None = None
    sd: float | None = None

    def __post_init__(self) -> None:
        if self.distribution not in DISTRIBUTIONS:
            known = ", ".join(DISTRIBUTIONS)
            raise ValueError(f"distribution: got {self.distribution!r}, expected one of {known}")
        if not (np.isfinite(self.low) and np.isfinite(self.high) and self.low < self.high):
            raise ValueError(f"low, high: expected finite low < high, got {self.low}, {self.high}")
        if self.on_log and self.low <= 0:
            raise ValueError(f"low: must be positive for {self.distribution}, got {self.low}")
        if self.is_normal:
            self._check_normal()
        elif self.mean is not None or self.sd is not None:
            raise ValueError(f"mean, sd: {self.distribution} takes neither; leave them out")

    def _check_normal(self) -> None:
        if self.mean is None or self.sd is None or not self.sd > 0:
            got = f"mean {self.mean}, sd {self.sd}"
            raise ValueError(f"mean, sd: {self.distribution} needs both and sd > 0, got {got}")
        if self.on_log and self.mean <= 0:
            raise ValueError(f"mean: must be positive for lognormal, got {self.mean}")
        if not self._mass >= 1e-10:
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
        centre, sd = self._normal
        low, high = self._range
        return float(ndtr((low - centre) / sd)), float(ndtr((high - centre) / sd))

    @property
    def _mass(self) -> float:
        return self._tails[1] - self._tails[0]

    @cached_property
    def _log_norm(self) -> float:
        """Logarithm of the constant that makes the density integrate to one."""
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
        if self.on_log:
            result = result - position  # d(ln v)/dv = 1/v
        return np.where(inside, result, -np.inf)

    def quantile(self, probability: Array) -> Array:
        """Parameter value below which the given probability in [0, 1] lies."""
        low, high = self._range
        if self.is_normal:
            centre, sd = self._normal
            position = centre + sd * ndtri(self._tails[0] + probability * self._mass)
        else:
            position = low + probability * (high - low)
        value = np.exp(position) if self.on_log else position
        clipped: Array = np.clip(value, self.low, self.high)
        return clipped


Extra = tuple[Unknown, Marginal]


@dataclass(frozen=True)
class Prior:
    """Independent priors of kappa [MPa], ratios and further unknowns; methods are in x.

    Instead of kappa and ratios the constants of a Mooney-Rivlin law may have the priors: `of` holds
    those of (C10, C01) or (C10, C01, C11), MPa, and the marginals of kappa and the ratios are then
    only the bounds of the box in which the density is kept.
    """

    kappa: Marginal
    r: Marginal | None = None
    s: Marginal | None = None
    ratios: tuple[Marginal, ...] = ()
    """of the ratios of a law other than Mooney-Rivlin"""
    law: str = DEFAULT_LAW
    inputs: tuple[Extra, ...] = ()
    """further unknowns of the forward model"""
    errors: tuple[Extra, ...] = ()
    """unknowns of the errors"""
    of: tuple[Marginal, ...] = ()
    """priors of the constants, MPa, in place of those of kappa and ratios"""

    def __post_init__(self) -> None:
        if self.kappa.low <= 0:
            raise ValueError(f"kappa.low: must be positive (MPa), got {self.kappa.low}")
        expected = [ratio.name for ratio in LawCoordinates(self.law).ratios]
        if len(self._ratios) != len(expected):
            raise ValueError(
                f"ratios: expected priors of {', '.join(expected) or 'nothing'} for {self.law}, "
                f"found {len(self._ratios)}"
            )
        if self.of and (self.law not in CONSTANTS_OF or len(self.of) != len(expected) + 1):
            known = ", ".join(CONSTANTS_OF)
            raise ValueError(
                f"of: expected priors of all constants of one of {known}, "
                f"found {len(self.of)} for {self.law}"
            )
        if any(m.low <= 0 for u, m in (*self.inputs, *self.errors) if u.log):
            names = ", ".join(u.name for u, m in (*self.inputs, *self.errors) if u.log)
            raise ValueError(f"low: expected positive lower bounds of {names}")

    @property
    def _ratios(self) -> tuple[Marginal, ...]:
        return (*(m for m in (self.r, self.s) if m is not None), *self.ratios)

    @cached_property
    def space(self) -> Space:
        """What the coordinates are."""
        law = LawCoordinates(self.law)
        inputs, errors = (tuple(u for u, _ in extra) for extra in (self.inputs, self.errors))
        return Space(law, inputs, errors)

    @cached_property
    def _columns(self) -> tuple[Extra, ...]:
        marginals = (*self._ratios, *(m for _, m in (*self.inputs, *self.errors)))
        return tuple(zip(self.space.unknowns[1:], marginals, strict=True))

    @cached_property
    def bounds(self) -> Array:
        """(n, 2) lower and upper bound of each coordinate of x."""
        low_high = [(m.low, m.high) for m in (self.kappa, *(m for _, m in self._columns))]
        bounds = np.array(low_high, dtype=np.float64)
        for row, unknown in enumerate(self.space.unknowns):
            if unknown.log:
                bounds[row] = np.log(bounds[row])
        return bounds

    def log_prob(self, x: Array) -> Array:
        """(m,) log density with respect to x (m, n), with the Jacobians of what x holds."""
        if self.of:
            total = self._log_prob_of_constants(x)
            first = 1 + len(self._ratios)
        else:
            total = self._log_density_of_log(self.kappa, x[:, 0], self.bounds[0])
            first = 1
        for column, (unknown, marginal) in enumerate(self._columns[first - 1 :], start=first):
            at = x[:, column]
            if unknown.log:
                total = total + self._log_density_of_log(marginal, at, self.bounds[column])
            else:
                total = total + marginal.log_density(at)
        return total

    @staticmethod
    def _log_density_of_log(marginal: Marginal, at: Array, bounds: Array) -> Array:
        """Log density of the logarithm of a parameter, at its logarithm."""
        low, high = bounds
        # exp(log(low)) may miss low by one ulp, which must not throw the bound itself out.
        value = np.clip(np.exp(at), marginal.low, marginal.high)
        inside = (at >= low) & (at <= high)
        density: Array = np.where(inside, marginal.log_density(value) + at, -np.inf)
        return density

    def _log_prob_of_constants(self, x: Array) -> Array:
        """Log density of (ln kappa, ratios) when the constants have the priors.

        C10 = (1 - r) kappa, C01 = r kappa, C11 = s kappa: |dC / d(ln kappa, r, s)| = kappa^3, and
        kappa^2 without C11. Cut off at the box and normalised.
        """
        n = len(self.of)
        constants = self.space.constants(theta_of(x[:, :n]))
        low, high = self.bounds[:n].T
        inside = np.all((x[:, :n] >= low) & (x[:, :n] <= high), axis=1)
        total = n * x[:, 0] - self.log_mass
        for column, marginal in enumerate(self.of):
            total = total + marginal.log_density(constants[:, column])
        kept: Array = np.where(inside, total, -np.inf)
        return kept

    @cached_property
    def log_mass(self) -> float:
        """Ln of the share of the constants' prior that lies in the box.

        By 2^16 points of a Sobol sequence, to some 1e-4.
        """
        share = np.mean(self._in_box(self._x_of_constants(_sobol(len(self.of)))))
        if not share > 1e-3:
            raise ValueError(
                f"of: expected priors of the constants of which more than 0.1 % lies in the box of "
                f"kappa and ratios, found {share:.2g}"
            )
        return float(np.log(share))

    def _in_box(self, x: Array) -> npt.NDArray[np.bool_]:
        low, high = self.bounds[: len(self.of)].T
        inside: npt.NDArray[np.bool_] = np.all((x >= low) & (x <= high), axis=1)
        return inside

    def _x_of_constants(self, probability: Array) -> Array:
        """(m, n) (ln kappa, r, s) where the constants have these probabilities (m, n)."""
        columns = [m.quantile(probability[:, i]) for i, m in enumerate(self.of)]
        kappa = columns[0] + columns[1]
        return np.column_stack([np.log(kappa), *(column / kappa for column in columns[1:])])

    def quantile(self, probability: Array) -> Array:
        """(m, n) x from independent uniform probabilities (m, n).

        Raises ValueError where the constants have the priors and the box cuts some of them off.
        """
        if self.of:
            if self.log_mass < -1e-12:
                raise ValueError(
                    "quantile: not known where a box of kappa and ratios cuts off priors of the "
                    "constants; use sample"
                )
            first = self._x_of_constants(probability[:, : len(self.of)])
            columns = list(first.T)
        else:
            columns = [np.log(self.kappa.quantile(probability[:, 0]))]
        for column in range(len(columns), self.space.size):
            unknown, marginal = self._columns[column - 1]
            value = marginal.quantile(probability[:, column])
            columns.append(np.log(value) if unknown.log else value)
        x = np.column_stack(columns)
        bounds = self.bounds
        clipped: Array = np.clip(x, bounds[:, 0], bounds[:, 1])
        return clipped

    def sample(self, rng: np.random.Generator, n: int) -> Array:
        """(n, d) independent draws of x."""
        if not self.of or self.log_mass >= -1e-12:
            return self.quantile(rng.random((n, self.space.size)))
        box = (*hull_of(self.of), None)
        whole = replace(self, kappa=box[0] or self.kappa, r=box[1], s=box[2])
        kept = np.zeros((0, self.space.size))
        while len(kept) < n:
            drawn = whole.quantile(rng.random((n, self.space.size)))
            kept = np.concatenate([kept, drawn[self._in_box(drawn[:, : len(self.of)])]])
        return kept[:n]


def hull_of(constants: tuple[Marginal, ...]) -> tuple[Marginal, ...]:
    """The least box of kappa and ratios around all that priors of C10, C01 (and C11) allow.

    Raises ValueError where C10 + C01 need not be positive.
    """
    c10, c01 = constants[:2]
    low, high = c10.low + c01.low, c10.high + c01.high
    if not low > 0:
        raise ValueError(f"low: expected C10 + C01 above 0 MPa at their lower bounds, got {low:g}")
    # r = C01 / (C10 + C01) grows with C01; with C10 it falls where C01 is positive, else it grows.
    corners = [b / (a + b) for a in (c10.low, c10.high) for b in (c01.low, c01.high)]
    box = [(low, high), (min(corners), max(corners))]
    if len(constants) > 2:
        c11 = constants[2]
        least = c11.low / (high if c11.low >= 0 else low)
        box.append((least, c11.high / (low if c11.high >= 0 else high)))
    # A hair wider, so that rounding throws no corner out.
    wide = [(a - 1e-12 * (b - a), b + 1e-12 * (b - a)) for a, b in box]
    return tuple(Marginal("uniform", a, b) for a, b in wide)


def _sobol(d: int) -> Array:
    points: Array = qmc.Sobol(d, scramble=True, seed=np.random.default_rng(0)).random_base2(16)
    return points
