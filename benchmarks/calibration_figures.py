"""Figures of calibration: ranks, coverage, what the error terms are for, and wrong models."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import calibration_runs as runs
from benchmarks.calibration_experiments import (
    Experiments,
    Placed,
    by_emulator,
    by_runs,
    likelihood_of,
    place,
    sbc_prior,
)
from calib.inference import PARAMETERS, Likelihood, Prior
from calib.inference.rank_uniformity import LEVELS, clustered_error, coverage, uniformity
from calib.study.context import block_pin_model
from calib.study.sections import Cells
from calib.study.training_runs import rows, training_set
from fe.response import Array
from surrogate import Emulator, ScaledEmulator, TrainingSet

CHUNK = 50
"""experiments between two files of an arm: what an interruption loses"""
SPARSE = 8
"""training runs, of values alone, of the emulator whose error matters"""
FALSE_ALARM = 0.01


@dataclass(frozen=True)
class Arm:
    """One set of experiments and the likelihood under which their posteriors are made."""

    name: str
    experiments: Experiments
    likelihood: Callable[[int], Likelihood]
    """of an experiment by its number; those of one object are projected together"""
    seed: int
    prior: Callable[[int], Prior] = lambda _: sbc_prior()
    """of an experiment by its number; one for those of a likelihood"""


@cache
def emulator(store: Path, hypothesis: str, n_runs: int, gradients: bool) -> ScaledEmulator:
    """The study's emulator from the first runs of its design."""
    campaign = rows(runs.design(store, hypothesis), slice(n_runs))
    return trained(store, training_set([campaign], gradients=gradients))


@cache
def dense_emulator(store: Path) -> ScaledEmulator:
    """Of the 52 runs of both designs over the whole box: as good everywhere as a study's is
    where its posterior is, to which refinement adds runs."""
    campaigns = [runs.design(store, "sliding"), runs.further_training(store, "sliding")]
    return trained(store, training_set(campaigns, gradients=True))


@cache
def stuck_emulator(store: Path, cells: Cells | None = None) -> ScaledEmulator:
    """Of the 32 training runs of benchmarks/emulator.py, on the study's mesh or another."""
    campaign = runs.further_training(store, "stuck", cells=cells)
    return trained(store, training_set([campaign], gradients=True))


def trained(store: Path, training: TrainingSet) -> ScaledEmulator:
    """The emulator of a training set; kept in the store, under the set's fingerprint."""
    path = store / "emulators" / f"{training.fingerprint[:16]}.npz"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        Emulator.fit(training, 1).save(path)
    return ScaledEmulator(Emulator.load(path, training.fingerprint))


@cache
def points() -> Array:
    """(840, 2) field points of the study's block, mm."""
    used, found = runs.study(), runs.hypothesis("sliding")
    return block_pin_model(used, found, used.sampling_cells(found)).points()


def placed(store: Path, arm: Arm) -> Placed:
    """Posteriors of an arm; chunks that are stored are not made again.

    Stored chunks do not know of a change of code: give another store after one.
    """
    folder, n = store / "placed" / arm.name, len(arm.experiments.x)
    folder.mkdir(parents=True, exist_ok=True)
    chunks = []
    for first in range(0, n, CHUNK):
        path = folder / f"{n}_{arm.seed}_{first}.npz"
        if not path.exists():
            print(f"  {arm.name}: {first}/{n}", flush=True)
            found = _chunk(arm, np.arange(first, min(first + CHUNK, n)))
            part = path.with_suffix(".part.npz")
            np.savez(part, **asdict(found))
            part.replace(path)
        with np.load(path) as stored:
            chunks.append({name: stored[name] for name in stored.files})
    return Placed(**{name: np.concatenate([c[name] for c in chunks]) for name in chunks[0]})


def _chunk(arm: Arm, index: Array) -> Placed:
    """Grouped by likelihood object, so that each projects its fields at once."""
    likelihoods = [arm.likelihood(int(i)) for i in index]
    results: dict[str, Array] = {}
    for likelihood in {id(each): each for each in likelihoods}.values():
        members = np.flatnonzero([each is likelihood for each in likelihoods])
        chosen = index[members]
        some = Experiments(*(value[chosen] for value in vars(arm.experiments).values()))
        prior = arm.prior(int(chosen[0]))
        found = vars(place(likelihood, prior, some, arm.seed + 1000 * int(chosen[0])))
        for name, value in found.items():
            results.setdefault(name, np.empty((len(index), *value.shape[1:])))[members] = value
    return Placed(**results)


