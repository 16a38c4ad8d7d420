"""What the compliance of the contact costs: forces of the fitting meshes with stiffer pins.

    python -m benchmarks.penalty_study [--case CASE ...] [--times 1 4 8] [--sampling]
                                        [--ratios R S]

A contact point resists by k m^2 / (2 a) at a penetration m up to the ramp a, and by k (m - a / 2)
beyond; k is 6667 mu / mm and a 0.1 mm by default.  Meshes refine everything but that, so no grid
convergence index tells of it.  Forces with pins that give way q = 4 and 8 times less at every
pressure (`fe.PenaltyLaw.stiffened`) against the default, bar pin, r = 0.5, s = 0.05 unless others
are given, kappa = 1 MPa, one thread.  What the compliance takes from a force is nearly 1 / q of
what the default's does, so that a row is still 1 / (q - 1) of itself below a rigid pin.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from benchmarks.meshes import FITTING_CELLS, SAMPLING_CELLS
from fe import BlockPin, BlockPinModel, Contact, Response
from fe.contact import PenaltyLaw

TRAVEL = (0.6, 0.8, 1.0, 1.2, 1.4)
RATIOS = (0.5, 0.05)
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
    parser.add_argument("--times", nargs="+", type=float, default=[1.0, 4.0, 8.0])
    parser.add_argument("--sampling", action="store_true", help="on the sampling meshes")
    parser.add_argument("--ratios", nargs=2, type=float, default=RATIOS, metavar=("R", "S"))
    options = parser.parse_args(arguments)
    cells = SAMPLING_CELLS if options.sampling else FITTING_CELLS
    travels = " | ".join(f"{t:g} mm" for t in TRAVEL)
    print(f"| case | q | {travels} | field, mm RMS | CPU s, iterations | |")
    print("|" + "---|" * (len(TRAVEL) + 5))
    for case in options.case:
        first: Response | None = None
        for times in options.times:
            model = BlockPinModel(
                BlockPin(),
                CASES[case],
                cells[case],
                TRAVEL,
                penalty=PenaltyLaw().stiffened(times),
                sensitivities=(),
            )
            start = time.process_time()
            found = model(np.array(options.ratios))
            spent = f"{time.process_time() - start:.1f}, {found.n_iterations}"
            first = found if first is None else first
            print(_row(case, times, found, first, spent), flush=True)


def _row(case: str, times: float, found: Response, first: Response, spent: str) -> str:
    """Forces in N of the first, else in % of its; RMS difference of the field at each travel."""
    if found is first:
        cells, off = [f"{force:.2f} N" for force in found.force], ""
    else:
        cells = [f"{100 * off:+.2f} %" for off in found.force / first.force - 1.0]
        square = np.mean((found.displacement - first.displacement) ** 2, axis=(1, 2))
        off = ", ".join(f"{value:.4f}" for value in np.sqrt(square))
    return f"| {case} | {times:g} | {' | '.join(cells)} | {off} | {spent} | {found.message} |"


if __name__ == "__main__":
    main()
