"""All samples of an experiment, from their files to one data set."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.data.dataset import Dataset, FieldData, SampleData
from calib.data.qc.alignment import aligned, mapping_std, unresolved
from calib.data.qc.averaging import MeanField, mean_field, mean_force, with_enough
from calib.data.qc.contact import SMALLEST_SD
from calib.data.qc.experiment_file import Experiment, Mapping, read_experiment
from calib.data.qc.lab_files import SampleFiles, input_hash, sample_files, static_folder
from calib.data.qc.likeness import unlike
from calib.data.qc.machine_test import at_travel
from calib.data.qc.mean_noise import FieldNoise, mean_noise
from calib.data.qc.noise_floor import pooled_noise
from calib.data.qc.quality import (
    Rejection,
    Rule,
    broken,
    few_points,
    gross,
    odd_forces,
    placement_rules,
)
from calib.data.qc.rules import Rules, inputs_under, under_rules
from calib.data.qc.sample import REACH, Sample, read_sample
from calib.data.qc.senses import check_senses
from calib.data.qc.static_noise import StaticNoise, static_noise
from calib.data.readers import WrongFile
from calib.data.readers.frames import BoolArray
from fe.response import Array

THESIS_GRID = (35, 24)
"""points of half the face along x and y (thesis, section 4.4.2)"""
SHARED = 0.15
"""largest correlation of the noise of a point and its mirror image: the covariance takes the halves
that are folded as independent"""
MOST_SHARED = 0.25
"""of half the width that is left out for it at most"""
SMALLEST_NUGGET = 1e-6
"""with less the correlation of close points is singular"""


@dataclass(frozen=True)
class QcResult:
    """Everything found, sample by sample, and the data set of those that were kept."""

    folder: Path
    experiment: Experiment
    name: str
    inputs: str
    """hash of all files, and of a study's rules"""
    samples: tuple[Sample, ...]
    rules: tuple[tuple[Rule, ...], ...]
    """one tuple a sample"""
    study_rules: dict[str, float]
    """those that a study has put in place of the experiment's"""
    rejections: tuple[Rejection, ...]
    points: Array
    """(n, 2) mm, all places of half the face"""
    fields: Array
    """(n_sample, n_step, n, 3) mm at them, NaN where there is nothing; those of kept samples are
    of one height and travel (`alignment`)"""
    mean: MeanField | None
    """of the kept samples; None where there is no data set"""
    noise: FieldNoise | None
    dataset: Dataset | None
    """None where fewer than two samples are kept"""
    seconds: float

    @property
    def kept(self) -> BoolArray:
        """(n_sample,) samples without a rejection."""
        rejected = {one.sample for one in self.rejections}
        return np.array([sample.name not in rejected for sample in self.samples])

    def forces(self) -> Array:
        """(n_sample, n_step) N; NaN where a test did not go as planned."""
        nothing = np.full(self.experiment.protocol.travel.size, np.nan)
        return np.array([nothing if s.force is None else s.force for s in self.samples])


def face_points(experiment: Experiment) -> Array:
    """(n, 2) places on half the face, mm: centres of equal rectangles."""
    half, height = experiment.specimen.width_mm / 2, experiment.specimen.height_mm
    nx, ny = THESIS_GRID
    if experiment.field.mapping == "shape":
        spacing = experiment.field.spacing_mm
        nx, ny = max(round(half / spacing), 2), max(round(height / spacing), 2)
    x, y = (np.arange(nx) + 0.5) * half / nx, (np.arange(ny) + 0.5) * height / ny
    return np.stack([c.ravel() for c in np.meshgrid(x, y, indexing="ij")], axis=1)


