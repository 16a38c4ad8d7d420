"""Stiffness of Ecoflex 00-30 from compressed cylinders under rival plate frictions.

    python -m benchmarks.cylinder_friction

For each contact and each r = C01 / (C10 + C01) of a Mooney-Rivlin law with two constants, the
axisymmetric model gives the force at kappa = C10 + C01 = 1 MPa; kappa then follows by least squares
of the relative misfit to the mean of five tests.  The best r of each contact is printed.

The data (Dawood et al. 2026, CC BY 4.0, repository abubakardawood/tissue-phantom-material-database
on GitHub) are no part of softcal: SOFTCAL_CYLINDER_DATA names their folder, else
../shared/data/ecoflex_compression_cylinders is read.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from fe import Cylinder, CylinderModel

Array = npt.NDArray[np.float64]

TRAVEL = (1.5, 3.0, 6.0, 9.0, 12.0, 15.0)
CELLS = (8, 6)
RATIOS = (0.0, 0.25, 0.5, 0.75, 1.0)
CONTACTS: tuple[tuple[Literal["bonded", "slide"], float], ...] = (
    ("slide", 0.0),
    ("slide", 0.05),
    ("slide", 0.1),
    ("slide", 0.2),
    ("slide", 0.5),
    ("bonded", 0.0),
)


def folder() -> Path:
    """Where the data are, or would be."""
    beside = Path(__file__).parents[2] / "shared" / "data" / "ecoflex_compression_cylinders"
    return Path(os.environ.get("SOFTCAL_CYLINDER_DATA", beside))


def mean_force() -> Array:
    """(n,) mean force of the five tests at TRAVEL, N."""
    forces = []
    for i in range(1, 6):
        rows = np.genfromtxt(folder() / f"EF30_0T_A{i}.csv", delimiter=",", skip_header=8)
        forces.append(np.interp(TRAVEL, rows[:, 1], rows[:, 2]))
    return np.mean(forces, axis=0)


def main() -> None:
    """Print one row a contact: best r, kappa, misfit at every travel."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    measured = mean_force()
    print("measured, N: " + ", ".join(f"{f:.2f}" for f in measured) + "\n")
    print("| ends | friction | r | kappa kPa | misfit % |", end=" ")
    print(" | ".join(f"{t:g} mm %" for t in TRAVEL) + " |")
    print("|---|" + "---|" * (4 + len(TRAVEL)))
    for ends, friction in CONTACTS:
        rows = []
        for r in RATIOS:
            model = CylinderModel(Cylinder(), CELLS, TRAVEL, ends, friction)
            relative = model(np.array([r, 0.0])).force / measured
            kappa = relative.sum() / (relative @ relative)
            rows.append((float(np.sqrt(np.mean((kappa * relative - 1) ** 2))), r, kappa, relative))
        misfit, r, kappa, relative = min(rows, key=lambda row: row[0])
        errors = " | ".join(f"{100 * (kappa * x - 1):+.1f}" for x in relative)
        start = f"| {ends} | {friction:g} | {r:g} | {1e3 * kappa:.2f} | {100 * misfit:.1f} |"
        print(f"{start} {errors} |", flush=True)


if __name__ == "__main__":
    main()
