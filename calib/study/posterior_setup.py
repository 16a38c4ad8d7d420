"""The posterior of one hypothesis, put together from the study file and the artifacts so far."""

from __future__ import annotations

from dataclasses import replace

from calib.data import Dataset
from calib.inference.forward import EmulatorForward
from calib.inference.likelihood import build_likelihood
from calib.inference.noise import NoiseSettings
from calib.inference.posterior import Posterior
from calib.inference.prior import Prior
from calib.study.config import Study
from calib.study.context import Context
from calib.study.data_stage import load_data
from calib.study.local_design import LOCAL, kept_box
from calib.study.mesh_error import MeshError
from calib.study.mesh_error_file import load_mesh_error
from calib.study.sections import Hypothesis
from calib.study.train_stage import load_emulator
from calib.study.unknowns import prior_of
from surrogate import ScaledEmulator


def emulator_posterior(
    context: Context, hypothesis: Hypothesis, *, whole: bool = False
) -> Posterior:
    """Posterior of a hypothesis with its emulator as forward model.

    With that of the posterior's box where there is one, and then zero outside, unless the `whole`
    box of the prior is asked for, as by what looks at parts of the data.
    """
    box = None if whole else kept_box(context.out, hypothesis)
    folder = context.out if box is None else context.out / LOCAL
    found = posterior_of(
        context.study,
        load_data(context.out).dataset,
        ScaledEmulator(load_emulator(folder, hypothesis)),
        load_mesh_error(context.out, hypothesis),
        noise_of(context.study),
        hypothesis,
    )
    return found if box is None else replace(found, prior=found.prior.within(box))


def posterior_of(
    study: Study,
    dataset: Dataset,
    emulator: ScaledEmulator,
    mesh: MeshError,
    noise: NoiseSettings,
    hypothesis: Hypothesis,
) -> Posterior:
    """Prior of the study times the likelihood of the data under a corrected emulator.

    Raises ValueError when the noise is impossible for the data.
    """
    forward = EmulatorForward(
        emulator, with_field=dataset.field is not None, correction=mesh.correction
    )
    prior = prior_of(study, hypothesis, with_field=dataset.field is not None)
    likelihood = build_likelihood(
        dataset,
        forward,
        noise,
        force_discretisation=mesh.force,
        field_floor=mesh.field_floor,
        field_patterns=mesh.field_patterns(dataset, noise, forward),
        unknown=sizes_of(prior),
    )
    return Posterior(prior, likelihood)


def sizes_of(prior: Prior) -> dict[str, tuple[float, float]]:
    """Unknown sizes of the errors with their bounds, in the order of theta."""
    return {unknown.name: (given.low, given.high) for unknown, given in prior.errors}


def noise_of(study: Study) -> NoiseSettings:
    """The study's assumptions on the errors of the force."""
    return NoiseSettings(
        load_cell_sd=study.noise.load_cell_sd,
        sample_correlation=study.noise.sample_correlation,
        travel_zero_sd=study.noise.travel_zero_sd,
        compliance_sd=study.noise.compliance_sd,
        face_travel_sd=study.noise.face_travel_sd,
        gain_sd=study.noise.gain_sd,
        field_scale_sd=study.noise.field_scale_sd,
        translation_sd=study.noise.translation_sd,
        rotation_sd=study.noise.rotation_sd,
        force_freedom=study.noise.force_freedom,
        field_freedom=study.noise.field_freedom,
        discrepancy=study.noise.discrepancy,
        discrepancy_of_force=study.noise.ratio,
        discrepancy_length=study.noise.discrepancy_length,
        discrepancy_travel_length=study.noise.discrepancy_travel_length,
    )
