"""FE runs behind the benchmark of emulators: stored one by one, reused and resumed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fe import BlockPin, BlockPinModel, Contact
from fe.campaign import Campaign, run_campaign
from fe.response import Array, Response
from surrogate.design import sobol_design

TRAVEL = (0.6, 0.8, 1.0, 1.2, 1.4)
TRAINING_SEED, HELD_OUT_SEED = 1, 2
FACTORS = {
    "r": (0.0, 1.0),
    "s": (0.0, 0.5),
    "bulk": (50.0, 500.0),
    "friction": (0.1, 1.0),
    "height": (2.5, 2.7),
    "fillet": (0.1, 0.3),
}
"""range of each factor; bulk over shear modulus, friction of pin and base, lengths in mm"""


@dataclass(frozen=True)
class Design:
    """One row of the table of figures to reach."""

    names: tuple[str, ...]
    n_runs: int
    n_corners: int | None
    """corners that come first; None for all"""
    max_field_mm: float
    max_force_percent: float

    @property
    def bounds(self) -> Array:
        """(d, 2) box of the factors."""
        return np.array([FACTORS[name] for name in self.names])

    def training(self) -> Array:
        """(n_runs, d) points: corners, then a Sobol sequence."""
        return sobol_design(self.n_runs, self.bounds, TRAINING_SEED, n_corners=self.n_corners)

    def held_out(self, n: int) -> Array:
        """(n, d) points of another Sobol sequence, never used in training."""
        return sobol_design(n, self.bounds, HELD_OUT_SEED, n_corners=0)


DESIGNS = (
    Design(("r", "s"), 32, None, 1e-4, 0.1),
    Design(("r", "s", "bulk"), 64, None, 2e-4, 0.2),
    Design(tuple(FACTORS), 160, 16, 1e-3, 1.0),
)


@dataclass(frozen=True)
class Simulate:
    """The block at kappa = 1 MPa as a function of the factors of a design; picklable."""

    names: tuple[str, ...]
    contact: str
    cells: tuple[int, int, int]

    def __call__(self, point: Array) -> Response:
        """The run at a point (d,) of the design."""
        values = dict(zip(self.names, (float(v) for v in point), strict=True))
        return self._model(values)(np.array([values["r"], values["s"]]))

    def _model(self, values: dict[str, float]) -> BlockPinModel:
        pin = values.get("friction", self.contact)
        model = BlockPinModel(BlockPin(), Contact(pin, pin), self.cells, TRAVEL)  # type: ignore[arg-type]
        fields = {"height": "height", "fillet": "pin_fillet"}
        shape = {fields[key]: value for key, value in values.items() if key in fields}
        if shape:
            model = replace(model, specimen=replace(model.specimen, **shape))
        if "bulk" in values:
            model = replace(model, bulk_ratio=values["bulk"])
        return model

    def fingerprint(self) -> dict[str, Any]:
        """All that a run depends on besides its point."""
        base = BlockPinModel(BlockPin(), Contact("stick", "stick"), self.cells, TRAVEL)
        return {"model": repr(base), **asdict(self)}


def simulate(
    points: Array, model: Simulate, store: Path, progress: Callable[[int, int], None]
) -> Campaign:
    """Runs at points (n, d), those of the store reused."""
    return run_campaign(
        model,
        points,
        store,
        fingerprint=model.fingerprint(),
        progress=progress,
        max_failure_rate=0.5,
    )
