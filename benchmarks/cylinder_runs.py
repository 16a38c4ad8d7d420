"""FE runs of the compressed cylinder over ratios of constants and plate friction, and emulators."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from benchmarks.run_key import kept_campaign
from fe import Cylinder, CylinderModel
from fe.campaign_parameters import Parameter
from fe.materials.material import material
from fe.response import Array, Response
from surrogate import Emulator, TrainingSet, sobol_design

Contact = Literal["friction", "bonded"]

TRAVEL = (1.5, 3.0, 4.5, 6.0, 7.5, 9.0, 10.5, 12.0)
"""mm, to 40 %: beyond, forces of these meshes are not converged (docs/verification.md)"""
CELLS = (8, 6)
BULK_RATIO = 200.0
HALF = 0.2
"""coefficient of friction at which the coordinate m = mu / (mu + HALF) is a half"""
N_RUNS = {"friction": 40, "bonded": 20}
SEED = 11


@dataclass(frozen=True)
class Family:
    """Laws that are one law with some ratios at zero."""

    law: str
    ratios: tuple[str, str]
    bounds: tuple[tuple[float, float], tuple[float, float]]

    def constants(self, ratios: Array) -> Array:
        """(..., 3) constants over kappa at ratios (..., 2)."""
        first, second = np.moveaxis(np.asarray(ratios), -1, 0)
        if self.law == "yeoh":
            return np.stack([np.ones_like(first), first, second], axis=-1)
        return np.stack([1.0 - first, first, second], axis=-1)


FAMILIES = {
    "mooney": Family("mooney-rivlin-3", ("C01/kappa", "C11/kappa"), ((-0.6, 1.0), (-0.05, 0.5))),
    "yeoh": Family("yeoh", ("C20/C10", "C30/C10"), ((-0.15, 0.4), (-0.01, 0.1))),
}


@dataclass(frozen=True)
class CylinderRun:
    """Response of the cylinder at kappa = 1 MPa to (ratios, m), or (ratios) when bonded."""

    family: str
    contact: Contact
    cells: tuple[int, int] = CELLS
    travel: tuple[float, ...] = TRAVEL

    def __call__(self, theta: Array) -> Response:
        """Response at theta (3,), or (2,) when bonded; gradients by the constants and the bulk."""
        law = FAMILIES[self.family]
        constants = law.constants(np.asarray(theta[:2]))
        model = CylinderModel(
            specimen=Cylinder(),
            cells=self.cells,
            travel=self.travel,
            ends="bonded" if self.contact == "bonded" else "slide",
            friction=0.0 if self.contact == "bonded" else friction_of(theta[2]),
            n_point=1,
        )
        rubber = material(law.law, [float(c) for c in constants], 2.0 * BULK_RATIO)
        return model.respond(rubber)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Columns of a design."""
        names = [Parameter(name, "1", "material") for name in FAMILIES[self.family].ratios]
        if self.contact == "friction":
            names.append(Parameter("m", "1", "contact"))
        return tuple(names)

    @property
    def bounds(self) -> Array:
        """(d, 2) box of the design."""
        box = list(FAMILIES[self.family].bounds)
        if self.contact == "friction":
            box.append((0.0, 1.0 / (1.0 + HALF)))  # a coefficient of friction of 1
        return np.array(box)


def friction_of(m: Array | float) -> float:
    """Coefficient of friction at m = mu / (mu + HALF)."""
    return float(HALF * m / (1.0 - m))


def emulator(
    family: str, contact: Contact, store: Path, n_held_out: int = 6
) -> tuple[Emulator, Array]:
    """Emulator of the forces, and its relative errors (n_held_out, n_step) on runs unseen."""
    run = CylinderRun(family, contact)
    n = N_RUNS[contact]
    design = sobol_design(n + n_held_out, run.bounds, SEED)
    campaign = kept_campaign(
        run, design, store / f"{family}-{contact}", parameters=run.parameters, max_failure_rate=0.3
    )
    good = campaign.good.all(axis=1)
    force = np.array([response.force for response in campaign.responses])
    train = np.arange(len(design)) < n
    known = TrainingSet.from_runs(design[train], force[train], None, good[train])
    fitted = Emulator.fit(known, SEED)
    rest = ~train & good
    predicted, _ = fitted.unit_force(design[rest])
    return fitted, predicted / force[rest] - 1.0
