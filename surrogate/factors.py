"""Designs over named factors: continuous ones in their own coordinates, discrete ones in turn."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from surrogate.design import Sequence as Points
from surrogate.design import check_count, unit_design

Array = npt.NDArray[np.float64]

N_HALVINGS = 52
"""of [0, 1] in the search for the probability of a bound: quantiles at 0 and 1 are never asked for,
which may be infinite"""
LEAST_SHARE = 1e-9
"""probability that a prior must have between the bounds: quantiles are not known closer"""


@dataclass(frozen=True)
class Factor:
    """A continuous factor between `low` and `high`, spread evenly or as a prior has it."""

    name: str
    low: float
    high: float
    inverse_cdf: Callable[[Array], Array] | None = None
    """quantiles (n,) of a prior at probabilities (n,), which grow; the design is then uniform in
    its probability between the bounds"""

    def __post_init__(self) -> None:
        if not (np.isfinite([self.low, self.high]).all() and self.low < self.high):
            raise ValueError(
                f"{self.name}: expected finite low < high, found {self.low} and {self.high}"
            )
        if self.inverse_cdf is not None:
            below_low, below_high = self._probabilities
            if not below_high - below_low > LEAST_SHARE:
                raise ValueError(
                    f"{self.name}: expected bounds that hold some of its prior's probability, "
                    f"found less than {LEAST_SHARE:g} between {self.low} and {self.high}"
                )

    def values(self, unit: Array) -> Array:
        """Factor at places (n,) of the unit interval; its ends are the bounds of the design."""
        if self.inverse_cdf is None:
            return self.low + (self.high - self.low) * unit
        below_low, below_high = self._probabilities
        inside = self.inverse_cdf(below_low + (below_high - below_low) * unit)
        # A prior may end before a bound does, and the box of a design is that of its corners.
        ends = np.where(unit == 0.0, self.low, np.where(unit == 1.0, self.high, inside))
        return np.clip(ends, self.low, self.high)

    @cached_property
    def _probabilities(self) -> tuple[float, float]:
        """Probabilities of the prior below `low` and below `high`, by halving [0, 1]."""
        assert self.inverse_cdf is not None
        first, last = np.zeros(2), np.ones(2)
        for _ in range(N_HALVINGS):
            middle = 0.5 * (first + last)
            value = self.inverse_cdf(middle)
            below = np.array([value[0] < self.low, value[1] <= self.high])
            first, last = np.where(below, middle, first), np.where(below, last, middle)
        return float(last[0]), float(first[1])


@dataclass(frozen=True)
class Levels:
    """A discrete factor, as the shape of the pin or the kind of contact."""

    name: str
    levels: tuple[str, ...]

    def __post_init__(self) -> None:
        if len(self.levels) < 2 or len(set(self.levels)) != len(self.levels):
            raise ValueError(
                f"{self.name}: expected two or more different levels, found {self.levels}"
            )


class Column(Protocol):
    """What a column of a campaign holds: a factor by its name; a discrete one has `levels`, too."""

    @property
    def name(self) -> str:
        """The factor's."""
        ...


@dataclass(frozen=True)
class Design:
    """Points over continuous and discrete factors."""

    names: tuple[str, ...]
    """continuous factors"""
    values: Array
    """(n, d)"""
    discrete_names: tuple[str, ...]
    levels: tuple[tuple[str, ...], ...]
    """n combinations of the levels of the discrete factors"""

    def theta(self, columns: Sequence[Column]) -> Array:
        """(n, d) values of the columns in their order; of a discrete one the index of its level.

        As campaigns take them: `columns` are their parameters, or the factors that the design was
        made of, in any order. A level is looked for by its name among those of the column.
        Raises ValueError for names that are not those of the factors, and levels that a column
        does not have.
        """
        names, expected = [column.name for column in columns], self.names + self.discrete_names
        if sorted(names) != sorted(expected):
            raise ValueError(f"columns: expected {', '.join(expected)}, found {', '.join(names)}")
        return np.column_stack([self._column(column) for column in columns])

    def _column(self, column: Column) -> Array:
        """(n,) values of one factor."""
        if column.name in self.names:
            return self.values[:, self.names.index(column.name)]
        place = self.discrete_names.index(column.name)
        known: Sequence[str] = getattr(column, "levels", ())
        missing = sorted({levels[place] for levels in self.levels} - set(known))
        if missing:
            raise ValueError(
                f"{column.name}: expected a column with the levels of the design, found "
                f"{', '.join(missing)} not among {', '.join(known) or 'none'}"
            )
        return np.array([known.index(levels[place]) for levels in self.levels], dtype=np.float64)

    def rows(self, combination: tuple[str, ...]) -> npt.NDArray[np.int64]:
        """Rows with a combination of levels."""
        return np.array([i for i, own in enumerate(self.levels) if own == combination], dtype=int)


def design(
    factors: Sequence[Factor | Levels],
    n: int,
    seed: int,
    *,
    sequence: Points = "sobol",
    n_corners: int | None = 0,
    n_faces: int = 0,
) -> Design:
    """Points over the factors, nested: the first n of a larger design are this one.

    The combinations of levels take turns, and the points of each are a nested design of their own
    in the continuous factors (with another scrambling), so that every combination is covered from
    the start and grows evenly. See `surrogate.design` for the other arguments.
    Raises ValueError for n < 1, names that occur twice or no continuous factor.
    """
    continuous = [factor for factor in factors if isinstance(factor, Factor)]
    discrete = [factor for factor in factors if isinstance(factor, Levels)]
    names = [factor.name for factor in factors]
    check_count(n)
    if len(set(names)) != len(names) or not continuous:
        raise ValueError(f"factors: expected different names, one continuous, found {names}")
    combinations = list(itertools.product(*(factor.levels for factor in discrete)))
    unit = np.empty((n, len(continuous)))
    seeds = np.random.SeedSequence(seed).generate_state(len(combinations))
    for place, own_seed in enumerate(seeds[:n]):
        own = np.arange(place, n, len(combinations))
        unit[own] = unit_design(
            len(own),
            len(continuous),
            int(own_seed),
            sequence=sequence,
            n_corners=n_corners,
            n_faces=n_faces,
        )
    columns = [factor.values(unit[:, axis]) for axis, factor in enumerate(continuous)]
    return Design(
        names=tuple(factor.name for factor in continuous),
        values=np.column_stack(columns),
        discrete_names=tuple(factor.name for factor in discrete),
        levels=tuple(combinations[i % len(combinations)] for i in range(n)),
    )
