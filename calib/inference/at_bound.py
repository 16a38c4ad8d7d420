"""Which bounds of the prior a posterior leans on, so that its SD says little about distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.inference.coordinates import Space
from fe.response import Array

STRIP = 0.25
"""width of the strips in which densities are compared, in posterior SDs"""
SMALL = float(np.exp(-2.0))
"""density over its maximum below which a bound is not felt: that of a normal two SDs out"""

UNITS = {
    "kappa": "MPa",
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


def at_bound(draws: Array, bounds: Array, space: Space | None = None) -> tuple[AtBound, ...]:
    """Bounds (d, 2) of x = (ln kappa, r, s, ...) on which posterior draws (n, d) lean.

    The marginal density is taken in strips of a quarter of the posterior SD, counted from the
    bound: the posterior leans on the bound when the first strip holds more than exp(-2) times
    what the fullest one holds. A bound further out than all draws has an empty first strip.
    """
    found = []
    for index, unknown in enumerate((space or Space()).unknowns):
        values = draws[:, index]
        width = STRIP * float(values.std())
        for side, bound, distance in (
            ("low", bounds[index, 0], values - bounds[index, 0]),
            ("high", bounds[index, 1], bounds[index, 1] - values),
        ):
            # A posterior without width lies in one strip; it leans if that is the first.
            strips = np.floor(distance / max(width, np.finfo(float).tiny))
            counts = np.unique(strips, return_counts=True)[1]
            ratio = float(np.sum(strips <= 0) / counts.max())
            if ratio > SMALL:
                value = float(unknown.value(bound))
                found.append(AtBound(unknown.name, side, value, ratio))
    return tuple(found)


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
