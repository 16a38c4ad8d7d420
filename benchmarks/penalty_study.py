"""What the compliance of the contact costs: forces of the fitting meshes with stiffer penalties.

    python -m benchmarks.penalty_study [--case CASE ...] [--factors 1 4 16] [--sampling]

A contact point resists by k m^2 / (2 a) at a penetration m up to the ramp a, and by k (m - a / 2)
beyond; k is 6667 mu / mm and a 0.1 mm by default.  Meshes refine everything but that, so no grid
convergence index tells of it.  Forces with k 4 and 16 times as large against the default, bar pin,
r = 0.5, s = 0.05, kappa = 1 MPa, one thread.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from benchmarks.meshes import FITTING_CELLS, SAMPLING_CELLS
from fe import BlockPin, BlockPinModel, Contact, Response
from fe.contact import PenaltyLaw

TRAVEL = (0.6, 0.8, 1.0, 1.2, 1.4)
RATIOS = np.array([0.5, 0.05])
CASES = {
    "bar, frictionless": Contact("slide", "slide"),
    "bar, friction": Contact(0.3, 0.3),
    "bar, stick": Contact("stick", "stick"),
}


def main(arguments: list[str] | None = None) -> None:
    """Print a row for each case and factor."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.penalty_study", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--case", nargs="+", choices=CASES, default=list(CASES), metavar="CASE")
    parser.add_argument("--factors", nargs="+", type=float, default=[1.0, 4.0, 16.0])
    parser.add_argument("--sampling", action="store_true", help="on the sampling meshes")
    options = parser.parse_args(arguments)
    cells = SAMPLING_CELLS if options.sampling else FITTING_CELLS
    travels = " | ".join(f"{t:g} mm" for t in TRAVEL)
    print(f"| case | stiffness | {travels} | field, mm RMS | |")
    print("|" + "---|" * (len(TRAVEL) + 4))
    for case in options.case:
        first: Response | None = None
        for factor in options.factors:
            law = PenaltyLaw()
            model = BlockPinModel(
                BlockPin(),
                CASES[case],
                cells[case],
                TRAVEL,
                penalty=replace(law, stiffness=factor * law.stiffness),
                sensitivities=(),
            )
            found = model(RATIOS)
            first = found if first is None else first
            print(_row(case, factor, found, first), flush=True)


def _row(case: str, factor: float, found: Response, first: Response) -> str:
    """Forces in N of the first, else in % of its; RMS difference of the field at each travel."""
    if found is first:
        cells, off = [f"{force:.2f} N" for force in found.force], ""
    else:
        cells = [f"{100 * off:+.2f} %" for off in found.force / first.force - 1.0]
        square = np.mean((found.displacement - first.displacement) ** 2, axis=(1, 2))
        off = ", ".join(f"{value:.4f}" for value in np.sqrt(square))
    return f"| {case} | {factor:g} | {' | '.join(cells)} | {off} | {found.message} |"


if __name__ == "__main__":
    main()
