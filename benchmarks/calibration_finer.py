"""Calibration with truths on a finer mesh than the emulator's, whose error is stated."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import calibration_runs as runs
from benchmarks.calibration_experiments import (
    Placed,
    by_runs,
    likelihood_of,
    sbc_prior,
)
from benchmarks.calibration_figures import (
    Arm,
    arm_figures,
    dense_emulator,
    placed,
    points,
    stuck_emulator,
)
from benchmarks.mesh_cases import CHECK_STIFFENING, MESH_CASES, PIN_SHARE, MeshCase
from calib.inference import Likelihood
from calib.study.mesh_error import ALL, N_CHECKED, Shares, mesh_error
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import ScaledEmulator

N_PLACES = 3
"""at which the mesh is checked, one after the other"""


def finer_arms(store: Path, n: int, name: str) -> dict[str, Arm]:
    """Truths by FE on a finer mesh: its error stated as in studies, to the truth, and left out.

    A study measures its mesh's error at the mean of a first posterior and again while that moves
    the mean far, and the last two places tell the error. Here always at three, each the mean of a
    truth's experiments: of those without any mesh error, and of those corrected by one and by two.

    What studies state is the distance from the check mesh to the block, of which a finer mesh's
    truth shows a part (`MeshCase.truth_share`). `to_truth` states that part, at the same places.
    """
    case = MESH_CASES[name].of(n)
    known, truths, seeds = finer_case(store, case)
    arm_name = f"{case}-{len(truths.theta)}"
    bare = likelihood_of(known, points())
    drawn = by_runs(bare, sbc_prior(), truths, n, runs.SEED + seeds[0])
    without = Arm(f"{arm_name}-without-mesh-error", drawn, lambda _: bare, seeds[1])
    arm, centres = without, []
    for k in range(N_PLACES):
        centres.append(_centres(placed(store, arm), drawn.run))
        places = np.stack(centres[-N_CHECKED:], axis=1)
        stated = with_mesh_error(store, case, known, places)
        of_run = partial(_of_run, stated, drawn.run)
        arm = Arm(f"{arm_name}-checked-{k + 1}", drawn, of_run, seeds[2] + 100 * k)
    shown = with_mesh_error(store, case, known, places, share=case.truth_share, pin_share=PIN_SHARE)
    of_run = partial(_of_run, shown, drawn.run)
    to_truth = replace(arm, name=f"{arm_name}-to-truth", likelihood=of_run)
    return {"stated": arm, "to_truth": to_truth, "left_out": without}


def _of_run(likelihoods: list[Likelihood], run: Array, index: int) -> Likelihood:
    return likelihoods[int(run[index])]


def _centres(found: Placed, run: Array) -> Array:
    """(n_run, 2) means of (r, s) over the experiments of each FE run, to two decimals.

    Rounded, so that the last bits of a fit do not ask for other runs.
    """
    means = [found.mean[run == truth, 1:].mean(axis=0) for truth in np.unique(run)]
    return np.round(np.array(means), 2)


def with_mesh_error(
    store: Path,
    case: MeshCase,
    known: ScaledEmulator,
    places: Array,
    *,
    share: Shares = ALL,
    pin_share: float = 1.0,
) -> list[Likelihood]:
    """Likelihoods with the error of the mesh measured at places (n, n_check, 2), one for each n.

    As far as a truth shows them: `share` of what the correction leaves of the mesh is stated, and
    it goes on by `pin_share` of its step to a rigid pin and states that part of it.
    """
    # One campaign for each check, so that places checked before are found again.
    checked = [runs.checks(store, case, ratios) for ratios in np.moveaxis(places, 1, 0)]
    extent = np.ptp(sbc_prior().bounds[1:], axis=1)

    def likelihood(truth: int) -> Likelihood:
        fine, coarse, stiffer = (_of_truth(each, truth) for each in zip(*checked, strict=True))
        # As of a pin from which that part of the way to a rigid one is the whole.
        pin = stiffer, 1.0 + (CHECK_STIFFENING - 1.0) / pin_share
        error = mesh_error(
            fine, coarse, case.refinement, case.hypothesis, extent, pin, case.field_order
        )
        return likelihood_of(known, points(), mesh=replace(error, shown=share))

    return [likelihood(truth) for truth in range(len(places))]


def _of_truth(campaigns: tuple[Campaign, ...], truth: int) -> Campaign:
    """The runs of one truth, one of each campaign."""
    theta = np.stack([campaign.theta[truth] for campaign in campaigns])
    return Campaign(theta, tuple(each.responses[truth] for each in campaigns), n_reused=len(theta))


def finer_case(
    store: Path, case: MeshCase
) -> tuple[ScaledEmulator, Campaign, tuple[int, int, int]]:
    """Emulator on a mesh, truths on a finer one, and seeds."""
    truths = runs.finer_truths(store, case)
    sliding = case.hypothesis == "sliding"
    known = dense_emulator(store) if sliding else stuck_emulator(store, case.other_cells)
    first, second, third = (case.seed + each for each in ((2, 3, 4) if sliding else (12, 10, 11)))
    return known, truths, (first, second, third)


def finer(store: Path, name: str, n: int) -> dict[str, Any]:
    """Ranks and coverage of truths on a finer mesh, under what is stated of its error."""
    arms = finer_arms(store, n, name)
    return {
        f"sbc_{name.replace('-', '_')}": {
            stated: arm_figures(store, arm) for stated, arm in arms.items()
        }
    }
