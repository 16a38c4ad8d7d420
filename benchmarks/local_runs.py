"""How many runs in the posterior's box are enough, and how well FE itself knows a mean.

    python -m benchmarks.verify_inference --only local

The experiments of `calibration_direct`: in the box that a study would take after one run at the
mean, one design of Sobol points whose first 16, 24 and 32 train emulators, without further rounds.
At the roughest truth a second rule of other nodes shows what a rule over FE runs is worth.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import calibration_runs as runs
from benchmarks.calibration_experiments import sbc_prior
from benchmarks.calibration_figures import trained
from benchmarks.calibration_refined import experiment
from benchmarks.direct_case import DirectCase, cases
from benchmarks.direct_rule import Moments, Rule
from calib.inference import PARAMETERS, EmulatorForward, Posterior
from calib.inference.quadrature import integrate
from calib.study.local_design import box_of, local_points, within
from calib.study.refinement import outlook
from calib.study.training_runs import rows, training_set
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import Emulator, TrainingSet

N_LOCAL = (16, 24, 32)
N_DESIGN = 40
"""points of the design, whose emulator says where the nodes are"""
ROUGHEST, OTHER_NODES = 3, 10


def figures(store: Path) -> dict[str, Any]:
    """Each experiment by itself; a store keeps them one by one."""
    each = [
        runs.kept(store / f"local-runs-{case.index}.json", partial(_figures, case))
        for case in cases(store, "local")
    ]
    rms = {
        str(n): float(np.sqrt(np.mean([np.square(one["runs"][str(n)]["mean_sd"]) for one in each])))
        for n in N_LOCAL
    }
    return {"local_runs": each, "local_runs_rms_sd": rms, "local_runs_of": list(PARAMETERS)}


def _figures(case: DirectCase) -> dict[str, Any]:
    """Emulators of more and more runs beside FE, in SDs of FE."""
    mean, box = _box(case)
    design = case.solved("local", local_points(box, N_DESIGN, runs.SEED + 10))

    def training(n: int, *, gradients: bool = True) -> TrainingSet:
        used = [case.first, mean, rows(design, slice(n))]
        return within(training_set(used, gradients=gradients), box)

    def posterior(used: TrainingSet) -> Posterior:
        found = experiment(trained(case.store, used), case.drawn, 0)[1]
        return replace(found, prior=found.prior.within(box))

    def beside(used: TrainingSet) -> dict[str, Any]:
        emulator = trained(case.store, used).emulator
        return _beside(emulator, used, posterior(used), rule, by_fe)

    best = posterior(training(N_DESIGN))
    place = integrate(best)
    rule = case.rule(place.mean, place.sd)
    by_fe = rule.moments(best.with_forward(rule.exact))
    told: dict[str, Any] = {
        "ratios": case.truth,
        "fe_error_sd": by_fe.error / by_fe.sd,
        "runs": {str(n): beside(training(n)) for n in N_LOCAL},
    }
    if case.index == ROUGHEST:
        other = case.rule(place.mean, place.sd, OTHER_NODES)
        again = other.moments(best.with_forward(other.exact))
        values = posterior(training(N_DESIGN, gradients=False))
        told |= {
            "other_nodes_mean_sd": (again.mean - by_fe.mean) / by_fe.sd,
            "other_nodes_sd_ratio": again.sd / by_fe.sd,
            "all_runs_mean_sd": _off(rule.moments(best), by_fe),
            "all_runs_mean_sd_other_nodes": _off(other.moments(best), again),
            "values_alone_mean_sd_other_nodes": _off(other.moments(values), again),
        }
    return told


def _box(case: DirectCase) -> tuple[Campaign, Array]:
    """The run at the first mean, and the box of the posterior after it."""
    known = trained(case.store, training_set([case.first], gradients=True))
    at_first = integrate(experiment(known, case.drawn, 0)[1]).mean[None, 1:]
    mean = case.solved("mean", at_first)
    again = trained(case.store, training_set([case.first, mean], gradients=True))
    found = integrate(experiment(again, case.drawn, 0)[1])
    return mean, box_of(found, sbc_prior().bounds[1:])


def _beside(
    emulator: Emulator, training: TrainingSet, posterior: Posterior, rule: Rule, by_fe: Moments
) -> dict[str, Any]:
    """An emulator's posterior beside that by FE, and the change of the mean foretold."""
    own, forward = rule.moments(posterior), posterior.likelihood.forward
    assert isinstance(forward, EmulatorForward)
    rng = np.random.default_rng([3, len(training.ratios)])
    found = outlook(emulator, training, posterior, forward, rng)
    return {
        "mean_sd": _off(own, by_fe),
        "sd_ratio": own.sd / by_fe.sd,
        "foretold_sd": found.shift.shift,
    }


def _off(own: Moments, by_fe: Moments) -> Array:
    off: Array = (own.mean - by_fe.mean) / by_fe.sd
    return off
