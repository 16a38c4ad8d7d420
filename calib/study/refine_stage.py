"""Stage `refine`: more FE runs where the posterior is, until its mean will not move any more.

The design covers the whole prior; the posterior is a small part of it. Runs are proposed
that lower the emulator's variance most over the posterior, run, and the emulator fitted again; the
error that it had there before is shown. The first run is at the posterior mean by the first
emulator, the last at that by the last but one; both are solved on the finer mesh too.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.inference.forward import EmulatorForward
from calib.inference.likelihood import build_likelihood
from calib.inference.posterior import Posterior
from calib.study.artifacts import read_json, write_json
from calib.study.context import Context, stream
from calib.study.data_stage import load_data
from calib.study.judgement import measurement_noise
from calib.study.mesh_error import MeshError, check_folder, mesh_error
from calib.study.posterior_setup import noise_of, sizes_of
from calib.study.progress import progress_bar
from calib.study.refine_rounds import Loop, Round, described
from calib.study.refinement import Outlook, outlook
from calib.study.sections import Hypothesis
from calib.study.simulate_stage import load_design, manifest_files
from calib.study.train_stage import FIRST, design_runs, fit_and_judge, load_emulator
from calib.study.training_runs import rows
from calib.study.unknowns import parameters_of, prior_of
from calib.study.verification import campaigns_added, n_rounds, refinement_is_kept
from fe.campaign import CampaignFailed, CampaignPlan, load_campaign, run_campaigns
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import Emulator, ScaledEmulator
from surrogate.refine import STOP_BELOW

BATCH = 2
"""runs of one round: each is chosen knowing where the others of its round are, not what they say"""
CHECKED = [0, -1]
"""runs at which the error of the mesh is measured: the posterior mean, first and last"""
NOMINAL_FORCE_ERROR = 0.02
"""relative error of the force that stands in for the mesh's until it is measured"""
NOMINAL_FIELD_ERROR = 0.005
"""the same for the field, mm"""
REFINEMENT = "refinement.json"


def run(context: Context) -> list[Path]:
    """Add runs at the posterior, train again; returns emulators, diagnostics and runs.

    In a round of verification (`calib.study.verification`) the runs at the posterior are those
    there are, and the runs at the maximum train the emulator beside them.
    Raises CampaignFailed when more of a hypothesis' runs end early than the study allows.
    """
    hypotheses = context.study.hypotheses
    path = context.out / REFINEMENT
    if not refinement_is_kept(context.out, path):
        _add_runs(context)
    kept = read_json(path)
    plans = [_plan(context, h, np.asarray(kept[h.name]["ratios"], dtype=float)) for h in hypotheses]
    runs = {
        h.name: design_runs(context, h, refined, *campaigns_added(context, h))
        for h, refined in zip(hypotheses, run_campaigns(plans, context.map_fn), strict=True)
    }
    rounds = {h.name: n_rounds(context.out, h) for h in hypotheses}
    paths = fit_and_judge(context, context.out, runs, rounds)
    files = [file for h in hypotheses for file in manifest_files(refine_folder(context.out, h))]
    return [*paths, path, *files]


def _add_runs(context: Context) -> None:
    """Rounds of runs where the posterior is, until its mean rests; writes refinement.json."""
    hypotheses = context.study.hypotheses
    loops = {h.name: Loop(np.zeros((0, len(parameters_of(context.study, h))))) for h in hypotheses}
    while not all(loop.done for loop in loops.values()):
        before = loops
        loops = {h.name: _next_round(context, h, loops[h.name]) for h in hypotheses}
        _run_round(context, before, loops)
    added = {h.name: load_campaign(_plan(context, h, loops[h.name].ratios)) for h in hypotheses}
    found = {h.name: described(context, h, loops[h.name], added[h.name]) for h in hypotheses}
    write_json(context.out / REFINEMENT, found)


def load_refinement(context: Context, hypothesis: Hypothesis) -> Campaign:
    """The runs at the posterior that `run` kept; runs nothing."""
    kept = read_json(context.out / REFINEMENT)[hypothesis.name]
    return load_campaign(_plan(context, hypothesis, np.asarray(kept["ratios"], dtype=float)))


def check_sets(context: Context) -> list[CampaignPlan]:
    """The runs on the finer mesh at the posterior's means, one set a hypothesis."""
    kept = read_json(context.out / REFINEMENT)
    return [
        _check_plan(context, h, np.asarray(kept[h.name]["ratios"], dtype=float)[CHECKED])
        for h in context.study.hypotheses
    ]


def refine_folder(out: Path, hypothesis: Hypothesis) -> Path:
    """Where the runs at the posterior are kept."""
    return out / "refine" / hypothesis.name


def _next_round(context: Context, hypothesis: Hypothesis, loop: Loop) -> Loop:
    """Look at the posterior by all runs so far and choose the runs to come."""
    if loop.done:
        return loop
    found = _outlook(context, hypothesis, loop)
    first, shift = not len(loop.ratios), found.shift
    n_left = context.study.design.n_refine - len(loop.ratios) - 1  # the last is at the mean
    last = not first and (shift.is_small or n_left < 1)
    rng = stream(context.study, f"refine {hypothesis.name} {len(loop.rounds)}")
    noise = measurement_noise(context.study)
    added = found.mean[None]
    if not (first or last):
        design = load_design(context, hypothesis).theta[: context.study.design.n_runs]
        runs = np.concatenate([design, loop.ratios])
        proposed = found.proposals(min(BATCH, n_left), runs, noise, rng)
        last = not len(proposed)
        added = found.mean[None] if last else proposed
    names = ("ln kappa", *found.quadrature.space.x_names[1:])
    facts = Round(found.emulator.header.n_train, shift.shift, len(added), names)
    context.echo(
        f"  {hypothesis.name}: {facts.n_train} runs, posterior mean may move by "
        f"{shift.shift.max():.2g} SD (limit {STOP_BELOW:g}), {facts.n_added} added"
    )
    return Loop(
        np.concatenate([loop.ratios, added]),
        (*loop.rounds, facts),
        (*loop.emulators, found.emulator),
        last,
    )


