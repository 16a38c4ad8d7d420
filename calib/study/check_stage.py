"""Stage `check`: the error of the mesh where the posterior is, by runs on a finer mesh.

The first of each hypothesis were made by the stage `refine`, which needs them; the last ones, often
the longest runs of a study, are made here, side by side. The last two that got to the end tell the
error. It may move a posterior out of the box of its second design, so that this is looked at, too.
"""

from __future__ import annotations

from pathlib import Path

from calib.inference.quadrature import integrate
from calib.study.artifacts import write_json
from calib.study.context import Context
from calib.study.local_design import BOXES, MOST_LOST, designed_box, mass_beyond
from calib.study.mesh_error_file import check_folder, pin_folder, save_mesh_error
from calib.study.posterior_setup import emulator_posterior
from calib.study.refine_outlook import measured_mesh_error
from calib.study.refine_stage import check_sets, checked_runs, load_refinement
from calib.study.simulate_stage import manifest_files
from calib.study.training_runs import rows
from calib.study.unknowns import design_box
from fe.campaign import run_campaigns
from fe.progress_bar import progress_bar


def run(context: Context) -> list[Path]:
    """Solve finer mesh and stiffer pin at the last posterior mean and measure the difference.

    One npz and json a hypothesis. Raises CampaignFailed when at no point the runs of finer mesh and
    stiffer pin reach the last increment.
    """
    with progress_bar("check mesh", "run", shown=context.show_progress) as progress:
        found = run_campaigns(check_sets(context), context.map_fn, progress)
    paths = []
    for hypothesis, campaign in zip(context.study.hypotheses, found, strict=False):
        runs = load_refinement(context, hypothesis)
        coarse = rows(runs, checked_runs(context, hypothesis))
        error = measured_mesh_error(context, hypothesis, campaign, coarse)
        names = [parameter.name for parameter in runs.parameters]
        paths += save_mesh_error(context.out, hypothesis, context.study, error, names)
        paths += manifest_files(check_folder(context.out, hypothesis))
        if context.study.mesh.check_stiffening > 1.0:
            paths += manifest_files(pin_folder(context.out, hypothesis))
    return [*paths, *_look_at_boxes(context)]


def _look_at_boxes(context: Context) -> list[Path]:
    """Keep which share of each posterior lies beyond the box of its second design; the file.

    None where no hypothesis has one.
    """
    path, found = context.out / BOXES, {}
    path.unlink(missing_ok=True)  # what it says is not to be asked for a posterior below
    for hypothesis in context.study.hypotheses:
        box = designed_box(context.out, hypothesis)
        if box is None:
            continue
        posterior = integrate(emulator_posterior(context, hypothesis))
        beyond = mass_beyond(posterior, box, design_box(context.study, hypothesis))
        found[hypothesis.name] = beyond
        if beyond > MOST_LOST:
            context.echo(
                f"  {hypothesis.name}: {beyond:.2g} of the posterior lies beyond the box of its "
                "second design; it is sampled with the emulator of the prior's box"
            )
    if not found:
        return []
    write_json(path, found)
    return [path]
