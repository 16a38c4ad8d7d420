"""What every stage of a study is given: the study, where to write, and how to run simulations."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from calib.study.config import Study
from calib.study.data_source import measured_dataset
from calib.study.sections import Cells, Hypothesis
from fe.executors import MapFn
from fe.response import Array, Response
from fe.specimens.block_pin import BlockPin, BlockPinModel, Contact
from fe.specimens.block_pin_mesh import FieldGrid


class Simulate(Protocol):
    """A forward model at kappa = 1 MPa: a picklable frozen dataclass, named by its fields."""

    def __call__(self, ratios: Array) -> Response:
        """Response for ratios (2,)."""
        ...

    def points(self) -> Array:
        """(n_point, 2) reference x, y of the field points, mm."""
        ...


SimulateFactory = Callable[[Study, Hypothesis, Cells], Simulate]


@dataclass(frozen=True)
class Context:
    """One run of a study."""

    study: Study
    out: Path
    """folder of all artifacts"""
    simulate_factory: SimulateFactory
    map_fn: MapFn
    """maps simulations over processes; results do not depend on it"""
    echo: Callable[[str], None]
    show_progress: bool

    def model(self, hypothesis: Hypothesis, cells: Cells) -> Simulate:
        """Forward model of a hypothesis on a mesh."""
        return self.simulate_factory(self.study, hypothesis, cells)

    def sampling_model(self, hypothesis: Hypothesis) -> Simulate:
        """Forward model of a hypothesis on the mesh of the emulator's runs."""
        return self.model(hypothesis, self.study.mesh.sampling)


def block_pin_model(study: Study, hypothesis: Hypothesis, cells: Cells) -> Simulate:
    """The FE model of the study's block under its bar pin, for one contact hypothesis."""
    geometry = study.geometry
    specimen = BlockPin(
        width=geometry.width,
        depth=geometry.depth,
        height=study.height(hypothesis),
        pin_width=geometry.pin_width,
        pin_fillet=geometry.pin_fillet,
    )
    return BlockPinModel(
        specimen=specimen,
        contact=Contact(pin=hypothesis.pin, base=hypothesis.base),
        cells=cells,
        travel=study.increments,
        bulk_ratio=study.material.bulk_ratio,
        field_grid=_field_grid(study),
    )


def _field_grid(study: Study) -> FieldGrid:
    """The points of a measured field, at which shape functions give that of the model."""
    if not study.data.is_experiment:
        return (35, 24)
    field = measured_dataset(study.data).field
    assert field is not None  # that of an experiment has one
    return tuple((float(x), float(y)) for x, y in field.points)


def stream(study: Study, purpose: str) -> np.random.Generator:
    """Random numbers of one purpose: they follow from the study's seed and the purpose alone.

    What one stage or hypothesis draws therefore never depends on the others.
    """
    key = zlib.crc32(purpose.encode())
    return np.random.default_rng(np.random.SeedSequence(study.seed, spawn_key=(key,)))
