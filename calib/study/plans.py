"""Experiments that could be made next, each as a likelihood whose data do not matter yet."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.data.dataset import Dataset, FieldData
from calib.inference.field_floor import FieldFloor
from calib.inference.forward import ForwardModel
from calib.inference.likelihood import Likelihood, build_likelihood
from calib.inference.noise import (
    COMPLIANCE,
    FACE,
    ZERO,
    NoiseSettings,
    field_nuisances,
    widening,
)
from calib.inference.planned import FirstOrderForward
from calib.inference.tangent_errors import Mistaken, tangents_at
from calib.study.config import Study
from calib.study.context import block_pin_model
from calib.study.sections import Hypothesis
from calib.study.varied_block import VariedBlock
from calib.study.views import Face, Run, run_with_views, similar, together
from calib.study.views_file import keep_run, kept_run
from fe.response import Array
from fe.specimens.block_pin import BlockPinModel

ASSUMED_NOISE = (0.01, 0.01, 0.02)
"""mm, of a camera where the study has none"""
SMALL_SCALE = 0.4
"""of a sample of 4 mm to one of 10 mm"""


@dataclass(frozen=True)
class Errors:
    """Errors of an experiment on a block of the study's kind."""

    own_share: Array
    """(n_step,) SD of the force between samples, load cell left out, over the force"""
    noise: NoiseSettings
    """the study's, its load cell not above what the samples differ by"""
    n_samples: int
    discretisation: Array
    """(n_step,) relative SD of the force's mesh error"""
    floor: FieldFloor
    """SD of the field's mesh error, its profile at the study's own points"""
    mistaken: Mistaken
    """for which the field's mesh error is"""
    noise_std: Array
    """(3,) along the face, up, towards the camera, mm"""
    length: float
    """correlation length of the noise, mm"""
    reference_share: float
    nugget: float
    smoothing: float = 0.0
    """mm, of the noise"""
    between: Array | None = None
    """(n_step, n_step) covariance of the force between samples, load cell left out, over the
    forces, where it was measured; elsewhere the SDs are correlated as the study assumes"""
    times: float = 1.0
    """as many samples as those by which it was measured"""
    directions: Array | None = None
    """(q, n_step, n_point, 3) mm in which the fields of samples differ, as errors of their mean at
    the study's own points"""

    def with_noise(self, **changed: float) -> Errors:
        """With other noise of the test."""
        return replace(self, noise=replace(self.noise, **changed))

    def of_samples(self, times: int) -> Errors:
        """Of so many times the samples.

        Where what differs between them was measured, all errors of their mean fall alike, those of
        the field too, and the covariance is known no better than it is. Elsewhere the noise of a
        field is that of its images.
        """
        if self.between is None:
            return replace(self, n_samples=times * self.n_samples)
        directions = None if self.directions is None else self.directions / np.sqrt(times)
        noise_std = self.noise_std / np.sqrt(times)
        return replace(self, times=times * self.times, directions=directions, noise_std=noise_std)

    def force_covariance(self, force: Array) -> Array | None:
        """(n_step, n_step) N^2 of one sample at forces (n_step,) N, where it was measured.

        Over `times`, and not by more `n_samples`: those are what its own error is counted by.
        """
        if self.between is None:
            return None
        covariance: Array = self.between * np.outer(force, force)
        return (covariance + self.noise.load_cell_sd**2 * np.eye(force.size)) / self.times

    def scaled(self, scale: float, *, noise: float) -> Errors:
        """Of a block `scale` times as large, seen with `noise` times the noise.

        The subset of the images is as large as the noise says: both go with the pixel. A pin is as
        tilted as before.
        """
        return replace(
            self.with_noise(face_travel_sd=scale * self.noise.face_travel_sd),
            floor=self.floor.scaled(scale),
            mistaken=_of_scaled_block(self.mistaken, scale),
            noise_std=noise * self.noise_std,
            length=noise * self.length,
            smoothing=noise * self.smoothing,
        )

    def beside_the_bar(self) -> Errors:
        """Of a camera at the side, of which a bar tilted along its length sees both ends."""
        kept = [k for k, name in enumerate(self.mistaken.names) if name != FACE]
        names = tuple(self.mistaken.names[k] for k in kept)
        nuisances = self.mistaken.nuisances[np.ix_(kept, kept)]
        mistaken = replace(self.mistaken, names=names, nuisances=nuisances)
        return replace(self.with_noise(face_travel_sd=0.0), mistaken=mistaken)


