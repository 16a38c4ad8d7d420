"""What every stage of a study is given: the study, where to write, and how to run simulations."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from calib.inference.laws import DEFAULT_LAW
from calib.study.block_cells import Cells, RingCells, model_cells
from calib.study.config import Study
from calib.study.data_source import measured_dataset
from calib.study.sections import Hypothesis
from calib.study.unknowns import inputs_of, law_of, least_height, off_centre
from calib.study.varied_block import VariedBlock
from fe.executors import MapFn
from fe.response import Array, Response
from fe.specimens.block_pin import BlockPin, BlockPinModel, Contact
from fe.specimens.field_grid import FieldGrid


class Simulate(Protocol):
    """A forward model at kappa = 1 MPa: a picklable frozen dataclass, named by its fields."""

    def __call__(self, ratios: Array) -> Response:
        """Response for ratios and further unknowns (d,)."""
        ...

    def points(self) -> Array:
        """(n_point, 2) reference x, y of the field points, mm."""
        ...


SimulateFactory = Callable[[Study, Hypothesis, Cells | RingCells], Simulate]


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

    def model(
        self, hypothesis: Hypothesis, cells: Cells | RingCells, stiffening: float = 1.0
    ) -> Simulate:
        """Forward model of a hypothesis on a mesh, whose pin gives way `stiffening` times less."""
        return stiffened(self.simulate_factory(self.study, hypothesis, cells), stiffening)

    def sampling_model(self, hypothesis: Hypothesis) -> Simulate:
        """Forward model of a hypothesis on the mesh of the emulator's runs."""
        return self.model(hypothesis, self.study.sampling_cells(hypothesis))

    def check_model(self, hypothesis: Hypothesis) -> Simulate:
        """Forward model of a hypothesis that its sampling model is held against."""
        cells = self.study.check_cells(hypothesis)
        return self.model(hypothesis, cells, self.study.mesh.check_stiffening)


def block_pin_model(study: Study, hypothesis: Hypothesis, cells: Cells | RingCells) -> Simulate:
    """The FE model of the study's block under its pin, for one hypothesis."""
    geometry, inputs = study.geometry, inputs_of(study, hypothesis)
    law = law_of(study, hypothesis).name
    specimen = BlockPin(
        width=geometry.width,
        depth=geometry.depth,
        height=study.height(hypothesis),
        pin_width=geometry.pin_width,
        pin_fillet=geometry.pin_fillet,
        pin=study.pin_shape(hypothesis),
        pin_shift=(geometry.pin_shift, 0.0),
    )
    model = BlockPinModel(
        specimen=specimen,
        contact=Contact(pin=hypothesis.pin, base=hypothesis.base),
        cells=model_cells(cells),
        travel=study.increments,
        bulk_ratio=study.bulk_ratio(hypothesis),
        field_grid=_field_grid(study),
        symmetry="half" if "pin_shift" in inputs else "auto",
    )
    if not inputs and law == DEFAULT_LAW:
        return model
    return VariedBlock(model, law, inputs)


def stiffened(model: Simulate, times: float) -> Simulate:
    """The same model under a pin that gives way `times` less; without a pin it is itself."""
    if times == 1.0:
        return model
    if isinstance(model, VariedBlock):
        return replace(model, template=_stiffened(model.template, times))
    return _stiffened(model, times) if isinstance(model, BlockPinModel) else model


def _stiffened(model: BlockPinModel, times: float) -> BlockPinModel:
    return replace(model, penalty=model.penalty.stiffened(times))


def _field_grid(study: Study) -> FieldGrid:
    """The points of a measured field, at which shape functions give that of the model.

    Where the height is unknown, or hypotheses about a field differ in it, points stay at their
    places, inside the lowest block that there is.
    """
    if not (study.data.is_experiment and study.data.has_field):
        heights = {study.height(h) for h in study.hypotheses}
        unknown = any("height" in inputs_of(study, h) for h in study.hypotheses)
        if not unknown and not (study.data.has_field and len(heights) > 1):
            return (35, 24)
        lowest = min(least_height(study, h) for h in study.hypotheses)
        x = (np.arange(35) + 0.5) * study.geometry.width / 70.0
        if any(off_centre(study, h) for h in study.hypotheses):
            x = np.concatenate([-x[::-1], x])
        y = (np.arange(24) + 0.5) * lowest / 24.0
        return tuple((float(a), float(b)) for a in x for b in y)
    field = measured_dataset(study.data).field
    assert field is not None  # that of an experiment has one
    return tuple((float(x), float(y)) for x, y in field.points)


def stream(study: Study, purpose: str) -> np.random.Generator:
    """Random numbers of one purpose: they follow from the study's seed and the purpose alone.

    What one stage or hypothesis draws therefore never depends on the others.
    """
    key = zlib.crc32(purpose.encode())
    return np.random.default_rng(np.random.SeedSequence(study.seed, spawn_key=(key,)))
