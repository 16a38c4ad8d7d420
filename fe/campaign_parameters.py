"""Named parameters of a campaign: the columns of its design."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from reprlib import repr as shortened

import numpy as np
import numpy.typing as npt

from fe.positive_numbers import as_numbers

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Parameter:
    """One column of a design `theta` (n, d).

    A discrete factor has `levels` and is held in theta as the index of its level. `role` says for
    readers what the parameter belongs to: "material", "contact", "geometry", or "factor" for a
    discrete one. Raises ValueError for an empty name and for fewer than two or equal levels.
    """

    name: str
    unit: str
    """"1" for a number without unit"""
    role: str
    levels: tuple[str, ...] = ()
    """names of the values of a discrete factor; none for a continuous parameter"""

    def __post_init__(self) -> None:
        if not self.name:
            raise ValueError("name: expected the name of a parameter, found none")
        if self.levels and (len(self.levels) < 2 or len(set(self.levels)) < len(self.levels)):
            raise ValueError(
                f"levels: expected two or more different levels of {self.name}, found {self.levels}"
            )

    def level(self, value: float) -> str:
        """The level that theta holds as `value`.

        Raises ValueError for a value that is no index of a level.
        """
        if value not in range(len(self.levels)):
            raise ValueError(
                f"{self.name}: expected the index of one of {', '.join(self.levels)} "
                f"(0 to {len(self.levels) - 1}), found {value:g}"
            )
        return self.levels[int(value)]

    def text(self, value: float) -> str:
        """The value for readers: a level by its name, else a number of six digits."""
        return self.level(value) if self.levels else f"{value:.6g}"


RATIOS = (Parameter("r", "1", "material"), Parameter("s", "1", "material"))
"""r = C01 / kappa and s = C11 / kappa at kappa = C10 + C01 = 1 MPa"""


def checked_theta(theta: npt.ArrayLike, parameters: Sequence[Parameter]) -> Array:
    """A copy of the design as (n, d) floats.

    Raises ValueError for a design that is not one column a parameter, values that are not finite,
    values of a factor that are no index of a level, and parameters of the same name.
    """
    names = [parameter.name for parameter in parameters]
    if len(set(names)) < len(names) or not names:
        raise ValueError(f"parameters: expected different names, found {', '.join(names) or None}")
    copy = as_numbers(theta)
    if copy is None:
        raise ValueError(
            f"theta: expected an (n, d) array of real numbers, found {shortened(theta)}"
        )
    if copy.ndim != 2 or copy.size == 0:
        raise ValueError(f"theta: must be a non-empty (n, d) array, got shape {copy.shape}")
    if copy.shape[1] != len(names):
        raise ValueError(
            f"theta: expected {len(names)} columns ({', '.join(names)}), found {copy.shape[1]}"
        )
    if not np.isfinite(copy).all():
        row = int(np.flatnonzero(~np.isfinite(copy).all(axis=1))[0])
        raise ValueError(f"theta: must be finite, got {copy[row].tolist()} in row {row}")
    for column, parameter in zip(copy.T, parameters, strict=True):
        if parameter.levels:
            for value in column:
                parameter.level(value)
    return copy


def as_json(parameters: Sequence[Parameter]) -> list[dict[str, object]]:
    """The parameters as JSON values."""
    return [asdict(parameter) | {"levels": list(parameter.levels)} for parameter in parameters]


def from_json(found: list[dict[str, object]]) -> tuple[Parameter, ...]:
    """What `as_json` wrote; raises KeyError, TypeError or ValueError for anything else."""
    return tuple(
        Parameter(
            str(entry["name"]),
            str(entry["unit"]),
            str(entry["role"]),
            tuple(str(level) for level in _list(entry["levels"])),
        )
        for entry in found
    )


def _list(value: object) -> list[object]:
    if not isinstance(value, list):
        raise TypeError(f"levels: expected a list, found {value!r}")
    return value
