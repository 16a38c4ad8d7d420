"""One look at the posterior in the stage `refine`: by all runs so far and all that is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.inference.forward import EmulatorForward
from calib.inference.likelihood import build_likelihood
from calib.inference.posterior import Posterior
from calib.study.context import Context, stream
from calib.study.data_stage import load_data
from calib.study.judgement import has_field
from calib.study.local_design import within
from calib.study.mesh_error import MeshError, mesh_error
from calib.study.mesh_error_file import check_folder, pin_folder
from calib.study.posterior_setup import noise_of, sizes_of
from calib.study.refine_rounds import Loop
from calib.study.refinement import Outlook, outlook
from calib.study.run_identity import run_identity
from calib.study.sections import Hypothesis
from calib.study.train_stage import FIRST, design_runs, load_emulator
from calib.study.training_runs import rows
from calib.study.unknowns import design_box, parameters_of, prior_of
from calib.study.usual_meshes import field_order
from fe.campaign import CampaignFailed, CampaignPlan, load_campaign
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import Emulator, ScaledEmulator, TrainingSet

NOMINAL_FORCE_ERROR = 0.02
"""relative error of the force that stands in for the mesh's until it is measured"""
NOMINAL_FIELD_ERROR = 0.005
"""the same for the field, mm"""


def refine_folder(out: Path, hypothesis: Hypothesis) -> Path:
    """Where the runs at the posterior are kept."""
    return out / "refine" / hypothesis.name


def check_plan(context: Context, hypothesis: Hypothesis, ratios: Array) -> CampaignPlan:
    """Runs on the finer mesh."""
    model = context.check_model(hypothesis)
    folder = check_folder(context.out, hypothesis)
    return CampaignPlan(
        model,
        ratios,
        folder,
        parameters=parameters_of(context.study, hypothesis),
        fingerprint=run_identity(model),
        max_failure_rate=1.0,
    )


def pin_plan(context: Context, hypothesis: Hypothesis, ratios: Array) -> CampaignPlan | None:
    """Runs on the sampling mesh under the finer mesh's pin; None where it has the same."""
    study = context.study
    if study.mesh.check_stiffening == 1.0:
        return None
    cells = study.sampling_cells(hypothesis)
    model = context.model(hypothesis, cells, study.mesh.check_stiffening)
    return CampaignPlan(
        model,
        ratios,
        pin_folder(context.out, hypothesis),
        parameters=parameters_of(study, hypothesis),
        fingerprint=run_identity(model),
        max_failure_rate=1.0,
    )


def plan(context: Context, hypothesis: Hypothesis, ratios: Array) -> CampaignPlan:
    """Runs at the posterior."""
    model = context.sampling_model(hypothesis)
    return CampaignPlan(
        model,
        ratios,
        refine_folder(context.out, hypothesis),
        parameters=parameters_of(context.study, hypothesis),
        fingerprint=run_identity(model),
        design={"kind": "posterior", "seed": context.study.seed},
        max_failure_rate=1.0,  # held against the rate of all runs by `refine_stage`
    )


def forces_of(runs: TrainingSet) -> TrainingSet:
    """The same runs without their fields."""
    partial = None if runs.partial is None else replace(runs.partial, displacement=None)
    return replace(runs, displacement=None, displacement_gradient=None, partial=partial)


def look(context: Context, hypothesis: Hypothesis, loop: Loop) -> Outlook:
    """The posterior by the runs so far and what is known of the mesh's error.

    Before any run at the posterior: by the first emulator and the forces alone, as a first emulator
    cannot tell the narrow region that a field leaves. Once there is a second design: by the runs in
    its box, within it; by those outside second designs where none held the posterior.
    """
    study, dataset = context.study, load_data(context.out).dataset
    mesh = None
    if not len(loop.ratios):
        emulator = replace(
            load_emulator(context.out / FIRST, hypothesis), field=None, field_shape=None
        )
        runs = forces_of(design_runs(context, hypothesis).training_set(study))
        dataset = replace(dataset, field=None)
    else:
        added = load_campaign(plan(context, hypothesis, loop.ratios))
        few = rows(added, np.delete(np.arange(len(added.theta)), loop.local))
        chosen = design_runs(context, hypothesis, few if loop.box is None else added)
        runs = within(chosen.training_set(study), loop.box)
        if dataset.field is None:  # the field would take most of the time and enter nothing
            runs = forces_of(runs)
        emulator = Emulator.fit(runs, study.seed)
        mesh = _mesh_error_so_far(context, hypothesis, loop, added)
    forward = EmulatorForward(
        ScaledEmulator(emulator),
        with_field=dataset.field is not None,
        correction=None if mesh is None else mesh.correction,
    )
    prior = prior_of(study, hypothesis, with_field=dataset.field is not None)
    noise = noise_of(study)
    likelihood = build_likelihood(
        dataset,
        forward,
        noise,
        force_discretisation=NOMINAL_FORCE_ERROR if mesh is None else mesh.force,
        field_floor=NOMINAL_FIELD_ERROR if mesh is None else mesh.field_floor,
        field_patterns=None if mesh is None else mesh.field_patterns(dataset, noise, forward),
        unknown=sizes_of(prior),
    )
    if loop.box is not None:
        prior = prior.within(loop.box)
    rng = stream(study, f"outlook {hypothesis.name} {len(loop.rounds)}")
    return outlook(emulator, runs, Posterior(prior, likelihood), forward, rng)


def _mesh_error_so_far(
    context: Context, hypothesis: Hypothesis, loop: Loop, added: Campaign
) -> MeshError | None:
    """As the last checks say; None where at none all runs reached the last increment."""
    fine = load_campaign(check_plan(context, hypothesis, loop.ratios[list(loop.checked)]))
    coarse = rows(added, list(loop.checked))
    try:
        return measured_mesh_error(context, hypothesis, fine, coarse)
    except CampaignFailed:
        return None


def measured_mesh_error(
    context: Context, hypothesis: Hypothesis, fine: Campaign, coarse: Campaign
) -> MeshError:
    """Error of the mesh by runs at the same posterior means; of forces alone the same everywhere.

    Raises CampaignFailed where at none all reached the last increment, under both pins.
    """
    study = context.study
    extent = np.ptp(design_box(study, hypothesis), axis=1) if has_field(study) else None
    stiffer = pin_plan(context, hypothesis, fine.theta)
    return mesh_error(
        fine,
        coarse,
        study.refinement(hypothesis),
        hypothesis.name,
        extent,
        None if stiffer is None else (load_campaign(stiffer), study.mesh.check_stiffening),
        field_order(hypothesis),
    )
