"""Meshes of which the error is measured: of the emulator, of the check and of the truths."""

from __future__ import annotations

from dataclasses import dataclass, replace

from benchmarks.emulator_runs import CELLS
from calib.study.block_cells import refinement
from calib.study.config import Study, load_study
from calib.study.mesh_error import Shares
from calib.study.sections import Cells, Hypothesis
from calib.study.usual_meshes import field_order

CHECK_STIFFENING, TRUTH_STIFFENING = 4.0, 8.0
"""how many times less pins give way than that of the emulator's runs, as in studies"""
PER_TRUTH = 20
"""experiments that share the FE run of one truth, at least"""
PIN_SHARE = (1.0 / CHECK_STIFFENING - 1.0 / TRUTH_STIFFENING) * CHECK_STIFFENING
"""of the way from the check's pin to a rigid one, to those of truths"""


def study() -> Study:
    """The study whose emulators, meshes and prior are used."""
    return load_study("thesis-forces")


def hypothesis(name: str) -> Hypothesis:
    """A hypothesis of the study by its name."""
    return next(found for found in study().hypotheses if found.name == name)


@dataclass(frozen=True)
class MeshCase:
    """The mesh of an emulator, the study's sampling mesh, and two finer ones, cheaper than its own.

    Elements of the check are 1.30 (sliding) and 1.5 times (stuck; 1.4 on the sampling mesh of new
    studies) smaller than the emulator's (1.65 and 2.1 in the study), those of the truth 1.2 times
    smaller than the check's. Two cases have check meshes of new studies, 1.5 and 1.6 times smaller.
    The pin of the check gives way `CHECK_STIFFENING` times less than that of the emulator's runs,
    that of the truth `TRUTH_STIFFENING` times.
    """

    hypothesis: str
    check_cells: Cells
    """measure its error"""
    truth_cells: Cells
    """finer than those too"""
    draw: int
    """of the prior, for the truths"""
    other_cells: Cells | None = None
    """of the emulator's runs where these are not the study's"""
    seed: int = 0
    """added to those of kappa and of the errors of measurement"""
    n_truths: int = 12
    """the first of that draw"""

    def of(self, n: int) -> MeshCase:
        """The same with as few truths as n experiments need."""
        return replace(self, n_truths=min(self.n_truths, max(n // PER_TRUTH, 1)))

    def __str__(self) -> str:
        """Names what is stored of it."""
        check, truth = ("x".join(map(str, cells)) for cells in (self.check_cells, self.truth_cells))
        other = "" if self.other_cells is None else "x".join(map(str, self.other_cells)) + "-"
        pins = f"pins-{CHECK_STIFFENING:g}-{TRUTH_STIFFENING:g}"
        return f"{self.hypothesis}-{other}by-{check}-of-{truth}-{pins}-{self.draw}"

    @property
    def cells(self) -> Cells:
        """Of the emulator's runs."""
        return self.other_cells or study().sampling_cells(hypothesis(self.hypothesis))

    @property
    def refinement(self) -> float:
        """How many times smaller the elements of the check mesh are."""
        return refinement(self.check_cells, self.cells)

    @property
    def field_order(self) -> float:
        """Of the field's error in the size of the elements, as the statement takes it to be."""
        return field_order(hypothesis(self.hypothesis))

    @property
    def truth_share(self) -> Shares:
        """Shares that truths show of the distance from the check mesh to the block.

        For errors of the orders that the statement takes them to be of.
        """
        finer = refinement(self.truth_cells, self.check_cells)
        return Shares(1.0 - finer**-2, 1.0 - finer**-self.field_order)


MESH_CASES = {
    "finer": MeshCase("sliding", (14, 5, 3), (16, 6, 4), 0),
    "finer-stuck": MeshCase("stuck", (14, 8, 4), (16, 10, 5), 5),
    "finer-stuck-new": MeshCase("stuck", (14, 8, 4), (16, 10, 5), 5, CELLS["stick"]),
    "fresh": MeshCase("sliding", (14, 5, 3), (16, 6, 4), 11, seed=1000),
    "fresh-stuck-new": MeshCase("stuck", (14, 8, 4), (16, 10, 5), 12, CELLS["stick"], seed=1000),
    "wide-stuck": MeshCase("stuck", (18, 8, 4), (22, 10, 5), 12, CELLS["stick"], seed=1000),
    "default-stuck": MeshCase("stuck", (15, 10, 5), (16, 12, 6), 12, CELLS["stick"], seed=1000),
    "init-stuck": MeshCase("stuck", (20, 14, 5), (24, 17, 6), 12, CELLS["stick"], seed=1000),
}
"""by name; truths of the last five took no part in choosing the lengths of what is stated of a
mesh's error, those of wide-stuck and init-stuck did in choosing the order of stuck fields; the
last three are of a check mesh of few layers, of one of more, and of that of `calib init`, at ratios
of the one before them"""
