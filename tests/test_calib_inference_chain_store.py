"""A run of emcee that is killed goes on where it was and ends with the same chains."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from killed_chains import blocks, kill_again_and_again
from test_calib_inference_sampling import POSTERIOR

from calib.inference import SamplerSettings, SamplingResult, sample_posterior

SETTINGS = SamplerSettings(
    n_ensembles=3, n_walkers=12, n_autocorrelation=1e6, max_steps=160, check_every=20
)


def run(store: Path | None, seed: int = 1, settings: SamplerSettings = SETTINGS) -> SamplingResult:
    return sample_posterior(POSTERIOR, settings, np.random.default_rng(seed), store=store)


def test_a_run_killed_again_and_again_ends_with_the_same_chains(tmp_path: Path) -> None:
    assert kill_again_and_again(run, tmp_path) >= 5
    whole, resumed = run(None), run(tmp_path)
    assert np.array_equal(whole.chains, resumed.chains)
    assert np.array_equal(whole.log_prob, resumed.log_prob)
    assert np.array_equal(whole.acceptance, resumed.acceptance)
    assert whole.message == resumed.message


def test_blocks_of_another_run_are_thrown_away(tmp_path: Path) -> None:
    short = replace(SETTINGS, max_steps=40)
    run(tmp_path, seed=1, settings=short)
    other = run(tmp_path, seed=2, settings=short)
    assert np.array_equal(other.chains, run(None, seed=2, settings=short).chains)
    assert len(blocks(tmp_path)) == 2
