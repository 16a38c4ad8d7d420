"""Prior of all unknowns as a density in the sampling coordinates x = (ln kappa, r, s, ...)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from calib.inference.coordinates import Space, Unknown, theta_of
from calib.inference.laws import DEFAULT_LAW, LawCoordinates
from calib.inference.marginal import Marginal
from fe.response import Array
from surrogate.sobol import sobol_points

__all__ = ["Extra", "Marginal", "Prior", "hull_of"]

CONSTANTS_OF = ("mooney-rivlin-2", "mooney-rivlin-3")
"""laws whose constants may have priors of their own"""


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
    log_share: float = 0.0
    """ln of the share of the whole prior that lies in the box, see `within`"""

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

    @cached_property
    def constant_bounds(self) -> Array | None:
        """(k, 2) bounds of the constants, MPa, where these have the priors."""
        return np.array([(m.low, m.high) for m in self.of]) if self.of else None

    def within(self, box: Array) -> Prior:
        """The same density inside a box (k, 2) of the k ratios and inputs of x, zero outside.

        It integrates to its share of the prior, not to one, so that an evidence is that of the
        whole prior where the likelihood is negligible outside; draws and quantiles are of what is
        inside. For a forward model that is known inside only. Raises ValueError for a box of
        another shape or beside the prior, and where the constants have the priors.
        """
        n = self.space.n_forward - 1
        if self.of or np.shape(box) != (n, 2):
            raise ValueError(
                f"box: expected shape ({n}, 2) and priors of kappa and ratios, found "
                f"{np.shape(box)}{' and priors of the constants' if self.of else ''}"
            )
        cuts = []
        for (unknown, marginal), ends in zip(self._columns[:n], box, strict=True):
            low, high = np.exp(ends) if unknown.log else ends
            cuts.append(marginal.cut(float(low), float(high)))
        kept = [marginal for marginal, _ in cuts]
        n_ratios = len(self._ratios)
        n_named = n_ratios - len(self.ratios)
        named = iter(kept[:n_named])
        inputs = zip((unknown for unknown, _ in self.inputs), kept[n_ratios:], strict=True)
        return replace(
            self,
            r=None if self.r is None else next(named),
            s=None if self.s is None else next(named),
            ratios=tuple(kept[n_named:n_ratios]),
            inputs=tuple(inputs),
            log_share=self.log_share + sum(share for _, share in cuts),
        )

    def log_prob(self, x: Array) -> Array:
        """(m,) log density with respect to x (m, n), with the Jacobians of what x holds."""
        if self.of:
            total = self._log_prob_of_constants(x)
            first = 1 + len(self._ratios)
        else:
            total = self._log_density_of_log(self.kappa, x[:, 0], self.bounds[0]) + self.log_share
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
        share = np.mean(self._in_box(self._x_of_constants(sobol_points(len(self.of), 16, 0))))
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
                    "constants; use sample, or the uncut prior"
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

    @property
    def uncut(self) -> Prior:
        """Where the constants have the priors, the same in a box that cuts nothing off; else this.

        Raises ValueError where C10 + C01 need not be positive.
        """
        if not self.of or self.log_mass >= -1e-12:
            return self
        kappa, r, *s = hull_of(self.of)
        return replace(self, kappa=kappa, r=r, s=s[0] if s else None)

    def sample(self, rng: np.random.Generator, n: int) -> Array:
        """(n, d) independent draws of x."""
        if not self.of or self.log_mass >= -1e-12:
            return self.quantile(rng.random((n, self.space.size)))
        whole = self.uncut
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
