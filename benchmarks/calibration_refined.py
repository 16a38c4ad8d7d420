"""An emulator refined at one posterior as a study does it: runs added until its mean stays.

The rounds of `calib.study.refine_stage`: a run at the posterior mean, two at a time where variance
times posterior is largest, until the predicted shift of the mean is below 0.05 SD, and one at the
mean in the end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import calibration_runs as runs
from benchmarks.calibration_experiments import Experiments, by_runs, likelihood_of, sbc_prior
from benchmarks.calibration_figures import Arm, arm_figures, emulator, points, trained
from calib.data import thesis_forces
from calib.inference import EmulatorForward, Likelihood, Posterior
from calib.study.judgement import Noise
from calib.study.local_design import within
from calib.study.next_runs import Choice
from calib.study.refine_rounds import Loop
from calib.study.refinement import outlook
from calib.study.training_runs import rows, training_set
from fe.campaign_result import Campaign
from fe.response import Array
from surrogate import Emulator, ScaledEmulator

FIELD_NOISE = 0.01
"""mm, the least of `calibration_experiments.FIELD_NOISE`"""
N_TRUTHS = 12
"""of a Sobol sequence, each with an emulator of its own"""

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
    choice = Choice(design.theta, box, _noise(), most, n_local, seed)
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


def refined_arm(store: Path, n: int) -> tuple[Arm, dict[str, Any]]:
    """Truths by FE on the sampling mesh, each with an emulator refined as a study's is.

    It is refined at the posterior of the first experiment of a truth, from the 20 runs of the
    study's first design; the others of that truth differ from it in kappa and in their noise.
    """
    design = rows(runs.design(store, "sliding"), slice(runs.study().design.n_runs))
    first = likelihood_of(emulator(store, "sliding", len(design.theta), True), points())
    truths = rows(runs.held_out_truths(store, "sliding"), slice(N_TRUTHS))
    drawn = by_runs(first, sbc_prior(), truths, n, runs.SEED + 11)
    chosen = [_ratios(store, design, drawn, truth) for truth in range(len(truths.theta))]

    @cache
    def likelihood(truth: int) -> Likelihood:
        campaign = _solved(store, truth, chosen[truth][0])
        own = trained(store, training_set([design, campaign], gradients=True))
        return likelihood_of(own, points())

    told = {
        "n_added": float(np.mean([len(ratios) for ratios, _ in chosen])),
        "predicted_shift_sd_largest": max(shift for _, shift in chosen),
    }
    return Arm("fe-refined", drawn, lambda i: likelihood(int(drawn.run[i])), 9), told


def _ratios(store: Path, design: Campaign, drawn: Experiments, truth: int) -> tuple[Array, float]:
    """Where runs are added for a truth, and the predicted shift that is left; kept."""
    path = store / "refined" / f"{truth}.npz"
    if not path.exists():
        index = int(np.flatnonzero(drawn.run == truth)[0])
        found = refined(
            design,
            lambda own: experiment(own, drawn, index)[1],
            lambda ratios: _solved(store, truth, ratios),
            runs.study().design.n_refine,
            runs.SEED + truth,
        )
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, ratios=found.loop.ratios, shift=found.shift)
    with np.load(path) as stored:
        return stored["ratios"], float(stored["shift"])


def _solved(store: Path, truth: int, ratios: Array) -> Campaign:
    return runs.sliding(store, f"refine/{truth}", ratios, None)


def figures(store: Path, n: int) -> dict[str, Any]:
    """Ranks and coverage with refined emulators."""
    arm, told = refined_arm(store, n)
    return {"sbc_refined": arm_figures(store, arm) | told}
