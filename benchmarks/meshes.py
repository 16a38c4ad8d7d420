"""What the benchmarks call sampling and fitting mesh, by pin and contact."""

from __future__ import annotations

from dataclasses import astuple
from typing import Literal

from fe import Rings

Cells = tuple[int, int, int]
Pin = Literal["bar", "round"]

SAMPLING_CELLS: dict[str, Cells | Rings] = {
    "bar, stick": (12, 5, 3),
    "bar, friction": (12, 3, 3),
    "bar, frictionless": (12, 4, 2),
    "round, stick": Rings(8, 4, 2),
    "round, friction": Rings(8, 2, 2),
    "round, frictionless": Rings(7, 4, 2),
}
"""of a design sample: Q2 elements of a quarter along x, y, z, or rings, layers, sectors where they
follow the rim of a round pin"""
EARLIER_SAMPLING_CELLS = SAMPLING_CELLS | {"bar, stick": (12, 6, 2)}
"""what pairs of meshes in docs/verification were made on"""
FITTING_CELLS: dict[str, Cells | Rings] = {
    "bar, stick": (20, 14, 5),
    "bar, friction": (16, 8, 4),
    "bar, frictionless": (16, 5, 4),
    "round, stick": Rings(16, 16, 2),
    "round, friction": Rings(18, 6, 2),
    "round, frictionless": Rings(12, 8, 2),
}
"""of the runs that a fit is checked or corrected with"""


def name_of(cells: Cells | Rings) -> str:
    """12x4x2 elements, or r12x8x2 rings, layers and sectors."""
    if isinstance(cells, Rings):
        return "r" + "x".join(map(str, astuple(cells)))
    return "x".join(map(str, cells))