@dataclass(frozen=True)
class Plan:
    """One experiment to be weighed."""

    name: str
    group: str
    """what is changed: increments, instruments, camera or geometry"""
    likelihood: Likelihood
    steps: tuple[int, ...]
    """increments that are used"""
    with_field: bool
    source: str
    """where its predictions are from: the emulator, an FE run, or a scaled one"""


def planned_likelihood(
    forward: ForwardModel, travel: Array, points: Array | None, errors: Errors, theta: Array
) -> Likelihood:
    """Likelihood with the errors around the prediction at theta (3,); without points no field."""
    prediction = forward.predict(theta[None])
    force = prediction.force[0]
    field = None
    basis = forward.field_basis
    if points is not None and basis is not None and prediction.weights is not None:
        field = FieldData(
            points=points,
            displacement=basis.fields(prediction.weights)[0],
            noise_std=errors.noise_std,
            correlation_length=errors.length,
            reference_share=errors.reference_share,
            nugget=errors.nugget,
            smoothing=errors.smoothing,
            patterns=errors.directions,
        )
    covariance = errors.force_covariance(force)
    data = Dataset(
        name="planned",
        synthetic=True,
        travel=travel,
        force_mean=force,
        force_sd=np.hypot(errors.own_share * force, errors.noise.load_cell_sd)
        if covariance is None
        else np.sqrt(np.diag(covariance)),
        n_samples=errors.n_samples,
        field=field,
        force_covariance=covariance,
    )
    return build_likelihood(
        data,
        forward,
        errors.noise,
        force_discretisation=errors.discretisation,
        field_floor=errors.floor,
        field_patterns=None if field is None else _mesh_patterns(data, errors, forward, theta),
    )


def of_one_increment(likelihood: Likelihood, errors: Errors) -> Likelihood:
    """Of an experiment of which one increment is used.

    The variance of one is known better than the covariance of all, which widens the error of the
    mean where both were measured (`calib.inference.noise.mean_covariance`).
    """
    if errors.between is None:
        return likelihood
    own = likelihood.errors
    n, p = errors.n_samples, len(own.mean)
    better = widening(n, 1, errors.noise) / widening(n, p, errors.noise)
    return replace(likelihood, errors=replace(own, mean=better * own.mean))


def _mesh_patterns(data: Dataset, errors: Errors, forward: ForwardModel, theta: Array) -> Array:
    """(d + q, n_step, n_point, 3) errors of a field that look like other constants, mm.

    Along the tangents alone: how they turn is not known of the plans that rest on a single run, and
    plans are weighed against each other.
    """
    nuisances = {error.name: error for error in field_nuisances(data, errors.noise)}
    known = [nuisances[name] for name in errors.mistaken.names]
    return errors.mistaken.patterns(tangents_at(forward, theta, known))


def _of_scaled_block(found: Mistaken, scale: float) -> Mistaken:
    """Errors for which that of a block `scale` times as large would be mistaken."""
    powers = {
        ZERO: 1.0,
        FACE: 1.0,
        COMPLIANCE: -1.0,
    }  # travel grows with the block, force with its square
    factor = np.array([scale ** powers.get(name, 0.0) for name in found.names])
    return replace(found, nuisances=found.nuisances * np.outer(factor, factor))


