"""Checks of numbers, and of options that are numbers above 0."""

from __future__ import annotations

import math
from dataclasses import fields
from numbers import Integral, Real
from typing import Any, TypeGuard

import numpy as np
import numpy.typing as npt


def is_number(value: object) -> TypeGuard[float]:
    """Whether it is a real number, Python's or numpy's; a truth value is none."""
    return isinstance(value, Real) and not isinstance(value, bool)


def as_numbers(values: object) -> npt.NDArray[np.float64] | None:
    """An array of real numbers as floats; None for rows of several lengths and for anything else.

    Truth values, texts and complex numbers are no real numbers.
    """
    if isinstance(values, np.ndarray) and values.dtype.kind in "fiu":
        return values.astype(np.float64)
    found = np.asarray(values, dtype=object)  # else a truth value beside numbers becomes one
    return found.astype(np.float64) if all(map(is_number, found.ravel())) else None


def positive_numbers(options: Any) -> None:
    """Raise ValueError for a field of a dataclass that is not a finite number above 0.

    One that is declared as an int is whole.
    """
    for field in fields(options):
        value = getattr(options, field.name)
        if not (is_number(value) and 0.0 < value < math.inf):
            raise ValueError(f"{field.name}: expected a finite number above 0, found {value!r}")
        if field.type in (int, "int") and not isinstance(value, Integral):
            raise ValueError(f"{field.name}: expected a whole number above 0, found {value!r}")
