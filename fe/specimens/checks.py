"""Checks of the numbers that specimens and their models have in common."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any

import numpy as np

from fe.positive_numbers import is_number


def check_lengths(dimensions: Any) -> None:
    """Raise ValueError for a field of a dataclass of lengths that is not finite and above 0 mm."""
    for field in fields(dimensions):
        check_length(field.name, getattr(dimensions, field.name))


def check_length(name: str, value: float) -> None:
    """Raise ValueError for a length that is not finite and above 0 mm."""
    if not (is_number(value) and 0.0 < value < math.inf):
        raise ValueError(f"{name}: expected a length above 0 mm, found {value!r}")


def check_kinds(model: Any, **kinds: type) -> None:
    """Raise ValueError for a field of a model that is not of the kind given for its name."""
    for name, kind in kinds.items():
        found = getattr(model, name)
        if not isinstance(found, kind):
            raise ValueError(f"{name}: expected {kind.__name__}(...), found {found!r}")


def check_counts(name: str, found: object, least: int | tuple[int, ...]) -> None:
    """Raise ValueError unless these are as many whole numbers as in `least`, none below it."""
    try:
        numbers = np.asarray(found)
    except ValueError:  # rows of several lengths
        numbers = np.asarray(None)
    fits = numbers.shape == np.shape(least) and numbers.dtype.kind == "i"
    if not (fits and (numbers >= least).all()):
        what = "a whole number" if isinstance(least, int) else f"{len(least)} whole numbers"
        raise ValueError(f"{name}: expected {what} of at least {least}, found {found}")


def keep_counts(model: object, name: str, least: tuple[int, ...]) -> None:
    """Check such a field of a frozen model, and make it a tuple of ints, which does not change."""
    check_counts(name, getattr(model, name), least)
    object.__setattr__(model, name, tuple(int(n) for n in getattr(model, name)))


def check_travel(travel: tuple[float, ...], length: float, name: str) -> None:
    """Raise ValueError for a travel, mm, that leaves nothing of a length, mm, of that name."""
    if max(travel, default=0.0) >= length:
        raise ValueError(f"travel: expected less than the {name} {length} mm, found {travel[-1]}")


def check_bulk_ratio(bulk_ratio: float) -> None:
    """Raise ValueError for a bulk modulus over mu that is not finite and above 0."""
    if not (is_number(bulk_ratio) and 0.0 < bulk_ratio < math.inf):
        raise ValueError(f"bulk_ratio: expected a finite ratio above 0, found {bulk_ratio!r}")
