"""Stage `refine`: more FE runs where the posterior is, until its mean will not move any more.

The design covers the whole prior; the posterior is a small part of it. Runs are proposed
that lower the emulator's variance most over the posterior, run, and the emulator fitted again; the
error that it had there before is shown. The first run is at the posterior mean by the first
emulator, the last at that by the last but one. Both are solved on the finer mesh too; so are runs
at means between them while the correction of the mesh moves these far. Where the
posterior's box is a small part of the prior's, a second design is run in it, and the emulator that
is sampled learns from the runs in that box alone (`calib.study.local_design`).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.study.artifacts import read_json, write_json
from calib.study.config import Study
from calib.study.context import Context, stream
from calib.study.judgement import has_field, measurement_noise
from calib.study.local_design import LOCAL, REFINEMENT, designed_box
from calib.study.next_runs import Choice
from calib.study.refine_outlook import check_plan, look, pin_plan, plan, refine_folder
from calib.study.refine_rounds import Loop, described
from calib.study.sections import Hypothesis
from calib.study.simulate_stage import load_design, manifest_files
from calib.study.train_stage import design_runs, fit_and_judge
from calib.study.training_runs import rows
from calib.study.unknowns import by_constants, design_box, parameters_of
from calib.study.verification import campaigns_added, n_rounds, refinement_is_kept
from fe.campaign import CampaignFailed, CampaignPlan, list_campaign, load_campaign, run_campaigns
from fe.campaign_result import Campaign
from fe.progress_bar import progress_bar
from surrogate.refine import STOP_BELOW


def run(context: Context) -> list[Path]:
    """Add runs at the posterior, train again; returns emulators, diagnostics and runs.

    Emulators of the whole box, and of the posterior's where there is a second design.

    In a round of verification (`calib.study.verification`) the runs at the posterior are those
    there are, and the runs at the maximum train the emulator beside them.
    Raises CampaignFailed when more of a hypothesis' runs end early than the study allows.
    """
    hypotheses = context.study.hypotheses
    path = context.out / REFINEMENT
    if not refinement_is_kept(context.out, path):
        _add_runs(context)
    kept = read_json(path)
    plans = [plan(context, h, np.asarray(kept[h.name]["ratios"], dtype=float)) for h in hypotheses]
    refined = dict(
        zip((h.name for h in hypotheses), run_campaigns(plans, context.map_fn), strict=True)
    )
    rounds = {h.name: n_rounds(context.out, h) for h in hypotheses}
    whole, local = {}, {}
    for h in hypotheses:
        found, added = refined[h.name], campaigns_added(context, h)
        # Second designs crowd in a small part of the whole box and would rule its modes.
        few = rows(found, np.delete(np.arange(len(found.theta)), kept[h.name]["local"]))
        whole[h.name] = design_runs(context, h, few, *added)
        if (box := designed_box(context.out, h)) is not None:
            local[h.name] = replace(design_runs(context, h, found, *added), box=box)
    paths = fit_and_judge(context, context.out, whole, rounds)
    paths += fit_and_judge(context, context.out / LOCAL, local, rounds)
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
    added = {h.name: load_campaign(plan(context, h, loops[h.name].ratios)) for h in hypotheses}
    found = {h.name: described(context, h, loops[h.name], added[h.name]) for h in hypotheses}
    write_json(context.out / REFINEMENT, found)
    for checked in check_sets(context):  # the last of them may be there, and are not unused
        if checked.store.is_dir():
            list_campaign(checked)


def load_refinement(context: Context, hypothesis: Hypothesis) -> Campaign:
    """The runs at the posterior that `run` kept; runs nothing."""
    kept = read_json(context.out / REFINEMENT)[hypothesis.name]
    return load_campaign(plan(context, hypothesis, np.asarray(kept["ratios"], dtype=float)))


def check_sets(context: Context) -> list[CampaignPlan]:
    """The runs on the finer mesh at the posterior's means, one set a hypothesis; then the pin's."""
    kept = read_json(context.out / REFINEMENT)
    ratios = {name: np.asarray(own["ratios"], dtype=float) for name, own in kept.items()}
    places = [(h, ratios[h.name][checked_runs(context, h)]) for h in context.study.hypotheses]
    of_pin = [pin_plan(context, h, at) for h, at in places]
    return [*(check_plan(context, h, at) for h, at in places), *(p for p in of_pin if p)]


def checked_runs(context: Context, hypothesis: Hypothesis) -> list[int]:
    """Rows of the runs at the posterior that are solved on the finer mesh too, in that order."""
    kept = read_json(context.out / REFINEMENT)[hypothesis.name]
    # Until 2026-11-23 it was the first and the last, and the file did not say so.
    return [int(row) for row in kept.get("checked", [0, len(kept["ratios"]) - 1])]


def _next_round(context: Context, hypothesis: Hypothesis, loop: Loop) -> Loop:
    """Look at the posterior by all runs so far and choose the runs to come."""
    if loop.done:
        return loop
    study = context.study
    found = look(context, hypothesis, loop)
    plan_of = Choice(
        design=load_design(context, hypothesis).theta[: study.design.n_runs],
        box=design_box(study, hypothesis),
        noise=measurement_noise(study),
        n_refine=study.design.n_refine,
        n_local=study.design.n_local if _may_have_box(study, hypothesis) else 0,
        seed=study.seed,
    )
    rng = stream(study, f"refine {hypothesis.name} {len(loop.rounds)}")
    after = plan_of.next_runs(loop, found, rng)
    facts = after.rounds[-1]
    where = "" if loop.box is None else f", {facts.mass_beyond:.1g} of it beyond its box"
    context.echo(
        f"  {hypothesis.name}: {facts.n_train} runs, posterior mean may move by "
        f"{facts.predicted_shift.max():.2g} SD (limit {STOP_BELOW:g}){where}, {facts.n_added} added"
    )
    return after


def _may_have_box(study: Study, hypothesis: Hypothesis) -> bool:
    """Of forces every mode is kept; constants with priors of their own leave no box."""
    return has_field(study) and not by_constants(study, hypothesis)


def _run_round(context: Context, before: dict[str, Loop], loops: dict[str, Loop]) -> None:
    """Run what the round chose for all hypotheses; the long runs on the finer mesh go first."""
    checks, pins, plans = [], [], []
    for hypothesis in context.study.hypotheses:
        old, new = before[hypothesis.name], loops[hypothesis.name]
        if old.done:
            continue
        # The last ones of all hypotheses run together in stage `check`.
        if not new.done and len(new.checked) > len(old.checked):
            at = new.ratios[list(new.checked)]
            checks.append(check_plan(context, hypothesis, at))
            pins.append(pin_plan(context, hypothesis, at))
        plans.append(plan(context, hypothesis, new.ratios))
    number = max(len(loop.rounds) for loop in loops.values())
    with progress_bar(f"refine {number}", "run", shown=context.show_progress) as progress:
        run_campaigns([*checks, *(p for p in pins if p), *plans], context.map_fn, progress)
    for hypothesis in context.study.hypotheses:
        _stop_beyond_rate(context, hypothesis, loops[hypothesis.name])


def _stop_beyond_rate(context: Context, hypothesis: Hypothesis, loop: Loop) -> None:
    """Raise CampaignFailed when too many runs of design and refinement together ended early."""
    parts = (
        load_design(context, hypothesis),
        load_campaign(plan(context, hypothesis, loop.ratios)),
    )
    failed, total = sum(c.n_failed for c in parts), sum(len(c.theta) for c in parts)
    rate = context.study.design.max_failure_rate
    if failed > rate * total:
        raise CampaignFailed(
            f"{hypothesis.name}: {failed} of {total} runs of design and refinement ended before "
            f"the last increment, more than the {rate:.0%} allowed; narrow the priors of its "
            "unknowns, change the sampling mesh or lower the last increment",
            n_failed=failed,
            n_done=total,
            n_total=total,
        )
