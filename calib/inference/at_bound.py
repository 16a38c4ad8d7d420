"""Which bounds of the prior a posterior leans on, so that its SD says little about distance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from calib.inference.coordinates import Space, theta_of
from fe.response import Array

STRIP = 0.25
"""width of the strips in which densities are compared, in posterior SDs"""
SMALL = float(np.exp(-2.0))
"""density over its maximum below which a bound is not felt: that of a normal two SDs out"""

UNITS = {
    **dict.fromkeys(("kappa", "C10", "C01", "C11"), "MPa"),
    **dict.fromkeys(("height", "fillet", "pin_width", "pin_shift"), "mm"),
}
"""units of the parameters that have one"""
CONVENTIONS = {
    ("r", "low"): "C01 is not negative",
    ("r", "high"): "C10 is not negative",
    ("s", "low"): "C11 is not negative",
}
"""what the bounds of the ratios mean where they are 0 and 1"""


@dataclass(frozen=True)
class AtBound:
    """One parameter whose marginal posterior does not fade before a bound of its prior."""

    parameter: str
    """name of the parameter"""
    side: str
    """low or high"""
    value: float
    """the bound, in the unit of the parameter"""
    density_ratio: float
    """marginal density with respect to x next to the bound over its maximum"""

    def __post_init__(self) -> None:
        if self.side not in ("low", "high"):
            raise ValueError(f"side: expected low or high, got {self.side!r}")

    @property
    def text(self) -> str:
        """The bound in words, with the convention behind it."""
        unit = f" {UNITS[self.parameter]}" if self.parameter in UNITS else ""
        natural = {"low": 0.0, "high": 1.0}[self.side] == self.value
        meaning = CONVENTIONS.get((self.parameter, self.side)) if natural else None
        return f"{self.parameter} = {self.value:g}{unit}" + (f" ({meaning})" if meaning else "")


def at_bound(
    draws: Array, bounds: Array, space: Space | None = None, constants: Array | None = None
) -> tuple[AtBound, ...]:
    """Bounds (d, 2) of x = (ln kappa, r, s, ...) on which posterior draws (n, d) lean.

    Where the law's constants have the priors, `constants` (k, 2) are their bounds, MPa, and count
    in place of those of kappa and the ratios, which are none that the prior states.

    The marginal density is taken in strips of a quarter of the posterior SD, counted from the
    bound: the posterior leans on the bound when the first strip holds more than exp(-2) times
    what the fullest one holds, also in strips of the smaller SD of the draws next to the bound: a
    narrow part of a wide posterior may be there, away from it. A bound further out than all draws
    has an empty first strip.
    """
    space = space or Space()
    found: list[AtBound] = []
    k = 0 if constants is None else len(constants)
    if constants is not None:
        values = space.constants(theta_of(draws))
        for name, column, ends in zip(space.law.constants, values.T, constants, strict=False):
            found += [
                AtBound(name, side, ends[i], ratio) for i, side, ratio in _leans(column, ends)
            ]
    for index, unknown in enumerate(space.unknowns[k:], start=k):
        ends = bounds[index]
        for i, side, ratio in _leans(draws[:, index], ends):
            found.append(AtBound(unknown.name, side, float(unknown.value(ends[i])), ratio))
    return tuple(found)


def _leans(values: Array, ends: Array) -> Iterator[tuple[int, str, float]]:
    """Ends (2,) by number and name on which values (n,) lean, with the density there."""
    for i, side, distance in ((0, "low", values - ends[0]), (1, "high", ends[1] - values)):
        sd = float(values.std())
        ratio = _density_at(distance, STRIP * sd)
        if ratio > SMALL and _density_at(distance, STRIP * min(sd, _own_sd(distance))) > SMALL:
            yield i, side, ratio


def _density_at(distance: Array, width: float) -> float:
    """Density over its maximum in the strip next to the bound, of a width."""
    # A posterior without width lies in one strip; it leans if that is the first.
    strips = np.floor(distance / max(width, np.finfo(float).tiny))
    counts = np.unique(strips, return_counts=True)[1]
    return float(np.sum(strips <= 0) / counts.max())


def _own_sd(distance: Array) -> float:
    """Least SD of the nearest half, quarter and eighth of the draws, as of parts of a normal."""
    found = []
    for share in (0.5, 0.25, 0.125):
        ends = share * np.array([0.16, 0.84])
        found.append(np.ptp(np.quantile(distance, ends)) / np.ptp(norm.ppf(ends)))
    return float(min(found))


def leaning_sentence(hypothesis: str, found: tuple[AtBound, ...]) -> str:
    """What leaning on bounds means for distances counted in SDs; empty where there is none."""
    if not found:
        return ""
    bounds = " and ".join(entry.text for entry in found)
    word = "bound" if len(found) == 1 else "bounds"
    convention = "The bound is" if len(found) == 1 else "These bounds are"
    return (
        f"Under {hypothesis} the posterior leans on the prior's {word} {bounds}. {convention} a "
        "convention of the prior, not a finding; SDs of a posterior that leans on a bound say "
        "little about distance."
    )
