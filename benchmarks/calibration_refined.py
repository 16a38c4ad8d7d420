"""An emulator refined at one posterior as a study does it: runs added until its mean stays.

The rounds of `calib.study.refine_stage`: a run at the posterior mean, a second design in the
posterior's box where this is small, two at a time where variance times posterior is largest, until
the predicted shift of the mean is below 0.05 SD, and one at the mean in the end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks import calibration_runs as runs
from benchmarks.calibration_experiments import Experiments, by_runs, likelihood_of, sbc_prior
from benchmarks.calibration_figures import Arm, arm_figures, emulator, points, trained
from calib.data import thesis_forces
from calib.inference import EmulatorForward, Likelihood, Posterior, Prior
from calib.inference.quadrature import Quadrature, integrate
from calib.study.judgement import Noise
from calib.study.local_design import box_of, local_points, within
from calib.study.next_runs import Choice
from calib.study.refine_rounds import Loop
from calib.study.refinement import outlook
from calib.study.training_runs import rows, training_set
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import Emulator, ScaledEmulator, TrainingSet

FIELD_NOISE = 0.01
"""mm, the least of `calibration_experiments.FIELD_NOISE`"""

Solve = Callable[[Array], Campaign]
"""runs at ratios (n, 2), those there are reused"""
PosteriorBy = Callable[[ScaledEmulator], Posterior]


@dataclass(frozen=True)
class Refined:
    """An emulator and the posterior by it."""

    emulator: Emulator
    posterior: Posterior
    loop: Loop
    shift: float
    """largest predicted shift of the posterior mean that was left, posterior SDs"""
    foretold: float
    """the part of it that the emulator's processes foretell"""
    sd_ratio: float
    """largest SD over what it were without the errors that the emulator states"""


def refined(
    design: Campaign,
    posterior_by: PosteriorBy,
    solve: Solve,
    most: int,
    seed: int,
    n_local: int = 0,
) -> Refined:
    """Add at most `most` runs to a design where the posterior is, and `n_local` in its box.

    Nothing is kept but the runs: the same rounds follow from them again.
    """
    box = sbc_prior().bounds[1:]
    choice = Choice(design.theta, box, _noise(), most, n_local, seed, most_checks=1)
    loop = Loop(np.zeros((0, design.theta.shape[1])))
    while True:
        added = [solve(loop.ratios)] if len(loop.ratios) else []
        runs = within(training_set([design, *added], gradients=True), loop.box)
        emulator = Emulator.fit(runs, 1)
        posterior = posterior_by(ScaledEmulator(emulator))
        if loop.box is not None:
            posterior = replace(posterior, prior=posterior.prior.within(loop.box))
        forward = posterior.likelihood.forward
        assert isinstance(forward, EmulatorForward)
        rng = np.random.default_rng([seed, len(loop.ratios)])
        found = outlook(emulator, runs, posterior, forward, rng)
        shift, foretold = float(found.shift.shift.max()), float(found.foretold.shift.max())
        print(
            f"    {len(loop.ratios)} runs added, {len(runs.ratios)} train, mean may move by "
            f"{shift:.3f} SD (processes {foretold:.3f})",
            flush=True,
        )
        if loop.done:
            ratio = float(found.seen.sd_ratio.max())
            return Refined(emulator, posterior, loop, shift, foretold, ratio)
        loop = choice.next_runs(loop, found, rng)


def _noise() -> Noise:
    forces = thesis_forces()
    return Noise(forces.force_sd / forces.force_mean / np.sqrt(forces.n_samples), FIELD_NOISE)


def experiment(
    emulator: ScaledEmulator, drawn: Experiments, index: int
) -> tuple[Likelihood, Posterior]:
    """The likelihood by an emulator, and the posterior of one experiment."""
    likelihood = likelihood_of(emulator, points())
    assert likelihood.field is not None
    field = likelihood.field.of_fields(drawn.field[index : index + 1])[0]
    one = replace(likelihood, force=drawn.force[index], field=field)
    return likelihood, Posterior(sbc_prior(), one)


class Local(NamedTuple):
    """What serves all experiments of one truth."""

    emulator: ScaledEmulator
    prior: Prior
    """within the box in which the emulator is known"""
    n_train: int
    shift: float
    """largest predicted shift of the first experiment's posterior mean, posterior SDs"""


def refined_arm(store: Path, n: int) -> tuple[Arm, dict[str, Any]]:
    """Truths by FE on the sampling mesh, each with an emulator of a second design as a study's is.

    The experiments of a truth differ in kappa and in their noise; the box of its second design
    holds the posteriors of all of them, so that it is wider than a study's. No runs are added one
    by one after it.
    """
    first = rows(runs.design(store, "sliding"), slice(runs.study().design.n_runs))
    likelihood = likelihood_of(emulator(store, "sliding", len(first.theta), True), points())
    truths = runs.held_out_truths(store, "sliding")
    drawn = by_runs(likelihood, sbc_prior(), truths, n, runs.SEED + 11)
    found = [_local(store, first, drawn, truth) for truth in range(len(truths.theta))]
    likelihoods = [likelihood_of(local.emulator, points()) for local in found]
    arm = Arm(
        "fe-refined",
        drawn,
        lambda i: likelihoods[int(drawn.run[i])],
        9,
        lambda i: found[int(drawn.run[i])].prior,
    )
    told = {
        "n_training": [local.n_train for local in found],
        "predicted_shift_sd": [local.shift for local in found],
    }
    return arm, told


def _local(store: Path, first: Campaign, drawn: Experiments, truth: int) -> Local:
    """A run at the mean of the first experiment, then a second design in the box of all."""
    whole, members = sbc_prior(), np.flatnonzero(drawn.run == truth)

    def known(*campaigns: Campaign) -> TrainingSet:
        return training_set([first, *campaigns], gradients=True)

    def found(used: TrainingSet, index: int) -> Quadrature:
        return integrate(experiment(trained(store, used), drawn, index)[1])

    mean = _solved(store, truth, found(known(), members[0]).mean[None, 1:])
    boxes = [box_of(found(known(mean), i), whole.bounds[1:]) for i in members]
    box = np.column_stack([np.min(boxes, axis=0)[:, 0], np.max(boxes, axis=0)[:, 1]])
    points_there = local_points(box, runs.study().design.n_local, runs.SEED + truth)
    used = within(known(mean, _solved(store, truth, points_there)), box)
    own, prior = trained(store, used), whole.within(box)
    posterior = replace(experiment(own, drawn, members[0])[1], prior=prior)
    forward = posterior.likelihood.forward
    assert isinstance(forward, EmulatorForward)
    rng = np.random.default_rng([runs.SEED, truth])
    shift = outlook(own.emulator, used, posterior, forward, rng).shift.shift
    print(f"  truth {truth}: {len(used.ratios)} train, shift {shift.max():.3f} SD", flush=True)
    return Local(own, prior, len(used.ratios), float(shift.max()))


def _solved(store: Path, truth: int, ratios: Array) -> Campaign:
    progress = runs.told(f"refined {truth}")
    return runs.sliding(store, f"refined/{truth}", ratios, None, progress)


def figures(store: Path, n: int) -> dict[str, Any]:
    """Ranks and coverage with refined emulators."""
    arm, told = refined_arm(store, n)
    return {"sbc_refined": arm_figures(store, arm) | told}
