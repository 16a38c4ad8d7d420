"""The thesis' mesh study (its Table 3.7) beside ours: the stuck bar pressed to 1.4 mm.

The thesis' times are of its own machine and commercial code, to its own travel of 1.8 mm; it gives
no forces, so the accuracy of its meshes is measured here with the same kind of element (eight-node
brick, one pressure), by FElupe, on the sharp glued footprint, against a fine graded Q2/P1 mesh.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks import felupe_patch, stuck_patch
from benchmarks.stuck_patch import StuckPatch
from benchmarks.timing import median_seconds
from fe import BlockPin, BlockPinModel, Contact

TABLE_3_7 = {5: 4.0, 10: 52.0, 15: 835.0, 20: 1784.0, 25: 6332.0}
"""wall-clock seconds of n x 2n x 2n first-order elements"""
TRAVEL = (0.6, 0.8, 1.0, 1.2, 1.4)
RATIOS = np.array([0.0, 0.0])
"""neo-Hookean"""

PATCH = StuckPatch((5, 7, 4, 2), (0.1,), constants=(0.015, 0.0, 0.0), bulk=6.0)
FINE = replace(PATCH, cells=(10, 13, 10, 8), travel=(0.05, 0.1), grading=2.0)


@dataclass(frozen=True)
class BarRun:
    """The stuck bar to the last travel on one mesh of the product."""

    cells: tuple[int, int, int]
    n_unknowns: int
    seconds: float
    n_factorisations: int
    reached: float
    """mm"""
    force: list[float]
    """N at kappa = 1 MPa"""

    def from_other_percent(self, other: BarRun) -> list[float]:
        """How far the forces are above those of another mesh, % of these."""
        return [100.0 * (a / b - 1.0) for a, b in zip(self.force, other.force, strict=True)]


def press_bar(cells: tuple[int, int, int], travel: tuple[float, ...] = TRAVEL) -> BarRun:
    """Time one march of the product; compiled before."""
    model = BlockPinModel(BlockPin(), Contact("stick", "stick"), cells, travel)
    response, seconds = median_seconds(lambda: model(RATIOS), 1, warm=False)
    return BarRun(
        cells=cells,
        n_unknowns=model.discretise().pattern.indptr.size - 1,
        seconds=seconds,
        n_factorisations=response.n_factorisations,
        reached=response.reached,
        force=[float(f) for f in response.force],
    )


def cost_exponent(runs: list[BarRun]) -> float:
    """Least-squares slope of log seconds over log unknowns."""
    n = np.log([run.n_unknowns for run in runs])
    return float(np.polyfit(n, np.log([run.seconds for run in runs]), 1)[0])


def patch_cells(cells: tuple[int, int, int]) -> tuple[int, int, int, int]:
    """The footprint case on as many elements as a mesh of the bar (x, y, z)."""
    inner = round(0.4 * cells[0])
    return (inner, cells[0] - inner, cells[1], cells[2])


def footprint_errors(
    first_order: tuple[int, ...],
    second_order: list[tuple[int, int, int]],
    fine: StuckPatch = FINE,
) -> tuple[dict[int, float], dict[tuple[int, int, int], float]]:
    """Force errors in %, at 0.1 mm, of Table 3.7's meshes and of the product's (x, y, z).

    The product's meshes are taken uniform here; those of the bar are finer at the pin's edge.
    """
    reference = stuck_patch.press(fine).force[-1:]
    theirs = {
        n: felupe_patch.press(stuck_patch.uniform(PATCH, n), "Q1/P0").error_percent(reference)
        for n in first_order
    }
    ours = {
        cells: stuck_patch.press(replace(PATCH, cells=patch_cells(cells))).error_percent(reference)
        for cells in second_order
    }
    return theirs, ours


MEMORY_OF_N20 = """
import numpy as np
from benchmarks.dirichlet import DirichletProblem
from benchmarks.stuck_patch import StuckPatch
case = StuckPatch((8, 12, 10, 20), (0.1,))  # the nodes of 20 x 40 x 40 first-order elements
problem = DirichletProblem(case.mesh(), np.array(case.constants), case.bulk)
fixed, _ = case.fixed(problem.elements.positions)
problem.prescribe(fixed)
problem.residual()
problem.factorise().solve(np.ones(int((~fixed).sum())))
"""
"""what every iteration needs on the nodes of n = 20: element tangents, matrix, factor"""
