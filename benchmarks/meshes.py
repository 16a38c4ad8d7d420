"""The meshes that the benchmarks call sampling and fitting mesh, by pin: change them here."""

from __future__ import annotations

from typing import Literal

Cells = tuple[int, int, int]
Pin = Literal["bar", "round"]

SAMPLING_CELLS: dict[Pin, Cells] = {"bar": (12, 4, 2), "round": (8, 4, 8)}
"""of a design sample: Q2 elements of a quarter along x, y, z"""
FITTING_CELLS: dict[Pin, Cells] = {"bar": (24, 8, 3), "round": (12, 6, 12)}
"""of the runs that a fit is checked or corrected with"""
