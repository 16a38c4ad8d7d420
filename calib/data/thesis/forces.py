"""What Tables 5.1, 5.3 and 5.4 of the thesis amount to: forces and constants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.data.dataset import Dataset
from calib.data.thesis.tables import thesis_table
from fe.response import Array

TRAVEL_PER_INCREMENT = 0.2  # mm, thesis section 4.1.2
N_SAMPLES = 23  # thesis section 5.1
SCALE = np.array([1e-3, 1e-2, 1e-4])  # C = scale * SC; Eqs. 5.1-5.3 print the inverse exponent


@dataclass(frozen=True)
class OptimizationRuns:
    """Thesis Table 5.3: nine starts of the optimizer, constants unscaled to MPa."""

    start: Array
    """(9, 3) constants (C10, C01, C11) put in, MPa"""
    result: Array
    """(9, 3) constants (C10, C01, C11) reached, MPa"""
    rmse: Array
    """(9,) displacement RMSE reached, mm"""


def thesis_forces() -> Dataset:
    """Thesis Table 5.1: force at increments 3-7 (0.6 to 1.4 mm), mean and SD of 23 samples, N."""
    table = thesis_table("Table 5.1")
    # Rounded so that the travels are the doubles one would write: 0.6, not 0.6000000000000001.
    travel = np.round(TRAVEL_PER_INCREMENT * table.numbers("increment"), 10)
    return Dataset(
        name="thesis Table 5.1",
        synthetic=False,
        travel=travel,
        force_mean=table.numbers("average_N"),
        force_sd=table.numbers("standard_deviation_N"),
        n_samples=N_SAMPLES,
    )


def optimization_runs() -> OptimizationRuns:
    """Thesis Table 5.3, unscaled to MPa."""
    table = thesis_table("Table 5.3")
    names = ("SC10", "SC01", "SC11")
    start = np.column_stack([table.numbers(f"{name}_I") for name in names]) * SCALE
    result = np.column_stack([table.numbers(f"{name}_O") for name in names]) * SCALE
    return OptimizationRuns(start, result, table.numbers("RMSE_mm"))


def published_constants() -> dict[str, float]:
    """Thesis Table 5.4: C10, C01, C11 in MPa (unit implied)."""
    table = thesis_table("Table 5.4")
    return dict(zip(table.cells("variable"), table.numbers("value_MPa").tolist(), strict=True))


def stated_average() -> dict[str, float]:
    """What section 5.4 says Table 5.4 is: the mean of the runs with RMSE 0.1559, MPa.

    It is not: Table 5.4 repeats the result of starts 2 and 3.
    """
    runs = optimization_runs()
    mean = runs.result[runs.rmse == 0.1559].mean(axis=0)
    return dict(zip(("C10", "C01", "C11"), mean.tolist(), strict=True))


PUBLISHED_CONSTANTS = published_constants()
"""C10, C01, C11 of thesis Table 5.4, MPa"""
