"""Stages `virtual` and `data`: make a synthetic experiment on a finer mesh, or read a real one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.inference.coordinates import theta_of_constants
from calib.study.block_cells import is_finer, shown
from calib.study.config import Study, StudyError
from calib.study.context import Context, Simulate, stream
from calib.study.data_checks import check_load_cell
from calib.study.data_source import at_level
from calib.study.data_stage import StudyData, load_data, measured, save_data, with_mu
from calib.study.run_identity import run_identity
from calib.study.sections import Hypothesis, Virtual
from calib.study.simulate_stage import manifest_files
from calib.study.unknowns import fixed_values, law_of, parameters_of
from calib.virtual import VirtualNoise, virtual_experiment
from fe.campaign import CampaignPlan, run_campaigns
from fe.progress_bar import progress_bar
from fe.response import Array, Response

FOLDER = "virtual"


def run(context: Context) -> list[Path]:
    """Solve the truth on the finer mesh, add noise, keep the synthetic experiment.

    Raises StudyError when the mesh is not finer than that of the emulator's runs: the same mesh
    would hide the discretisation error, and the study would prove nothing.
    """
    study, folder = context.study, context.out / FOLDER
    virtual = _virtual(study)
    store, theta = folder / "run", truth_of(study)
    response = truth_run(context)
    try:
        dataset = virtual_experiment(
            lambda _: response,
            theta,
            noise(study),
            stream(study, "virtual experiment"),
            points=truth_model(context).points(),
            name=f"virtual experiment under {virtual.hypothesis}",
        )
    except ValueError as error:
        raise StudyError(f"virtual: {error}") from error
    truth = with_mu({"C10": virtual.C10, "C01": virtual.C01, "C11": virtual.C11})
    data = StudyData(dataset, None, truth, virtual.hypothesis)
    return [*save_data(folder, data), *manifest_files(store)]


def truth_of(study: Study) -> Array:
    """(kappa [MPa], ratios and further unknowns) behind the synthetic data.

    Of what has no constant in [virtual] the truth is the number that the study gives for it.
    """
    virtual, hypothesis = _virtual(study), _true_hypothesis(study)
    theta = theta_of_constants(virtual.C10, virtual.C01, virtual.C11)
    n_ratio = len(law_of(study, hypothesis).ratios)
    return np.concatenate([theta[: 1 + n_ratio], fixed_values(study, hypothesis)])


def truth_model(context: Context) -> Simulate:
    """The forward model on the mesh of the truth."""
    virtual = _virtual(context.study)
    return context.model(_true_hypothesis(context.study), virtual.cells, virtual.stiffening)


def _true_hypothesis(study: Study) -> Hypothesis:
    name = _virtual(study).hypothesis
    return next(h for h in study.hypotheses if h.name == name)


def truth_run(context: Context) -> Response:
    """The truth at kappa = 1 MPa: from disk when it has been run."""
    ratios = truth_of(context.study)[None, 1:]
    model = truth_model(context)
    plan = CampaignPlan(
        model,
        ratios,
        context.out / FOLDER / "run",
        parameters=parameters_of(context.study, _true_hypothesis(context.study)),
        fingerprint=run_identity(model),
        max_failure_rate=1.0,
    )
    with progress_bar("virtual", "run", shown=context.show_progress) as progress:
        [campaign] = run_campaigns([plan], context.map_fn, progress)
    return campaign.responses[0]


def noise(study: Study) -> VirtualNoise:
    """Errors of the synthetic experiment, from the families that the likelihood assumes."""
    virtual = _virtual(study)
    return VirtualNoise(
        n_samples=virtual.n_samples,
        force_sd_share=virtual.force_sd_share,
        load_cell_sd=study.noise.load_cell_sd,
        sample_correlation=study.noise.sample_correlation,
        travel_zero_sd=study.noise.travel_zero_sd,
        field_noise_std=virtual.field_noise_std,
        field_correlation_length=virtual.field_correlation_length,
        field_reference_share=virtual.field_reference_share,
    )


def run_data(context: Context) -> list[Path]:
    """Keep the data of the study as data.npz and data.json.

    Raises Contradiction for noise of the load cell that synthetic data exclude: of measured ones
    that was refused when the study was read, of these nothing was known.
    """
    study = context.study
    if study.virtual is None:
        data = measured(study)
        for sentence in data.left_out:
            context.echo(f"  left out: {sentence}")
    else:
        data = load_data(context.out / FOLDER)
        data = replace(data, dataset=at_level(data.dataset, study.data))
        check_load_cell(study, float(data.dataset.force_sd.min()))
    return save_data(context.out, data)


def _virtual(study: Study) -> Virtual:
    virtual = study.virtual
    if virtual is None:
        raise StudyError("virtual: found no such section, expected one to make synthetic data")
    for hypothesis in study.hypotheses:
        cells = study.sampling_cells(hypothesis)
        if not is_finer(virtual.cells, cells):
            raise StudyError(
                f"virtual.cells: found {shown(virtual.cells)}, expected a mesh finer than "
                f"the sampling mesh {shown(cells)}"
            )
    return virtual
