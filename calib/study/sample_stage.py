"""Stage `sample`: chains of every hypothesis and what they predict."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from calib.inference.coordinates import Space, Unknown, theta_of
from calib.inference.laws import LawCoordinates
from calib.inference.prediction import predictive_forces
from calib.inference.sampling import (
    SamplerSettings,
    SamplingResult,
    SamplingStatus,
    sample_posterior,
)
from calib.study.artifacts import read_json, read_npz, write_json, write_npz
from calib.study.config import Study
from calib.study.context import Context, stream
from calib.study.posterior_setup import emulator_posterior
from calib.study.sections import Hypothesis
from calib.study.train_report import refuse_bad_emulators
from fe.progress_bar import progress_bar
from fe.response import Array

N_PREDICTIVE = 4000
"""posterior predictive draws kept for the figures"""
STEPS_DRAWN = 400
"""steps of each chain that figures show"""


@dataclass(frozen=True)
class StoredSamples:
    """Chains of one hypothesis and draws of the mean force."""

    result: SamplingResult
    predictive: Array
    """(n, n_step) replicates of the measured mean force, N"""
    space: Space = field(default_factory=Space)
    """what the coordinates are"""

    @property
    def chains(self) -> Array:
        """(n_ensemble, n_step, n_walker, d) every few steps of the kept chains, for figures"""
        every = max(1, self.result.chains.shape[1] // STEPS_DRAWN)
        return self.result.chains[:, ::every]

    @property
    def sd(self) -> Array:
        """(d,) posterior SD of x = (ln kappa, r, s, ...)"""
        sd: Array = self.result.draws.std(axis=0)
        return sd

    @property
    def constants_sd(self) -> Array:
        """(n_constant + 1,) posterior SD of the constants and mu, MPa"""
        sd: Array = self.space.constants(theta_of(self.result.draws)).std(axis=0)
        return sd


def run(context: Context) -> list[Path]:
    """Sample every hypothesis; returns the files samples_<hypothesis>.npz and .json.

    Raises EmulatorRefused when an emulator violates a limit of the study.
    """
    refuse_bad_emulators(context)
    paths = []
    for hypothesis in context.study.hypotheses:
        stored = _sample(context, hypothesis)
        context.echo(f"  {hypothesis.name}: {stored.result.message}")
        paths += save_samples(context.out, hypothesis, stored)
    # All that they hold is in the samples now; killed before, finished chains are not made again.
    for hypothesis in context.study.hypotheses:
        shutil.rmtree(chains_folder(context.out, hypothesis), ignore_errors=True)
    return paths


def settings_of(study: Study) -> SamplerSettings:
    """The study's sampler."""
    sampler = study.sampler
    return SamplerSettings(
        n_ensembles=sampler.n_ensembles,
        n_walkers=sampler.n_walkers,
        n_autocorrelation=sampler.n_autocorrelation,
        max_r_hat=sampler.max_r_hat,
        max_steps=sampler.max_steps,
    )


def save_samples(out: Path, hypothesis: Hypothesis, stored: StoredSamples) -> list[Path]:
    """Write chains and predictive draws; returns the paths."""
    result = stored.result
    arrays = {
        "chains": result.chains,
        "log_prob": result.log_prob,
        "autocorrelation_time": result.autocorrelation_time,
        "acceptance": result.acceptance,
        "predictive": stored.predictive,
    }
    facts = {
        "coordinates": stored.space.x_names,
        "space": stored.space,
        "n_burn": result.n_burn,
        "status": str(result.status),
        "message": result.message,
    }
    path = samples_path(out, hypothesis.name)
    paths = [path, path.with_suffix(".json")]
    write_npz(paths[0], arrays)
    write_json(paths[1], facts)
    return paths


def load_samples(out: Path, hypothesis: Hypothesis) -> StoredSamples:
    """Read what `save_samples` wrote.

    Raises ValueError naming the file where the hypothesis was not sampled or a file is damaged.
    """
    path = samples_path(out, hypothesis.name)
    if not path.is_file():
        raise ValueError(
            f"{path}: found no such file, the study is not sampled yet: run `calib run` on it"
        )
    facts = read_json(path.with_suffix(".json"), ("space", "n_burn", "status", "message"))
    arrays = read_npz(path, ("chains", "log_prob", "predictive"))
    predictive = arrays.pop("predictive")
    result = SamplingResult(
        **arrays,
        n_burn=facts["n_burn"],
        status=SamplingStatus(facts["status"]),
        message=facts["message"],
    )
    return StoredSamples(result, predictive, space_of(facts["space"]))


def space_of(facts: dict[str, Any]) -> Space:
    """The space that was stored with samples."""
    inputs, errors = (
        tuple(Unknown(**unknown) for unknown in facts[name]) for name in ("inputs", "errors")
    )
    return Space(LawCoordinates(**facts["law"]), inputs, errors)


def samples_path(out: Path, hypothesis: str) -> Path:
    """File of the chains of the hypothesis of this name."""
    return out / f"samples_{hypothesis}.npz"


def chains_folder(out: Path, hypothesis: Hypothesis) -> Path:
    """Where the chains of a hypothesis are kept while they grow."""
    return out / "chains" / hypothesis.name


def _sample(context: Context, hypothesis: Hypothesis) -> StoredSamples:
    study = context.study
    posterior = emulator_posterior(context, hypothesis)
    rng = stream(study, f"sample {hypothesis.name}")
    label = f"sample {hypothesis.name}"
    with progress_bar(label, "step", shown=context.show_progress) as progress:
        store = chains_folder(context.out, hypothesis)
        result = sample_posterior(posterior, settings_of(study), rng, progress, store)
    draws = result.draws
    chosen = rng.choice(len(draws), min(N_PREDICTIVE, len(draws)), replace=False)
    predictive = predictive_forces(posterior.likelihood, draws[chosen], rng)
    return StoredSamples(result, predictive, posterior.prior.space)
