"""Measure what docs/verification/fe.json states about the FE model, part by part.

    python -m benchmarks.verify_fe [--only PART ...] [--cases CASE ...] [--draws 200] [--workers 1]
        [--out FILE]

Parts: felupe, calculix, taylor (a minute each), calculix_contact (25 minutes), turned (bars, five
minutes), gci and bounds (ten minutes each), directions (the fitting meshes refined in one
coordinate at a time, an hour), sobol (200 draws over pins and contacts on the sampling meshes, half
an hour), sobol_fitting (20 of them on the fitting meshes, an hour or more).  Each part replaces its
own figures in FILE and leaves the others; every simulation but those of the first five is kept
under --runs, so an interrupted part goes on where it was.  With --cases ("round, stick" ...) gci
and directions replace the figures of these cases alone.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # read when numpy and MKL are loaded
if __name__ == "__main__" and not __package__:
    # as a script, this folder comes first on the path, and benchmarks/fe.py would hide `fe`
    sys.path[0] = str(Path(__file__).resolve().parents[1])

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from benchmarks import (
    convergence_study,
    directional_index,
    grid_convergence,
    mesh_uncertainty,
    taylor,
    turned_bars,
)
from benchmarks.grid_convergence import CASES
from benchmarks.mesh_convergence import Case
from benchmarks.stuck_patch import StuckPatch, press

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "docs" / "verification" / "fe.json"
LAW = (0.004, 0.008, 0.003)
MU = 2.0 * (LAW[0] + LAW[1])


@dataclass(frozen=True)
class Settings:
    """What the parts need from the command line."""

    runs: Path
    """folder of finished simulations"""
    draws: int
    workers: int
    cases: tuple[Case, ...] = CASES
    """of gci and directions"""


def felupe(settings: Settings) -> dict[str, Any]:
    """Same mesh, element and law: distorted hexahedra, sharp footprint and dimple."""
    from benchmarks import felupe_patch

    worst = 0.0
    for dimple in (False, True):
        case = StuckPatch(
            (4, 4, 4, 4),
            (0.1, 0.2, 0.3, 0.4),
            constants=LAW,
            bulk=200 * MU,
            dimple=dimple,
            distortion=0.2,
        )
        worst = max(worst, press(case).error_percent(felupe_patch.press(case).force))
    return {"felupe_force_difference_percent": worst}


def calculix(settings: Settings) -> dict[str, Any]:
    """C3D20R on the same bricks: the dimple at three compressibilities, on two meshes each."""
    from benchmarks import calculix_patch

    if not calculix_patch.available():
        print("ccx is not installed: calculix is left as it was")
        return {}
    table = []
    for bulk_ratio in (2.0, 10.0, 200.0):
        for n in (3, 6):
            case = StuckPatch(
                (n, n, n, 2 * n),
                (0.2, 0.4),
                constants=LAW,
                bulk=bulk_ratio * MU,
                dimple=True,
                footprint=2.5,
            )
            difference = press(case).error_percent(calculix_patch.press(case).force)
            elements = [2 * n, n, 2 * n]
            table.append({"bulk_over_mu": bulk_ratio, "elements": elements, "percent": difference})
    stated = [row["percent"] for row in table if row["bulk_over_mu"] == 10.0][-1]
    return {"calculix_force_difference_percent": stated, "calculix_force_differences": table}


def calculix_contact(settings: Settings) -> dict[str, Any]:
    """The block under bar and round pin with CalculiX's own contact, sliding and with friction."""
    from benchmarks import calculix
    from benchmarks import calculix_contact as cases

    if not calculix.available():
        print("ccx is not installed: calculix_contact is left as it was")
        return {}
    return cases.figures()


def taylor_orders(settings: Settings) -> dict[str, Any]:
    """Sensitivities: order of the Taylor remainder, direct against adjoint, cost; by contact."""
    return taylor.figures()


def turned(settings: Settings) -> dict[str, Any]:
    """Force under a turned bar on two meshes, by contact and angle."""
    return turned_bars.figures()


def gci(settings: Settings) -> dict[str, Any]:
    """Grid convergence index of force and field by contact and increment."""
    return grid_convergence.figures(settings.runs / "gci", settings.cases)


def bounds(settings: Settings) -> dict[str, Any]:
    """Uncertainty of the bar's fitting meshes by least squares, by contact and increment."""
    return mesh_uncertainty.figures(settings.runs / "gci")


def directions(settings: Settings) -> dict[str, Any]:
    """Index of the fitting meshes, refined one coordinate at a time, by contact and increment."""
    return directional_index.figures(settings.runs / "gci", settings.cases)


def sobol(settings: Settings) -> dict[str, Any]:
    """Fraction of Sobol draws that reach 1.4 and 1.8 mm, by pin and contact."""
    return convergence_study.figures(settings.runs / "sobol", settings.draws, settings.workers)


def sobol_fitting(settings: Settings) -> dict[str, Any]:
    """The same of the first tenth of the draws, on the fitting meshes."""
    folder, n, workers = settings.runs / "sobol", settings.draws, settings.workers
    return convergence_study.figures(folder, n, workers, "fitting")


PARTS: dict[str, Callable[[Settings], dict[str, Any]]] = {
    "felupe": felupe,
    "calculix": calculix,
    "calculix_contact": calculix_contact,
    "taylor": taylor_orders,
    "turned": turned,
    "gci": gci,
    "bounds": bounds,
    "directions": directions,
    "sobol": sobol,
    "sobol_fitting": sobol_fitting,
}

BY_CASE = ("gci", "directions")
"""parts whose figures are by case"""


def main(arguments: list[str] | None = None) -> None:
    """Measure the parts asked for and merge their figures into the file."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.verify_fe", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART")
    names = [str(case) for case in CASES]
    parser.add_argument("--cases", nargs="+", choices=names, default=names, metavar="CASE")
    parser.add_argument("--draws", type=int, default=200, help="of the Sobol study")
    parser.add_argument("--workers", type=int, default=1, help="processes of the Sobol study")
    parser.add_argument("--runs", type=Path, default=ROOT / "runs" / "verify-fe")
    parser.add_argument("--out", type=Path, default=OUT, metavar="FILE")
    options = parser.parse_args(arguments)
    cases = tuple(case for case in CASES if str(case) in options.cases)
    settings = Settings(options.runs, options.draws, options.workers, cases)
    for name in options.only:
        print(f"{name}:", flush=True)
        merge(options.out, PARTS[name](settings), by_case=cases != CASES and name in BY_CASE)
    print(f"written to {options.out}")


def merge(path: Path, figures: dict[str, Any], *, by_case: bool = False) -> None:
    """Replace these figures in the file, `by_case` those of their cases; print them."""
    print(json.dumps(figures, indent=2), flush=True)
    known = json.loads(path.read_text()) if path.exists() else {}
    if by_case:
        figures = {key: known.get(key, {}) | value for key, value in figures.items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(known | figures, indent=2, sort_keys=True) + "\n")


if __name__ == "__main__":
    main()