def analyse(
    folder: Path | str,
    tell: Callable[[int, int], None] | None = None,
    rules: Rules | None = None,
) -> QcResult:
    """Read a laboratory's folder and make a data set of the samples that meet all rules.

    `rules` of a study go before the experiment's own.

    `tell` is called with the numbers of samples done and in all. Rejected samples are results; a
    file that cannot be read raises ValueError of one sentence with file, place, found, expected.
    """
    started = time.perf_counter()
    folder = Path(folder)
    experiment = under_rules(read_experiment(folder), rules)
    files = sample_files(folder, experiment)
    points = face_points(experiment)
    samples, fields, limits = _samples(files, experiment, points, tell)
    check_senses(folder, experiment, points, fields)
    rejections = [
        r for sample, own in zip(samples, limits, strict=True) for r in broken(sample, own)
    ]
    rejections += few_points(samples, fields, rejections, experiment.quality.min_points_share)
    rejections += gross(samples, fields, rejections)
    rejections += unlike([sample.name for sample in samples], fields, rejections)
    rejections += _odd(samples, rejections, experiment)
    static = static_folder(folder)
    noise = None if static is None else static_noise(static, experiment, points)
    result = QcResult(
        folder=folder,
        experiment=experiment,
        name=experiment.name or folder.resolve().name,
        inputs=inputs_under(input_hash(folder, files), rules),
        samples=samples,
        rules=limits,
        study_rules={} if rules is None else rules.given(),
        rejections=tuple(rejections),
        points=points,
        fields=fields,
        mean=None,
        noise=None,
        dataset=None,
        seconds=time.perf_counter() - started,
    )
    try:
        return _with_dataset(result, noise, started)
    except ValueError as error:  # of samples that are good one by one
        raise ValueError(f"{folder}: {error}") from error


def _samples(
    files: tuple[SampleFiles, ...],
    experiment: Experiment,
    points: Array,
    tell: Callable[[int, int], None] | None,
) -> tuple[tuple[Sample, ...], Array, tuple[tuple[Rule, ...], ...]]:
    samples, fields, rules = [], [], []
    seen: dict[bytes, SampleFiles] = {}
    for number, one in enumerate(files, start=1):
        sample = read_sample(one, experiment)
        _check_own(sample, one, seen)
        samples.append(sample)
        fields.append(sample_field(sample, experiment, points, experiment.field.mapping))
        rules.append(placement_rules(sample, _complete(sample), experiment))
        if tell is not None:
            tell(number, len(files))
    return tuple(samples), np.array(fields), tuple(rules)


def _check_own(sample: Sample, files: SampleFiles, seen: dict[bytes, SampleFiles]) -> None:
    """Raise WrongFile for a sample whose forces or field are those of one before, to the last bit.

    Files that were copied would count twice. `seen` are those before; this one is added.
    """
    values = []
    if sample.machine is not None:
        values.append(("machine", sample.machine.force))
    if sample.face is not None:
        values.append(("dic", sample.face.lattice.displacement))
    for which, found in values:
        first = seen.setdefault(hashlib.sha256(found.tobytes()).digest(), files)
        if first is not files:
            copy, original = (getattr(one, which) for one in (files, first))
            raise WrongFile(copy, None, "files of this sample", f"a copy of {original}")


def sample_field(sample: Sample, experiment: Experiment, points: Array, method: Mapping) -> Array:
    """(n_step, n, 3) field of a sample at points (n, 2) and the nominal travels, mm."""
    protocol, face = experiment.protocol, sample.face
    if face is None:
        return np.full((protocol.travel.size, len(points), 3), np.nan)
    mapped, _ = face.mapped(points, method, experiment.field.rigid_body)
    return at_travel(face.travel, mapped, protocol.travel, REACH * protocol.increment_mm)


def _complete(sample: Sample) -> int:
    if sample.face is None:
        return 0
    moved = sample.face.lattice.displacement[1:, ..., 0]
    return int(np.count_nonzero(np.isfinite(moved).all(axis=0)))


def _odd(
    samples: tuple[Sample, ...], rejections: list[Rejection], experiment: Experiment
) -> list[Rejection]:
    """Forces are held against those of the samples that meet all other rules."""
    rejected = {one.sample for one in rejections}
    good = [s for s in samples if s.name not in rejected and s.force is not None]
    forces = np.array([s.force for s in good])
    limit = experiment.quality.max_force_deviation
    return odd_forces([s.name for s in good], forces, limit)