def _run_round(context: Context, before: dict[str, Loop], loops: dict[str, Loop]) -> None:
    """Run what the round chose for all hypotheses; the long runs on the finer mesh go first."""
    checks, plans = [], []
    for hypothesis in context.study.hypotheses:
        old, new = before[hypothesis.name], loops[hypothesis.name]
        if old.done:
            continue
        due = (not len(old.ratios), new.done)
        checked = [index for index, at in zip(CHECKED, due, strict=True) if at]
        if checked:
            checks.append(_check_plan(context, hypothesis, new.ratios[checked]))
        plans.append(_plan(context, hypothesis, new.ratios))
    number = max(len(loop.rounds) for loop in loops.values())
    with progress_bar(f"refine {number}", "run", shown=context.show_progress) as progress:
        run_campaigns([*checks, *plans], context.map_fn, progress)
    for hypothesis in context.study.hypotheses:
        _stop_beyond_rate(context, hypothesis, loops[hypothesis.name])


def _stop_beyond_rate(context: Context, hypothesis: Hypothesis, loop: Loop) -> None:
    """Raise CampaignFailed when too many runs of design and refinement together ended early."""
    parts = (
        load_design(context, hypothesis),
        load_campaign(_plan(context, hypothesis, loop.ratios)),
    )
    failed, total = sum(c.n_failed for c in parts), sum(len(c.theta) for c in parts)
    rate = context.study.design.max_failure_rate
    if failed > rate * total:
        raise CampaignFailed(
            f"{hypothesis.name}: {failed} of {total} runs of design and refinement ended before "
            f"the last increment, more than the {rate:.0%} allowed; narrow the priors of r and s, "
            "change the sampling mesh or lower the last increment",
            n_failed=failed,
            n_done=total,
            n_total=total,
        )


def _check_plan(context: Context, hypothesis: Hypothesis, ratios: Array) -> CampaignPlan:
    model = context.model(hypothesis, context.study.check_cells(hypothesis))
    folder = check_folder(context.out, hypothesis)
    return CampaignPlan(
        model,
        ratios,
        folder,
        parameters=parameters_of(context.study, hypothesis),
        max_failure_rate=1.0,
    )


def _plan(context: Context, hypothesis: Hypothesis, ratios: Array) -> CampaignPlan:
    return CampaignPlan(
        context.sampling_model(hypothesis),
        ratios,
        refine_folder(context.out, hypothesis),
        parameters=parameters_of(context.study, hypothesis),
        design={"kind": "posterior", "seed": context.study.seed},
        max_failure_rate=1.0,  # held against the rate of all runs by `_stop_beyond_rate`
    )


def _outlook(context: Context, hypothesis: Hypothesis, loop: Loop) -> Outlook:
    """The posterior by the runs so far and what is known of the mesh's error.

    Before any run at the posterior: by the first emulator and the forces alone, as a first emulator
    cannot tell the narrow region that a field leaves.
    """
    study, dataset = context.study, load_data(context.out).dataset
    mesh = None
    if not len(loop.ratios):
        emulator = load_emulator(context.out / FIRST, hypothesis)
        dataset = replace(dataset, field=None)
    else:
        added = load_campaign(_plan(context, hypothesis, loop.ratios))
        runs = design_runs(context, hypothesis, added)
        emulator = Emulator.fit(runs.training_set(study), study.seed)
        mesh = _first_mesh_error(context, hypothesis, added)
    forward = EmulatorForward(
        ScaledEmulator(emulator),
        with_field=dataset.field is not None,
        correction=None if mesh is None else mesh.correction,
    )
    prior = prior_of(study, hypothesis, with_field=dataset.field is not None)
    likelihood = build_likelihood(
        dataset,
        forward,
        noise_of(study),
        force_discretisation=NOMINAL_FORCE_ERROR if mesh is None else mesh.force,
        field_floor=NOMINAL_FIELD_ERROR if mesh is None else mesh.field_floor,
        field_patterns=None if mesh is None else mesh.field_patterns,
        unknown=sizes_of(prior),
    )
    rng = stream(study, f"outlook {hypothesis.name} {len(loop.rounds)}")
    return outlook(emulator, Posterior(prior, likelihood), forward, rng)


def _first_mesh_error(
    context: Context, hypothesis: Hypothesis, added: Campaign
) -> MeshError | None:
    """As the first run says; None when it did not reach the last increment on both meshes."""
    fine = load_campaign(_check_plan(context, hypothesis, added.theta[CHECKED[:1]]))
    coarse = rows(added, CHECKED[:1])
    if not (fine.reached & coarse.reached).any():
        return None
    refinement = context.study.refinement(hypothesis)
    return mesh_error(fine, coarse, refinement, hypothesis.name)
