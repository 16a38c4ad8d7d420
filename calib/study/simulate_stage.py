"""Stage `simulate`: the FE runs that train and judge the emulators."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from calib.study.artifacts import read_json
from calib.study.campaign_tables import campaign_table, design_figure, failures_table
from calib.study.config import Study
from calib.study.context import Context
from calib.study.figure_style import save_png
from calib.study.run_identity import run_identity
from calib.study.sections import Hypothesis
from calib.study.tables import Table
from calib.study.unknowns import design_points, parameters_of
from fe.campaign import (
    CampaignFailed,
    CampaignPlan,
    list_campaign,
    load_campaign,
    run_campaigns,
)
from fe.campaign_result import Campaign
from fe.manifest import MANIFEST
from fe.progress_bar import progress_bar

KEYS = ("parameters", "runs", "unused")
"""of a manifest, what is read here"""
_KIND = {
    "sobol": "corners, then scrambled Sobol",
    "latin": "corners, then a nested maximin Latin hypercube",
}
"""what the manifest says of `design.sequence`"""


def run_design(context: Context) -> list[Path]:
    """All hypotheses' runs in one map; returns the files kept.

    Runs that did not reach the last increment are listed, also when there are too many of them.
    """
    plans = [design_plan(context, hypothesis) for hypothesis in context.study.hypotheses]
    try:
        with progress_bar("simulate", "run", shown=context.show_progress) as progress:
            run_campaigns(plans, context.map_fn, progress)
    except CampaignFailed:
        _tell_failures(context)
        raise
    _tell_failures(context)
    return [path for plan in plans for path in manifest_files(plan.store)]


def _tell_failures(context: Context) -> None:
    for table in failure_tables(context.out, context.study):
        context.echo(table.text())


def load_design(context: Context, hypothesis: Hypothesis) -> Campaign:
    """The runs of one hypothesis that `run_design` kept; runs nothing."""
    return load_campaign(design_plan(context, hypothesis))


def design_plan(context: Context, hypothesis: Hypothesis) -> CampaignPlan:
    """The runs that train and judge the emulator of one hypothesis."""
    study, model = context.study, context.sampling_model(hypothesis)
    return CampaignPlan(
        model,
        design_points(study, hypothesis),
        campaign_folder(context.out, hypothesis),
        parameters=parameters_of(study, hypothesis),
        fingerprint=run_identity(model),
        design={
            "kind": _KIND[study.design.sequence],
            "shape": study.design.shape,
            "seed": study.seed,
            "n_train": study.design.n_runs,
            "n_held_out": study.design.n_held_out,
        },
        max_failure_rate=study.design.max_failure_rate,
    )


def failure_tables(out: Path, study: Study) -> list[Table]:
    """Runs of each hypothesis that ended early, as the manifests say."""
    found = [
        failures_table(hypothesis.name, manifest)
        for hypothesis in study.hypotheses
        if (manifest := read_manifest(campaign_folder(out, hypothesis))) is not None
    ]
    return [table for table in found if table is not None]


def closing_lines(context: Context, told: bool) -> list[str]:
    """What `calib simulate` prints at its end: tables, and where runs and figure are.

    `told`: whether `run_design` has run, and printed the failures.  If not, the manifests in the
    folder may be those of another design, one that was stopped.
    """
    out, study = context.out, context.study
    folders = {h.name: campaign_folder(out, h) for h in study.hypotheses}
    if not told:
        for hypothesis in study.hypotheses:
            list_campaign(design_plan(context, hypothesis))
    manifests = {name: read_json(folder / MANIFEST, KEYS) for name, folder in folders.items()}
    tables = [campaign_table(manifests), *([] if told else failure_tables(out, study))]
    figure = out / "campaign" / "design.png"
    save_png(design_figure(manifests), figure)
    return [
        "",
        *(f"{table.text()}\n" for table in tables),
        *(f"{'runs':<9} {folder}" for folder in folders.values()),
        f"{'figure':<9} {figure}",
    ]


def campaign_folder(out: Path, hypothesis: Hypothesis) -> Path:
    """Where the emulator's runs of a hypothesis are kept."""
    return out / "campaign" / hypothesis.name


def manifest_files(store: Path) -> list[Path]:
    """The runs that the manifest of a campaign lists."""
    runs = read_json(store / MANIFEST, KEYS)["runs"]
    return [store / run["file"] for run in runs if run["file"]]


def read_manifest(store: Path) -> dict[str, Any] | None:
    """The manifest of a campaign, None where none has begun."""
    path = store / MANIFEST
    found: dict[str, Any] | None = read_json(path, KEYS) if path.is_file() else None
    return found
