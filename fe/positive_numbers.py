"""The check of options that are numbers above 0."""

from __future__ import annotations

import math
from dataclasses import fields
from numbers import Real
from typing import Any


def positive_numbers(options: Any) -> None:
    """Raise ValueError for a field of a dataclass that is not a finite number above 0."""
    for field in fields(options):
        value = getattr(options, field.name)
        if not (isinstance(value, Real) and 0.0 < float(value) < math.inf):
            raise ValueError(f"{field.name}: expected a finite number above 0, found {value!r}")
