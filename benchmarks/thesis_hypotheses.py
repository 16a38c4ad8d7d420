"""Rival readings of the thesis' experiment: FE runs of each, an emulator, and its mesh error.

Units mm, N, MPa.  Every run is kept in a store and never done twice.  Bar and round pins, stuck,
sliding and friction, heights of 2.5 and 2.7 mm, and a compressible block.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from benchmarks.meshes import SAMPLING_CELLS, Cells
from benchmarks.run_key import kept_campaign
from calib.data import thesis_forces
from calib.inference import (
    EmulatorForward,
    Marginal,
    NoiseSettings,
    Posterior,
    Prior,
    build_likelihood,
    integrate,
)
from calib.study.block_cells import refinement
from calib.study.context import stiffened
from calib.study.mesh_error import MeshError, mesh_error
from calib.study.training_runs import training_set
from fe import BlockPin, BlockPinModel, Contact, Rings
from fe.campaign_result import Campaign
from fe.response import Array
from fe.specimens.block_pin_geometry import Interface
from surrogate import Emulator, ScaledEmulator
from surrogate.design import sobol_design

TRAVEL = (0.6, 0.8, 1.0, 1.2, 1.4)
N_RUNS = 14
SEED = 20261122
NOMINAL_MESH_ERROR = 0.03
"""relative SD of the force with which the posterior is first looked at, to place the check"""
CHECK_CELLS: dict[str, Cells | Rings] = {
    "bar, stick": (20, 14, 5),
    "bar, friction": (16, 8, 4),
    "bar, frictionless": (18, 6, 4),
    "round, stick": Rings(12, 8, 2),
    "round, friction": Rings(12, 4, 2),
    "round, frictionless": Rings(12, 8, 2),
}
"""finer meshes that measure the discretisation error, at one point of each posterior"""
CHECK_STIFFENING = 4.0
"""how many times less their pins give way, as in studies"""
PRIOR = Prior(
    Marginal("log_uniform", 0.001, 0.1), Marginal("uniform", 0, 1), Marginal("uniform", 0, 0.5)
)
"""that of the study thesis-forces: kappa [MPa], r, s"""


@dataclass(frozen=True)
class Reading:
    """One reading of what was done."""

    name: str
    shape: Literal["bar", "round"]
    contact: Literal["stick", "friction", "frictionless"]
    pin: Interface
    base: Interface
    height: float = 2.5
    """mm"""
    bulk_ratio: float = 200.0
    """bulk modulus over shear modulus"""

    def model(self, cells: Cells | Rings) -> BlockPinModel:
        """The FE model on a mesh of the quarter."""
        return BlockPinModel(
            BlockPin(height=self.height, pin=self.shape),
            Contact(self.pin, self.base),
            cells,
            TRAVEL,
            bulk_ratio=self.bulk_ratio,
        )

    @property
    def mesh(self) -> str:
        """Name of its meshes."""
        return f"{self.shape}, {self.contact}"

    @property
    def folder(self) -> str:
        """Name of its folder in a store."""
        return self.name.replace(",", "").replace(" ", "-")


READINGS = (
    Reading("bar, stuck, 2.5", "bar", "stick", "stick", "stick"),
    Reading("bar, sliding, 2.5", "bar", "frictionless", "slide", "slide"),
    Reading("bar, friction 0.3, 2.5", "bar", "friction", 0.3, 0.3),
    Reading("round, stuck, 2.5", "round", "stick", "stick", "stick"),
    Reading("bar, stuck, 2.7", "bar", "stick", "stick", "stick", 2.7),
    Reading("bar, sliding, 2.7", "bar", "frictionless", "slide", "slide", 2.7),
    Reading("round, friction 0.3, 2.5", "round", "friction", 0.3, 0.3),
    Reading("round, sliding, 2.5", "round", "frictionless", "slide", "slide"),
    Reading("bar, pin 1 on sliding base, 2.5", "bar", "friction", 1.0, "slide"),
    Reading("bar, stuck, 2.5, compressible", "bar", "stick", "stick", "stick", 2.5, 5.0),
    Reading("bar, stuck, 2.5, bulk ratio 10", "bar", "stick", "stick", "stick", 2.5, 10.0),
)
"""compressible: a bulk modulus of five times the shear modulus, Poisson's ratio 0.41; ten times
(0.45) was asked after the largest displacements at five and 200 times had been seen"""


@dataclass(frozen=True)
class TrainedReading:
    """A reading with what its FE runs amount to."""

    reading: Reading
    campaign: Campaign
    emulator: Emulator
    mesh: MeshError | None
    """None where a check run did not reach the last travel"""

    def posterior(self, noise: NoiseSettings | None = None) -> Posterior:
        """Posterior of the forces of Table 5.1 with every error that is known.

        Where the error of the mesh could not be measured, its nominal size stands in.
        """
        error = self.mesh
        forward = EmulatorForward(
            ScaledEmulator(self.emulator),
            with_field=False,
            correction=None if error is None else error.correction,
        )
        likelihood = build_likelihood(
            thesis_forces(),
            forward,
            noise or NoiseSettings(),
            force_discretisation=NOMINAL_MESH_ERROR if error is None else error.force,
        )
        return Posterior(PRIOR, likelihood)


def design() -> Array:
    """(N_RUNS, 2) ratios (r, s): corners, then Sobol points, denser at small s."""
    unit = sobol_design(N_RUNS, np.array([[0.0, 1.0], [0.0, 1.0]]), SEED)
    return np.column_stack([unit[:, 0], 0.5 * unit[:, 1] ** 2])


def train(reading: Reading, store: Path, tell: Callable[[str], None]) -> TrainedReading:
    """Run the design and one check on a finer mesh (those of the store reused), and fit.

    Raises `fe.CampaignFailed` where more than a third of the design's runs stop early.
    """
    model = reading.model(SAMPLING_CELLS[reading.mesh])
    folder = store / reading.folder

    def progress(done: int, total: int) -> None:
        tell(f"{reading.name}: {done} of {total} runs")

    campaign = kept_campaign(
        model, design(), folder / "design", progress=progress, max_failure_rate=0.34
    )
    emulator = Emulator.fit(training_set([campaign], gradients=True), SEED)
    first = TrainedReading(reading, campaign, emulator, None)
    place = integrate(first.posterior(), 18).mean[1:]
    # Rounded: the last bits of a fit must not ask for another run.
    place = np.round(place, 2)
    error = _measured(reading, folder, place, tell)
    return TrainedReading(reading, campaign, emulator, error)


def _measured(
    reading: Reading, folder: Path, place: Array, tell: Callable[[str], None]
) -> MeshError | None:
    coarse_cells, fine_cells = SAMPLING_CELLS[reading.mesh], CHECK_CELLS[reading.mesh]
    coarse, stiffer, fine = (
        kept_campaign(
            stiffened(reading.model(cells), stiffening),
            place[None],
            folder / name,
            max_failure_rate=1.0,
        )
        for name, cells, stiffening in (
            ("coarse", coarse_cells, 1.0),
            ("stiffer", coarse_cells, CHECK_STIFFENING),
            ("fine", fine_cells, CHECK_STIFFENING),
        )
    )
    tell(f"{reading.name}: check at r = {place[0]:.2f}, s = {place[1]:.2f}")
    if not (coarse.reached & stiffer.reached & fine.reached).all():
        return None
    finer = refinement(fine_cells, coarse_cells)
    return mesh_error(fine, coarse, finer, reading.name, stiffer=(stiffer, CHECK_STIFFENING))
