"""Posteriors by weighted draws against chains of emcee."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.calibration_experiments import sbc_prior
from benchmarks.calibration_figures import emulator_arm, placed
from calib.inference import Posterior, SamplerSettings, sample_posterior

N_BY_EMCEE = 4
"""experiments whose weighted draws are held to a chain"""


def against_emcee(store: Path, n: int) -> dict[str, Any]:
    """Some experiments by emcee: the mean in SDs and the SD as a ratio, the worst of each."""
    arm = emulator_arm(store, n)
    known, likelihood = placed(store, arm), arm.likelihood(0)
    assert likelihood.field is not None
    settings = SamplerSettings(n_ensembles=2, n_walkers=200, n_autocorrelation=20)
    shifts, ratios = [], []
    for index, field in enumerate(likelihood.field.of_fields(arm.experiments.field[:N_BY_EMCEE])):
        one = replace(likelihood, force=arm.experiments.force[index], field=field)
        posterior = Posterior(sbc_prior(), one)
        draws = sample_posterior(posterior, settings, np.random.default_rng(index)).draws
        shifts.append((known.mean[index] - draws.mean(axis=0)) / draws.std(axis=0))
        ratios.append(known.sd[index] / draws.std(axis=0))
    return {
        "emcee_n": N_BY_EMCEE,
        "emcee_mean_sd_worst": float(np.abs(shifts).max()),
        "emcee_sd_ratio_worst": float(np.exp(np.abs(np.log(ratios)).max())),
    }
