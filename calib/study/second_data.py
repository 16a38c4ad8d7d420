"""Data of a second test: measured ones from a file, or synthetic ones of known constants."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.data.dataset import FieldData
from calib.data.dataset_file import load_dataset
from calib.inference.field_noise import field_covariance
from calib.inference.noise import between_sample_covariance, slope_matrix
from calib.study.second_test import NamedConstants, SecondTest, SecondTruth
from fe.force_control import Control
from fe.materials.material import material
from fe.response import Array, Response, Status
from fe.specimens.tensile import TensileModel

LAW = "mooney-rivlin-3"
CORRELATION = 0.9
"""of one sample's deviation between neighbouring levels, as the study's noise has it"""


@dataclass(frozen=True)
class SecondData:
    """What was set, what was read, and the field; errors of the mean of `n_samples`."""

    name: str
    synthetic: bool
    control: Control
    levels: Array
    """(n_step,) set: force N or travel mm"""
    answer: Array
    """(n_step,) mean of what was read: travel mm or force N"""
    stiffness_sd: Array
    """(n_step,) relative SD of the stiffness between samples"""
    n_samples: int
    samples: Array | None
    """(n_samples, n_step) answers of the samples one by one, where they are known"""
    field: FieldData | None

    @property
    def quantity(self) -> str:
        """Name of what was read, with its unit."""
        return "travel [mm]" if self.control == "force" else "force [N]"

    def stiffness_covariance(self) -> Array:
        """(n_step, n_step) covariance of one sample's relative deviation in stiffness."""
        return between_sample_covariance(self.stiffness_sd, 0.0, CORRELATION)

    def softened(self, values: Array) -> Array:
        """(n_step, ...) change of values (n_step, ...) per relative gain in stiffness, at a level.

        At a set force F a sample stiffer by e answers as the model does at F (1 - e). At a set
        travel the force gains e; a field would not change.
        """
        if self.control == "travel":
            return values if values.ndim == 1 else np.zeros_like(values)
        slopes = self.levels[:, None] * slope_matrix(self.levels)
        changed: Array = -np.tensordot(slopes, values, axes=1)
        return changed


def plate_model(test: SecondTest, cells: tuple[int, int, int], levels: Array) -> TensileModel:
    """Forward model of the plate on a mesh, at the levels; without sensitivities."""
    targets = tuple(float(level) for level in levels)
    return TensileModel(
        specimen=test.plate.specimen(),
        cells=cells,
        travel=targets if test.control == "travel" else (),
        force=targets if test.control == "force" else (),
        field_grid=test.field_grid,
        sensitivities=(),
    )


def solve(model: TensileModel, constants: Array, bulk_ratio: float) -> Response:
    """Response at (C10, C01, C11), MPa; bulk modulus `bulk_ratio` times 2 (C10 + C01)."""
    bulk = bulk_ratio * 2.0 * float(constants[0] + constants[1])
    return model.respond(material(LAW, [float(c) for c in constants[:3]], bulk))


def answer_of(response: Response, control: Control) -> Array:
    """(n_step,) what is read: travel mm at set forces, force N at set travels."""
    return response.travel if control == "force" else response.force


def constants_of(given: NamedConstants | SecondTruth) -> Array:
    """(3,) C10, C01, C11, MPa."""
    return np.array([given.C10, given.C01, given.C11])


def second_data(test: SecondTest, folder: Path, bulk_ratio: float) -> SecondData:
    """The data of a second test: of its file in `folder`, or made now.

    Raises ValueError when a file cannot be read or the truth cannot be solved.
    """
    if test.virtual is not None:
        return _virtual(test, test.virtual, bulk_ratio)
    dataset, _ = load_dataset(folder / test.data.source)
    forced = test.control == "force"
    return SecondData(
        name=dataset.name,
        synthetic=dataset.synthetic,
        control=test.control,
        levels=dataset.force_mean if forced else dataset.travel,
        answer=dataset.travel if forced else dataset.force_mean,
        stiffness_sd=dataset.force_sd / dataset.force_mean,
        n_samples=dataset.n_samples,
        samples=None if forced or dataset.samples is None else dataset.samples.force,
        field=dataset.field,
    )


def _virtual(test: SecondTest, truth: SecondTruth, bulk_ratio: float) -> SecondData:
    """Samples differ in stiffness, which moves answer and field alike; the field has noise too."""
    model = plate_model(test, truth.cells, np.array(test.levels))
    response = solve(model, constants_of(truth), bulk_ratio)
    if response.status is not Status.CONVERGED:
        raise ValueError(f"virtual: the truth cannot be solved: {response.message}")
    rng = np.random.default_rng(np.random.SeedSequence(test.seed, spawn_key=(1,)))
    n_step = len(test.levels)
    known = SecondData(
        name=f"synthetic {test.name}",
        synthetic=True,
        control=test.control,
        levels=np.array(test.levels),
        answer=answer_of(response, test.control),
        stiffness_sd=np.full(n_step, truth.force_sd_share),
        n_samples=truth.n_samples,
        samples=None,
        field=None,
    )
    factor = np.linalg.cholesky(known.stiffness_covariance())
    gain = rng.standard_normal((truth.n_samples, n_step)) @ factor.T
    samples = known.answer + gain * known.softened(known.answer)
    mean_gain = gain.mean(axis=0)[:, None, None]
    moved = response.displacement + mean_gain * known.softened(response.displacement)
    field = FieldData(
        points=model.points(),
        displacement=moved,
        noise_std=np.array(truth.field_noise_std),
        correlation_length=truth.field_correlation_length,
        reference_share=truth.field_reference_share,
    )
    noisy = moved + field_covariance(field).sample(rng, 1)[0]
    return SecondData(
        name=known.name,
        synthetic=True,
        control=test.control,
        levels=known.levels,
        answer=samples.mean(axis=0),
        stiffness_sd=gain.std(axis=0, ddof=1),
        n_samples=truth.n_samples,
        samples=samples,
        field=FieldData(
            points=field.points,
            displacement=noisy,
            noise_std=field.noise_std,
            correlation_length=field.correlation_length,
            reference_share=field.reference_share,
        ),
    )
