"""An experiment whose posterior is made by FE itself, on a coarse mesh that sticks: truth and runs.

One experiment at a chosen (r, s), and those of the first points of a Sobol sequence over the prior.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from benchmarks import calibration_runs as runs
from benchmarks.calibration_experiments import Experiments, by_runs, likelihood_of, sbc_prior
from benchmarks.calibration_figures import points, trained
from benchmarks.direct_rule import N_KAPPA, N_NODES, Known, Rule, box_about, nodes_of
from calib.inference import DirectForward
from calib.study.training_runs import training_set
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import sobol_design

FIRST_TRUTH = (0.4, 0.25)
N_FURTHER = 3
"""experiments at other ratios"""
CONTACT = "stuck"
"""hypothesis of the study"""


@dataclass(frozen=True)
class DirectCase:
    """One experiment, its runs in folders of its own."""

    store: Path
    group: str
    """of the figures: those of another one choose their runs otherwise"""
    index: int
    truth: Array
    """(2,) (r, s)"""

    @property
    def first(self) -> Campaign:
        """Training runs over the whole box, the same for all."""
        return runs.coarse_design(self.store, CONTACT)

    @cached_property
    def drawn(self) -> Experiments:
        """What is measured; the truth is a run."""
        known = trained(self.store, training_set([self.first], gradients=True))
        truth = self.solved("truth", self.truth[None])
        seed = runs.SEED + 6 + self.index
        return by_runs(likelihood_of(known, points()), sbc_prior(), truth, 1, seed)

    def rule(self, mean: Array, sd: Array, n_nodes: int = N_NODES) -> Rule:
        """Over a posterior of this mean and SD (3,) of (ln kappa, r, s), with FE at its nodes."""
        nodes, weights = nodes_of(box_about(mean[1:], sd[1:], sbc_prior().bounds[1:]), n_nodes)
        ln_kappa = mean[0] + sd[0] * np.linspace(-8.0, 8.0, N_KAPPA)
        known = Known(self.solved(f"nodes{n_nodes}", nodes))
        return Rule(nodes, weights, ln_kappa, DirectForward(known, with_field=True))

    def solved(self, part: str, ratios: Array) -> Campaign:
        """Runs at ratios (n, 2)."""
        progress = runs.told(f"{self.group} {part}-{self.index}")
        return runs.solved(
            self.store, CONTACT, self.folder(part), ratios, runs.COARSE_CELLS, progress
        )

    def folder(self, part: str) -> str:
        """Of the runs of a part, in the store."""
        return f"{self.group}-{CONTACT}/{part}-{self.index}"


def cases(store: Path, group: str) -> list[DirectCase]:
    """All experiments: one at a chosen truth, and those of a Sobol sequence."""
    further = sobol_design(N_FURTHER, runs.prior().bounds[1:], runs.SEED, n_corners=0)
    truths = np.vstack([FIRST_TRUTH, further])
    return [DirectCase(store, group, index, truth) for index, truth in enumerate(truths)]
