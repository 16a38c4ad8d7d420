"""Data of a second test: measured ones from a file, or synthetic ones of known constants."""

from __future__ import annotations

from dataclasses import dataclass, replace
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
from fe.specimens.tensile import NotchedPlate, TensileModel

LAW = "mooney-rivlin-3"
"""of constants that a file of a second test states"""
SAME_PLACE = 1e-3
"""mm by which rounding may take a point off the plate, far less than the middle is known to"""


@dataclass(frozen=True)
class Study:
    """What a second test takes from the study that is held against it."""

    bulk_ratio: float
    """bulk modulus over shear modulus, of stated constants and where neither a posterior nor its
    hypothesis has one"""
    correlation: float
    """of one sample's deviation between neighbouring levels, `noise.sample_correlation`"""
    hypotheses: tuple[str, ...] = ()
    """that its posterior is under"""
    synthetic: bool = True
    """whether a model made its data"""


@dataclass(frozen=True)
class Rubbers:
    """Draws of one material under a law."""

    law: str
    constants: Array
    """(n, k) of the law, in its units"""
    bulk: Array
    """(n,) bulk modulus, MPa"""

    @property
    def mean(self) -> Rubbers:
        """The mean of the draws as one."""
        return Rubbers(self.law, self.constants.mean(axis=0)[None], self.bulk.mean()[None])


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
    correlation: float
    """of one sample's deviation between neighbouring levels, where it was not measured"""
    measured: Array | None = None
    """(n_step, n_step) covariance of one sample's relative deviation in stiffness, as measured"""
    travel_zero_sd: float = 0.0
    """SD of the error that all samples have in common in the zero of the travel, mm"""

    @property
    def quantity(self) -> str:
        """Name of what was read, with its unit."""
        return "travel [mm]" if self.control == "force" else "force [N]"

    def stiffness_covariance(self) -> Array:
        """(n_step, n_step) covariance of one sample's relative deviation in stiffness."""
        if self.measured is not None:
            return self.measured
        return between_sample_covariance(self.stiffness_sd, 0.0, self.correlation)

    def softened(self, values: Array) -> Array:
        """(n_step, ...) change of values (n_step, ...) per relative gain in stiffness, at a level.

        Values of one dimension are one sample's answers, those of more its field. At a set force F
        a sample stiffer by e answers as the model does at F (1 - e). At a set travel the force
        gains e; a field would not change.
        """
        if self.control == "travel":
            return values if values.ndim == 1 else np.zeros_like(values)
        slopes = self.levels[:, None] * slope_matrix(self.levels)
        changed: Array = -np.tensordot(slopes, values, axes=1)
        return changed

    def by_travel(self, values: Array) -> Array:
        """(n_step, ...) change of values (n_step, ...) per mm by which the travel's zero is off.

        Values as in `softened`. At a set force it is the travel that is read wrong, and the field
        is what it was; at a set travel both force and field are those of another one.
        """
        if self.control == "force":
            return np.ones_like(values) if values.ndim == 1 else np.zeros_like(values)
        changed: Array = np.tensordot(slope_matrix(self.levels), values, axes=1)
        return changed


def plate_model(
    test: SecondTest, cells: tuple[int, int, int], levels: Array, points: Array | None = None
) -> TensileModel:
    """Forward model of the plate on a mesh, at the levels; without sensitivities.

    Its field is at `points` (n, 2) mm, or on the grid of a synthetic test.
    """
    targets = tuple(float(level) for level in levels)
    plate = test.plate.specimen()
    return TensileModel(
        specimen=plate,
        cells=cells,
        travel=targets if test.control == "travel" else (),
        force=targets if test.control == "force" else (),
        field_grid=test.grid if points is None else _onto(plate, points),
        sensitivities=(),
    )


def _onto(plate: NotchedPlate, points: Array) -> tuple[tuple[float, float], ...]:
    """The points (n, 2) mm, those that rounding took off the quarter of the face on its edge."""
    y = np.clip(points[:, 1], 0.0, plate.length / 2.0)
    x = np.clip(points[:, 0], 0.0, plate.half_width(y))
    return tuple(zip(x.tolist(), y.tolist(), strict=True))


def solve(model: TensileModel, rubbers: Rubbers, index: int = 0) -> Response:
    """Response at one of the draws."""
    constants = [float(value) for value in rubbers.constants[index]]
    return model.respond(material(rubbers.law, constants, float(rubbers.bulk[index])))


def answer_of(response: Response, control: Control) -> Array:
    """(n_step,) what is read: travel mm at set forces, force N at set travels."""
    return response.travel if control == "force" else response.force


def stated(given: NamedConstants | SecondTruth, study: Study) -> Rubbers:
    """The constants that a file of a second test states, as one draw."""
    bulk = study.bulk_ratio * 2.0 * (given.C10 + given.C01)
    return Rubbers(LAW, np.array([[given.C10, given.C01, given.C11]]), np.array([bulk]))


def second_data(test: SecondTest, folder: Path, study: Study) -> SecondData:
    """The data of a second test: of its file in `folder`, or made now.

    Raises ValueError when a file cannot be read or the truth cannot be solved.
    """
    if test.virtual is not None:
        return _virtual(test, test.virtual, study)
    path = folder / test.data.source
    dataset, _ = load_dataset(path)
    if dataset.field is not None:
        _check_places(path, test, dataset.field.points)
    if dataset.travel.size < 2:
        raise ValueError(f"{path}: travel: found one increment, expected two or more")
    if dataset.samples is not None and not np.isfinite(dataset.samples.force).all():
        raise ValueError(f"{path}: samples: found a force that is no number, expected N of all")
    forced = test.control == "force"
    if forced and np.any(np.diff(dataset.force_mean) <= 0):
        forces = ", ".join(f"{force:g}" for force in dataset.force_mean)
        raise ValueError(
            f"{path}: force_mean: found {forces} N, expected increasing forces where they are set"
        )
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
        correlation=study.correlation,
        measured=None
        if dataset.force_covariance is None
        else dataset.force_covariance / np.outer(dataset.force_mean, dataset.force_mean),
        travel_zero_sd=dataset.travel_zero_sd,
    )


def _check_places(path: Path, test: SecondTest, points: Array) -> None:
    """Raise ValueError for points (n, 2) [mm] that are not on the quarter of the plate's front."""
    plate = test.plate.specimen()
    beyond = points - np.column_stack(
        [plate.half_width(points[:, 1]), np.full(len(points), plate.length / 2.0)]
    )
    off = np.any((points < -SAME_PLACE) | (beyond > SAME_PLACE), axis=1)
    if off.any():
        x, y = points[int(np.argmax(off))]
        raise ValueError(
            f"{path}: points: found {np.count_nonzero(off)} off the plate, the first at x = {x:g}, "
            f"y = {y:g} mm, expected all on the quarter x >= 0, y >= 0 from its middle to its edge"
        )


def _virtual(test: SecondTest, truth: SecondTruth, study: Study) -> SecondData:
    """Samples differ in stiffness, which moves answer and field alike; the field has noise too."""
    model = plate_model(test, truth.cells, np.array(test.levels))
    response = solve(model, stated(truth, study))
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
        correlation=study.correlation,
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
    return replace(
        known,
        answer=samples.mean(axis=0),
        stiffness_sd=gain.std(axis=0, ddof=1),
        samples=samples,
        field=replace(field, displacement=noisy),
    )
