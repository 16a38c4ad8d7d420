"""What a simulation depends on besides the row of its design, as JSON values."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

NO_PHYSICS = {"fingerprint": False}
"""metadata of a dataclass field that says how a row is held, not what is solved for it: the names,
units, values and levels of a row are in the key of its run already"""


def fingerprint(simulate: object) -> dict[str, object]:
    """All that a model's result depends on besides its argument: its name and fields.

    Fields with the metadata `NO_PHYSICS` are left out, also those of dataclasses within.
    Raises TypeError when the model is not a dataclass, whose fields would say what it is, or has a
    field that JSON cannot hold.
    """
    if not is_dataclass(simulate) or isinstance(simulate, type):
        raise TypeError(
            f"simulate: expected a dataclass, found {type(simulate).__name__}; give fingerprint=, "
            "all that its results depend on besides their row"
        )
    return {"model": type(simulate).__qualname__, **_fields(simulate)}


def canonical_json(values: Mapping[str, object], what: str = "fingerprint") -> str:
    """One text for equal values, whatever the order of their keys; numpy's numbers are numbers.

    Raises ValueError, which begins with `what`, when they are not finite JSON values.
    """
    try:
        return json.dumps(values, sort_keys=True, allow_nan=False, default=_number)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"{what}: must consist of finite JSON values ({error}); convert arrays to lists"
        ) from error


def _number(value: object) -> object:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"found {type(value).__name__}")


def _fields(instance: Any) -> dict[str, object]:
    """Fields of a dataclass that the physics depends on, as JSON values."""
    return {
        field.name: _plain(getattr(instance, field.name))
        for field in fields(instance)
        if field.metadata.get("fingerprint", True)
    }


def _plain(value: object) -> object:
    if is_dataclass(value) and not isinstance(value, type):
        # Laws of two classes may have the same fields.
        return {"class": type(value).__qualname__} | _fields(value)
    if isinstance(value, np.generic | np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return repr(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    raise TypeError(
        f"simulate: expected fields that JSON can hold, found {type(value).__name__}; give "
        "fingerprint=, all that its results depend on besides their row"
    )
