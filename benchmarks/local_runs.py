"""How many runs in the posterior's box are enough, and how well FE itself knows a mean.

    python -m benchmarks.verify_inference --only local

The experiments of `calibration_direct`: in the box that a study would take after one run at the
mean, one design of Sobol points whose first 16, 24 and 32 train emulators, without further rounds.
At the roughest truth a second rule of other nodes shows what a rule over FE runs is worth.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import calibration_runs as runs
from benchmarks.calibration_direct import CONTACT, drawn_at, truths
from benchmarks.calibration_experiments import Experiments, sbc_prior
from benchmarks.calibration_figures import trained
from benchmarks.calibration_refined import experiment
from benchmarks.direct_rule import N_KAPPA, N_NODES, Known, Moments, Rule, box_about, nodes_of
from calib.inference import PARAMETERS, DirectForward, EmulatorForward, Posterior
from calib.inference.quadrature import Quadrature, integrate
from calib.study.local_design import box_of, local_points, within
from calib.study.refinement import outlook
from calib.study.training_runs import rows, training_set
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import Emulator, TrainingSet

N_LOCAL = (16, 24, 32)
N_DESIGN = 40
"""points of the design, whose emulator says where the nodes are"""
ROUGHEST, OTHER_NODES = 1, 10


def figures(store: Path) -> dict[str, Any]:
    """Each experiment by itself; a store keeps them one by one."""
    cases = [_Case(store, index, truth) for index, truth in enumerate(truths())]
    each = [runs.kept(store / f"local-runs-{case.index}.json", case.figures) for case in cases]
    rms = {
        str(n): float(np.sqrt(np.mean([np.square(one["runs"][str(n)]["mean_sd"]) for one in each])))
        for n in N_LOCAL
    }
    return {"local_runs": each, "local_runs_rms_sd": rms, "local_runs_of": list(PARAMETERS)}


@dataclass(frozen=True)
class _Case:
    store: Path
    index: int
    truth: Array
    """(2,) (r, s)"""

    def figures(self) -> dict[str, Any]:
        """Emulators of more and more runs beside FE, in SDs of FE."""
        drawn, mean, box = self._box()
        design = self._solved("local", local_points(box, N_DESIGN, runs.SEED + 10))

        def training(n: int, *, gradients: bool = True) -> TrainingSet:
            first = runs.coarse_design(self.store, CONTACT)
            used = [first, mean, rows(design, slice(n))]
            return within(training_set(used, gradients=gradients), box)

        def posterior(used: TrainingSet) -> Posterior:
            found = experiment(trained(self.store, used), drawn, 0)[1]
            return replace(found, prior=found.prior.within(box))

        def beside(used: TrainingSet) -> dict[str, Any]:
            emulator = trained(self.store, used).emulator
            return _beside(emulator, used, posterior(used), rule, by_fe)

        best = posterior(training(N_DESIGN))
        place = integrate(best)
        rule = self._rule(place, N_NODES)
        by_fe = rule.moments(best.with_forward(rule.exact))
        told: dict[str, Any] = {
            "ratios": self.truth,
            "fe_error_sd": by_fe.error / by_fe.sd,
            "runs": {str(n): beside(training(n)) for n in N_LOCAL},
        }
        if self.index == ROUGHEST:
            other = self._rule(place, OTHER_NODES)
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

    def _box(self) -> tuple[Experiments, Campaign, Array]:
        """The experiment, the run at the first mean, and the box of the posterior after it."""
        first = runs.coarse_design(self.store, CONTACT)
        known = trained(self.store, training_set([first], gradients=True))
        drawn = drawn_at(self.store, self._solved("truth", self.truth[None]), self.index)
        mean = self._solved("mean", integrate(experiment(known, drawn, 0)[1]).mean[None, 1:])
        again = trained(self.store, training_set([first, mean], gradients=True))
        found = integrate(experiment(again, drawn, 0)[1])
        return drawn, mean, box_of(found, sbc_prior().bounds[1:])

    def _rule(self, place: Quadrature, n_nodes: int) -> Rule:
        box = box_about(place.mean[1:], place.sd[1:], sbc_prior().bounds[1:])
        nodes, weights = nodes_of(box, n_nodes)
        ln_kappa = place.mean[0] + place.sd[0] * np.linspace(-8.0, 8.0, N_KAPPA)
        known = Known(self._solved(f"nodes{n_nodes}", nodes))
        return Rule(nodes, weights, ln_kappa, DirectForward(known, with_field=True))

    def _solved(self, part: str, ratios: Array) -> Campaign:
        folder = f"local-{CONTACT}/{part}-{self.index}"
        progress = runs.told(f"{part}-{self.index}")
        return runs.solved(self.store, CONTACT, folder, ratios, runs.COARSE_CELLS, progress)


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
