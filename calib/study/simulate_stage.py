"""Stage `simulate`: the FE runs that train and judge the emulators."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from calib.study.artifacts import read_json
from calib.study.config import Study
from calib.study.context import Context, fingerprint
from calib.study.progress import progress_bar
from calib.study.sections import Hypothesis
from calib.study.simulations import RunSet, run_together
from fe.campaign import Campaign, run_campaign
from fe.response import Array
from surrogate.design import sobol_design

T = TypeVar("T")
R = TypeVar("R")


def design_ratios(study: Study) -> Array:
    """(n_runs + n_held_out, 2) ratios (r, s) in the box of their priors; training runs first.

    The corners come first, so that the emulator interpolates everywhere; the runs held out are
    later points of the same low-discrepancy sequence, inside the box. Points are denser at small
    s: there C11, which matters most at large strain, changes the shape of the force curve fastest.
    """
    r, s = study.prior.r, study.prior.s
    n = study.design.n_runs + study.design.n_held_out
    unit = sobol_design(n, np.array([[0.0, 1.0], [0.0, 1.0]]), study.seed)
    return np.column_stack(
        [r.low + (r.high - r.low) * unit[:, 0], s.low + (s.high - s.low) * unit[:, 1] ** 2]
    )


def run_design(context: Context) -> list[Path]:
    """All hypotheses' runs in one pool of processes; returns the files kept."""
    study = context.study
    sets = [
        RunSet(context.sampling_model(h), design_ratios(study), campaign_folder(context.out, h))
        for h in study.hypotheses
    ]
    with progress_bar("simulate", "run", shown=context.show_progress) as progress:
        campaigns = run_together(sets, context.map_fn, progress)
    for hypothesis, campaign in zip(study.hypotheses, campaigns, strict=True):
        if campaign.n_failed:
            context.echo(
                f"  {hypothesis.name}: {campaign.n_failed} of {len(campaign.ratios)} runs did not "
                "reach the last increment and are left out"
            )
    return [path for run_set in sets for path in manifest_files(run_set.store)]


def load_design(context: Context, hypothesis: Hypothesis) -> Campaign:
    """The runs of one hypothesis that `run_design` kept; runs nothing."""
    model = context.sampling_model(hypothesis)
    return run_campaign(
        model,
        design_ratios(context.study),
        campaign_folder(context.out, hypothesis),
        fingerprint=fingerprint(model),
        map_fn=nothing_to_run,
    )


def campaign_folder(out: Path, hypothesis: Hypothesis) -> Path:
    """Where the emulator's runs of a hypothesis are kept."""
    return out / "campaign" / hypothesis.name


def manifest_files(store: Path) -> list[Path]:
    """The runs that the manifest of a campaign lists."""
    runs = read_json(store / "manifest.json")["runs"]
    return [store / run["file"] for run in runs if run["file"]]


def nothing_to_run(_: Callable[[T], R], items: Sequence[T], /) -> Iterator[tuple[int, R]]:
    """A map for loading a campaign: refuses to run what is missing."""
    if items:
        raise ValueError("campaign: runs are missing; run the stage simulate first")
    return iter(())
