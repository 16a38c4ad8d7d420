"""What readers of MATLAB files expect of a value, and the refusal where it is something else."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.data.readers.matlab5 import Value
from calib.data.readers.wrong_file import WrongFile, shown
from fe.response import Array


def field(path: Path, value: Value, *names: str) -> Value:
    """A field of nested structs; raises WrongFile where one is missing."""
    for depth, name in enumerate(names):
        if not isinstance(value, dict) or name not in value:
            raise WrongFile(path, None, f"a field {'.'.join(names[: depth + 1])}", kind(value))
        value = value[name]
    return value


def as_list(value: Value) -> list[Value]:
    """A cell or array of structs; a single one counts as one of one."""
    return value if isinstance(value, list) else [value]


def as_matrix(path: Path, name: str, value: Value, columns: int | None = None) -> Array:
    """A real matrix in doubles, with so many columns; raises WrongFile else."""
    is_matrix = isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind in "fiub"
    if not is_matrix or value.size == 0 or columns not in (None, value.shape[1]):
        width = "any number of" if columns is None else f"{columns}"
        raise WrongFile(path, None, f"{name} as numbers with {width} columns", kind(value))
    return np.asarray(value, dtype=np.float64)


def as_number(path: Path, name: str, value: Value) -> float:
    """A finite scalar; raises WrongFile else."""
    if isinstance(value, np.ndarray) and value.size == 1 and value.dtype.kind in "fiub":
        scalar = float(value.ravel()[0])
        if np.isfinite(scalar):
            return scalar
    raise WrongFile(path, None, f"{name} as one finite number", kind(value))


def kind(value: Value) -> str:
    """What a value is, for a sentence."""
    match value:
        case np.ndarray():
            if value.size == 1:
                return f"the value {value.ravel()[0]!s}"
            return f"an array {value.shape} of {value.dtype}"
        case str():
            return shown(value)
        case dict():
            return f"a struct with {shown(', '.join(value))}"
        case list():
            return f"a list of {len(value)}"
        case _:
            return type(value).__name__