def by_emulator(
    forward: ForwardModel, travel: Array, points: Array | None, errors: Errors, theta: Array
) -> Iterator[Plan]:
    """The study's own block with other increments and instruments."""
    every = tuple(range(travel.size))

    def plan(name: str, group: str, changed: Errors, *, camera: bool = True) -> Plan:
        """The study's experiment with other errors, with or without its camera."""
        likelihood = planned_likelihood(forward, travel, points, changed, theta)
        seen = camera and likelihood.field is not None
        return Plan(name, group, likelihood, every, seen, "emulator")

    same = plan("the same again", "repeat", errors)
    yield same
    alone = of_one_increment(same.likelihood, errors)
    for index, value in enumerate(travel):
        only = replace(same, name=f"only {value:g} mm", group="increments", steps=(index,))
        yield replace(only, likelihood=alone)
    yield plan(
        "load cell noise / 10",
        "instruments",
        errors.with_noise(load_cell_sd=errors.noise.load_cell_sd / 10),
    )
    yield plan("4 times the samples", "instruments", errors.of_samples(4))
    yield plan(
        "zero of the travel / 10",
        "instruments",
        errors.with_noise(travel_zero_sd=errors.noise.travel_zero_sd / 10),
    )
    if same.with_field:
        halved = replace(errors, noise_std=errors.noise_std / 2)
        yield plan("field noise / 2", "camera", halved)
        yield plan("no camera", "camera", errors, camera=False)


def by_runs(
    study: Study,
    hypothesis: Hypothesis,
    errors: Errors,
    theta: Array,
    echo: Callable[[str], None],
    store: Path,
) -> Iterator[Plan]:
    """Other cameras and other blocks, each by one FE run on the sampling mesh, kept in `store`.

    At theta (kappa, r) or (kappa, r, s) of a Mooney-Rivlin law. How fields of samples differ, and
    where on the face the mesh errs, is known at the study's own points alone.
    """
    errors = replace(errors, directions=None, floor=errors.floor.even)

    def plan(name: str, group: str, run: Run, changed: Errors, *faces: Face) -> Plan:
        """A test that sees these faces of the run, with these errors."""
        seen = together(run, faces)
        forward = FirstOrderForward(
            run.ratios, run.force, run.force_gradient, seen.displacement, seen.gradient
        )
        likelihood = planned_likelihood(forward, run.travel, seen.points, changed, theta)
        return Plan(name, group, likelihood, tuple(range(run.travel.size)), True, "FE run")

    model = block_pin_model(study, hypothesis, study.sampling_cells(hypothesis))
    block = model.template if isinstance(model, VariedBlock) else model
    assert isinstance(block, BlockPinModel)
    model = replace(block, field_grid=(2, 2))
    base = _solved("front and side", model, theta, echo, store)
    if base is not None:
        yield plan("front camera, by one FE run", "check", base, errors, "front")
        yield plan("side camera instead", "camera", base, errors.beside_the_bar(), "side")
        yield plan("front and side cameras", "camera", base, errors, "front", "side")
        small = similar(base, SMALL_SCALE)
        size = SMALL_SCALE * study.geometry.width
        for name, noise in (("camera as near as that", SMALL_SCALE), ("camera as before", 1.0)):
            scaled = errors.scaled(SMALL_SCALE, noise=noise)
            found = plan(f"{size:g} mm sample, {name}", "geometry", small, scaled, "front")
            yield replace(found, source="FE run, scaled")
    for name, changed in _other_blocks(model):
        run = _solved(name, changed, theta, echo, store)
        if run is not None:
            yield plan(name, "geometry", run, errors, "front")


def _other_blocks(model: BlockPinModel) -> Iterator[tuple[str, BlockPinModel]]:
    """Another pin at the same travels; another height at travels in proportion to it."""
    specimen = model.specimen
    for factor in (0.75, 1.25):
        width = factor * specimen.pin_width
        if 2.0 * specimen.pin_fillet < width < specimen.width:
            other = replace(specimen, pin_width=width)
            yield f"pin {width:.3g} mm wide", replace(model, specimen=other)
    for factor in (0.8, 1.2):
        height = factor * specimen.height
        travel = tuple(factor * t for t in model.travel)
        changed = replace(model, specimen=replace(specimen, height=height), travel=travel)
        yield f"sample {height:g} mm high", changed


def _solved(
    name: str, model: BlockPinModel, theta: Array, echo: Callable[[str], None], store: Path
) -> Run | None:
    if (kept := kept_run(store, model, theta[1:])) is not None:
        echo(f"FE run     {name} (kept)")
        return kept
    echo(f"FE run     {name}")
    try:
        run = run_with_views(model, theta[1:])
    except ValueError as error:
        echo(f"  left out: {error}")
        return None
    keep_run(store, model, run)
    return run
