"""softcal, FElupe and CalculiX side by side on the glued footprint, at equal unknowns."""

from __future__ import annotations

import statistics
from dataclasses import dataclass, replace

from benchmarks import calculix_patch, felupe_patch, stuck_patch
from benchmarks.stuck_patch import PatchRun, StuckPatch

CASE = StuckPatch(
    (4, 6, 4, 4),
    (0.1, 0.2, 0.3, 0.4),
    constants=(0.015, 0.0, 0.0),  # neo-Hookean: FElupe's law is a closed form, not derived by it
    bulk=6.0,
)
REFERENCE = replace(CASE, cells=(8, 12, 8, 8))
CALCULIX_CELLS = (5, 7, 5, 5)
"""C3D20R has fewer nodes an element: as many unknowns as CASE within a few per cent"""


@dataclass(frozen=True)
class CodeRun:
    """One code at its median time."""

    run: PatchRun
    error_percent: float
    """largest difference of the force from the reference mesh over the increments"""


def compare(*, quick: bool = False) -> list[CodeRun]:
    """softcal, FElupe with softcal's element and with its cheapest, and CalculiX if installed.

    Each solves once uncounted (compilation, caches), CalculiX, which has neither, just once and to
    its own tolerances, which are looser than the 1e-8 of the others.
    """
    case, reference = CASE, REFERENCE
    calculix_case = replace(CASE, cells=CALCULIX_CELLS)
    first_order = replace(CASE, cells=(8, 12, 8, 8))  # the same nodes as CASE
    if quick:
        case = replace(CASE, cells=(1, 2, 2, 2), travel=(0.1,))
        reference, calculix_case = replace(case, cells=(2, 3, 2, 2)), case
        first_order = replace(case, cells=(2, 4, 4, 4))
    fine = stuck_patch.press(reference).force
    n_repeat = 1 if quick else 3
    runs = [
        _median([stuck_patch.press(case) for _ in range(n_repeat + 1)][1:]),
        _median([felupe_patch.press(case) for _ in range(2)][1:]),
        _median([felupe_patch.press(first_order, "Q1/P0") for _ in range(2)][1:]),
    ]
    if calculix_patch.available():
        runs.append(calculix_patch.press(calculix_case))
    return [CodeRun(run, run.error_percent(fine)) for run in runs]


def _median(runs: list[PatchRun]) -> PatchRun:
    return replace(runs[-1], seconds=statistics.median(run.seconds for run in runs))