def described(found: Placed, cluster: Array) -> dict[str, Any]:
    """Tests of the ranks and coverage by parameter; experiments of a `cluster` share an FE run."""
    n_bin = min(20, len(found.below) // 5)
    tests = [uniformity(column, n_bin=n_bin, false_alarm=FALSE_ALARM) for column in found.below.T]
    covered = coverage(found.below)
    inside = np.abs(found.below - 0.5)[None] <= 0.5 * np.array(LEVELS)[:, None, None]
    shared = len(np.unique(cluster)) < len(cluster)
    errors = [
        {
            name: clustered_error(inside[k, :, i].astype(float), cluster)
            for i, name in enumerate(PARAMETERS)
        }
        for k in range(len(LEVELS))
    ]
    finite = found.ess[np.isfinite(found.ess)]
    return {
        "n": len(found.below),
        "n_fe_runs": len(np.unique(cluster)) if shared else None,
        "sbc_p": _named([test.chi_square_p for test in tests]),
        "ecdf_p": _named([test.ecdf_p for test in tests]),
        "ecdf_inside_band": _named([test.inside_band for test in tests]),
        "coverage": {
            f"{100 * level:g}": _named(row) for level, row in zip(LEVELS, covered, strict=True)
        },
        "coverage_standard_error": {
            f"{100 * level:g}": error for level, error in zip(LEVELS, errors, strict=True)
        },
        "mean_sd": _named(found.sd.mean(axis=0)),
        "effective_draws_least": float(finite.min()) if finite.size else None,
        "by_quadrature": int(np.count_nonzero(~np.isfinite(found.ess))),
    }


def _named(values: Any) -> dict[str, Any]:
    return dict(zip(PARAMETERS, np.asarray(values).tolist(), strict=True))


def emulator_arm(store: Path, n: int, seed: int = 0) -> Arm:
    """Truths from the predictive distribution of the study's emulator."""
    likelihood = likelihood_of(emulator(store, "sliding", 20, True), points())
    drawn = by_emulator(likelihood, sbc_prior(), n, runs.SEED + seed)
    name = f"emulator-{seed}" if seed else "emulator"
    return Arm(name, drawn, lambda _: likelihood, 1 + seed)


def fe_arm(store: Path, n: int) -> Arm:
    """Truths by FE on the sampling mesh, emulator of many runs; these are not among them."""
    likelihood = likelihood_of(dense_emulator(store), points())
    truths = rows(runs.truths(store), slice(-len(runs.held_out()), None))
    drawn = by_runs(likelihood, sbc_prior(), truths, n, runs.SEED + 1)
    return Arm("fe", drawn, lambda _: likelihood, 2)


def first_look_arm(store: Path, n: int) -> Arm:
    """Truths by FE, emulator of a study before its refinement, over the whole box."""
    likelihood = likelihood_of(emulator(store, "sliding", 20, True), points())
    drawn = by_runs(likelihood, sbc_prior(), runs.truths(store), n, runs.SEED + 1)
    return Arm("fe-first-look", drawn, lambda _: likelihood, 2)


def stuck_arm(store: Path, n: int) -> Arm:
    """Truths by FE on the sampling mesh of the stuck block, emulator of 32 other runs."""
    likelihood = likelihood_of(stuck_emulator(store), points())
    truths = runs.held_out_truths(store, "stuck", n=runs.N_STUCK)
    drawn = by_runs(likelihood, sbc_prior(), truths, n, runs.SEED + 10)
    return Arm(f"fe-stuck-{runs.N_STUCK}", drawn, lambda _: likelihood, 8)


def sbc(store: Path, n: int) -> dict[str, Any]:
    """Ranks and coverage of several kinds of truth."""
    found: dict[str, Any] = {}
    for name, arm in (
        ("fe_stuck", lambda: stuck_arm(store, n)),
        ("fe", lambda: fe_arm(store, n)),
        ("fe_first_look", lambda: first_look_arm(store, n)),
        ("emulator", lambda: emulator_arm(store, n)),
        ("emulator_again", lambda: emulator_arm(store, max(n // 3, 100), 100)),
    ):
        found[name] = arm_figures(store, arm())
    return {
        "sbc_p": found["emulator"]["sbc_p"],
        "coverage": found["emulator"]["coverage"],
        "sbc": found,
        "sbc_false_alarm": FALSE_ALARM,
    }


def arm_figures(store: Path, arm: Arm) -> dict[str, Any]:
    """Tests and coverage of an arm, posteriors of which are made or found in the store."""
    found = described(placed(store, arm), arm.experiments.run)
    print(f"{arm.name}: {found['sbc_p']} {found['coverage']}", flush=True)
    return found


def power(store: Path, n: int) -> dict[str, Any]:
    """The same tests with a term of the likelihood left out; a third as many are enough."""
    known, few = emulator(store, "sliding", 20, True), max(n // 3, 100)
    good = emulator_arm(store, few).experiments
    independent = likelihood_of(known, points(), independent=True)
    sparse = emulator(store, "sliding", SPARSE, False)
    stated = likelihood_of(sparse, points())
    certain = likelihood_of(sparse, points(), certain=True)
    own = by_emulator(stated, sbc_prior(), few, runs.SEED + 3)
    arms = [
        Arm("noise-independent", good, lambda _: independent, 5),
        Arm("sparse-emulator", own, lambda _: stated, 6),
        Arm("sparse-emulator-certain", own, lambda _: certain, 7),
    ]
    return {"power": {arm.name: arm_figures(store, arm) for arm in arms}}
