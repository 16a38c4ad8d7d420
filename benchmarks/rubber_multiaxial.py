"""Every law fitted to classical uniaxial, equibiaxial and pure-shear tests of rubber.

    python -m benchmarks.rubber_multiaxial [largest stretch]

The misfit is the norm of the errors over that of the stresses.  A pair of large mu that cancels, or
an exponent at its bound, says that the data do not need that term.

The data (digitised from Treloar 1944, Kawabata 1981, Meunier 2008 and Kawamura 2001 by the
repository Chongran-Zhao/Calibration-Hyperelasticity on GitHub, MIT licence) are no part of
softcal: SOFTCAL_RUBBER_DATA names their folder, else ../shared/data/rubber_multiaxial is read.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np

from fe.homogeneous_fit import Fit, HomogeneousTests, fit, judge
from fe.materials import LAWS

KINDS = ("UT", "UC", "ET", "PS")
MATERIALS = ("Treloar_1944", "Kawabata_1981", "Meunier_2008", "Kawamura_2001")
OGDEN_1972 = np.array([0.63, 1.3, 0.0012, 5.0, -0.01, -2.0])
"""constants of ogden-3 (MPa) for Treloar's rubber, meant for stretches up to 7: Ogden, Proc. R.
Soc. A 326, 1972; in these units Holzapfel, Nonlinear Solid Mechanics, 2000, section 6.5"""


def folder() -> Path:
    """Where the data are, or would be."""
    beside = Path(__file__).parents[2] / "shared" / "data" / "rubber_multiaxial"
    return Path(os.environ.get("SOFTCAL_RUBBER_DATA", beside))


def read_tests(material: str, largest_stretch: float = np.inf) -> HomogeneousTests:
    """All uniaxial, equibiaxial and pure-shear points up to a stretch, without the unloaded."""
    paths = [folder() / f"{material}_{kind}.csv" for kind in KINDS]
    rows = np.vstack([np.loadtxt(p, delimiter=",", skiprows=1) for p in paths if p.exists()])
    rows = rows[(rows[:, 3] != 0.0) & (rows[:, 0] <= largest_stretch)]
    return HomogeneousTests(stretches=rows[:, :3], stress=rows[:, 3])


def line(name: str, found: Fit) -> str:
    """One row of the table."""
    constants = ", ".join(
        f"{n} {c:.4g}" for n, c in zip(found.law.constant_names, found.constants, strict=True)
    )
    mu = found.law.shear_modulus(found.constants)
    percent, kilopascal = 100.0 * found.relative, 1000.0 * found.rms
    return f"| {name} | {percent:.1f} | {kilopascal:.1f} | {mu:.4f} | {constants} |"


def main(arguments: list[str]) -> None:
    """Print one table a material."""
    largest = float(arguments[0]) if arguments else np.inf
    for material in MATERIALS:
        tests = read_tests(material, largest)
        least, most = tests.stretches[:, 0].min(), tests.stretches[:, 0].max()
        print(f"\n{material}, {tests.stress.size} points, stretch {least:.2f} to {most:.2f}\n")
        print("| law | misfit % | rms kPa | mu MPa | constants (MPa, exponents without unit) |")
        print("|---|---|---|---|---|")
        for name, law in LAWS.items():
            print(line(name, fit(law, tests)), flush=True)
        if material == "Treloar_1944":
            print(line("ogden-3 of 1972", judge(LAWS["ogden-3"], OGDEN_1972, tests)))


if __name__ == "__main__":
    main(sys.argv[1:])
