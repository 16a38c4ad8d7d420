"""Units as programs write them, and the factors that bring values to mm, N and s."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.data.readers.wrong_file import WrongFile, shown
from fe.response import Array

LENGTH = {
    "mm": 1.0, "cm": 10.0, "m": 1e3, "um": 1e-3, "µm": 1e-3, "μm": 1e-3, "nm": 1e-6,
    "in": 25.4, "inch": 25.4, "inches": 25.4,
}  # fmt: skip
FORCE = {
    "N": 1.0, "kN": 1e3, "mN": 1e-3, "daN": 10.0, "MN": 1e6,
    "gf": 9.80665e-3, "kgf": 9.80665, "lbf": 4.4482216152605,
}  # fmt: skip
TIME = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
TARGET = {"length": ("mm", LENGTH), "force": ("N", FORCE), "time": ("s", TIME)}
LARGEST = {"length": 1e6, "force": 1e9, "time": 1e10}
"""what no measurement reaches, in mm, N and s: a kilometre, 100,000 tonnes, 300 years"""


def factor(path: Path, line: int, column: str, kind: str, unit: str | None) -> float:
    """What values of a column are multiplied by to be in mm, N or s (`kind` names which).

    Raises WrongFile where the unit is missing or of another kind, as volts for a force.
    """
    target, known = TARGET[kind]
    if unit in known:
        return known[unit]
    found = f"no unit in {shown(column)}" if not unit else f"{shown(unit)} in {shown(column)}"
    raise WrongFile(
        path, line, f"a unit of {kind} ({', '.join(known)}) to bring to {target}", found
    )


def scaled(values: Array, by: float) -> Array:
    """Values times a factor; what overflows becomes infinite and is refused later."""
    if by == 1.0:
        return values
    with np.errstate(over="ignore"):
        return values * by