def _with_dataset(result: QcResult, static: StaticNoise | None, started: float) -> QcResult:
    """The result with noise, mean and data set where two samples or more are left."""
    kept = result.kept
    if np.count_nonzero(kept) < 2:
        return replace(result, seconds=time.perf_counter() - started)
    experiment, forces = result.experiment, result.forces()[kept]
    samples = [sample for sample, good in zip(result.samples, kept, strict=True) if good]
    fields, mean, by_mapping = _mean(
        samples, result.fields[kept], result.points, experiment, static
    )
    noise = mean_noise(result.points, mean, static, _stated(samples), _stated_length(samples))
    std, nugget = _with_mapping(noise, by_mapping)
    force, covariance = mean_force(forces)
    n, n_step = forces.shape
    field = FieldData(
        points=result.points[mean.kept],
        displacement=mean.displacement,
        noise_std=std,
        correlation_length=noise.together.correlation_length,
        reference_share=noise.together.reference_share,
        nugget=nugget,
        smoothing=noise.together.smoothing,
        patterns=mean.patterns if len(mean.patterns) else None,
        # one calibration for all samples: its error does not average away
        scale_sd=max(sample.face.scale_sd for sample in samples if sample.face is not None),
    )
    names = tuple(sample.name for sample in samples)
    every = result.fields.copy()
    every[kept] = fields
    dataset = Dataset(
        name=result.name,
        synthetic=experiment.synthetic,
        travel=experiment.protocol.travel,
        force_mean=force,
        force_sd=np.sqrt(np.diag(covariance)),
        n_samples=n,
        field=field,
        # with fewer samples it has no inverse, or one that is chance: see `mean_covariance`
        force_covariance=covariance if n >= n_step + 2 else None,
        samples=SampleData(names, forces, fields[:, :, mean.kept], noise.together.std),
        travel_zero_sd=_common_zero(samples),
    )
    seconds = time.perf_counter() - started
    return replace(result, fields=every, mean=mean, noise=noise, dataset=dataset, seconds=seconds)


def _common_zero(samples: Sequence[Sample]) -> float:
    """SD of what all samples' contact is off by, mm: that of the form that their forces are given.

    It counts by the weight that the force has beside the operator's start of the steps.
    """
    shares = [sample.machine.contact.force_share for sample in samples if sample.machine]
    return SMALLEST_SD * float(np.mean(shares))


def _mean(
    samples: Sequence[Sample],
    fields: Array,
    points: Array,
    experiment: Experiment,
    static: StaticNoise | None,
) -> tuple[Array, MeanField, Array]:
    """Fields brought to one height and travel, their mean, and what mapping adds to it (3,), mm."""
    limit = None if static is None else static.mapped.std
    travel, share = experiment.protocol.travel, experiment.field.min_share
    mean = mean_field(fields, points, travel, share, limit)
    if len(samples) < 3:  # too few to tell who is off
        return fields, mean, np.zeros(3)
    found = aligned(samples, experiment, points, mean.place_errors)
    noise = mean.residual_std / np.sqrt(len(samples))
    near = _correlation_at(2 * points[:, 0], mean, points, static) > SHARED
    near &= points[:, 0] < MOST_SHARED * 0.5 * experiment.specimen.width_mm
    fields = np.where((unresolved(found, noise, points) | near)[:, None], np.nan, found.fields)
    mean = mean_field(fields, points, travel, share, limit, found.placing)
    return fields, mean, mapping_std(found, mean.kept)


def _correlation_at(
    distance: Array, mean: MeanField, points: Array, static: StaticNoise | None
) -> Array:
    """Correlation of the noise over distances [mm], about; 0 where nothing tells it."""
    if static is not None:
        return static.mapped.correlation_at(distance)
    try:
        floor = pooled_noise(with_enough(mean.residual), points[mean.kept], roughly=True)
    except (ValueError, IndexError):  # no sample with enough points
        return np.zeros_like(distance)
    return floor.correlation_at(distance)


def _with_mapping(noise: FieldNoise, by_mapping: Array) -> tuple[Array, float]:
    """SD (3,) of the mean [mm] and its nugget with the errors of mapping, which are of each point.

    All components have one nugget: that of the mean share.
    """
    variance, more = noise.mean_std**2, by_mapping**2
    own = noise.together.nugget
    nugget = float(np.mean((own * variance + more) / (variance + more)))
    return np.sqrt(variance + more), max(nugget, SMALLEST_NUGGET)


def _stated_length(samples: Sequence[Sample]) -> float | None:
    """Longest correlation length that the DIC program states, mm; None if it states none."""
    faces = [sample.face for sample in samples if sample.face is not None]
    return max((face.stated_length or 0.0 for face in faces), default=0.0) or None


def _stated(samples: Sequence[Sample]) -> Array | None:
    """SD (3,) of one folded field by what the DIC program states, mm; None if nothing."""
    faces = [sample.face for sample in samples if sample.face is not None]
    stated = [face.stated_std for face in faces if face.stated_std is not None]
    if not stated:
        return None
    # the mean of one half and the mirror image of the other
    return np.asarray(np.sqrt(np.mean(np.square(stated), axis=0) / 2), dtype=np.float64)
