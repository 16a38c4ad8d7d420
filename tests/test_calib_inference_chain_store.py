"""A run of emcee that is killed goes on where it was and ends with the same chains."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from test_calib_inference_sampling import POSTERIOR

from calib.inference import SamplerSettings, SamplingResult, sample_posterior

SETTINGS = SamplerSettings(
    n_ensembles=3, n_walkers=12, n_autocorrelation=1e6, max_steps=160, check_every=20
)
PATIENCE = 120.0
"""seconds for what takes much less"""


def run(store: Path | None, seed: int = 1, settings: SamplerSettings = SETTINGS) -> SamplingResult:
    return sample_posterior(POSTERIOR, settings, np.random.default_rng(seed), store=store)


def blocks(store: Path) -> list[str]:
    return sorted(path.name for path in store.glob("block_*.h5"))


def killed_after(store: Path, n_blocks: int) -> bool:
    """Run in a fork and kill it once so many blocks are there; whether it ended by itself."""
    child = os.fork()
    if child == 0:
        run(store)
        os._exit(0)
    end = time.monotonic() + PATIENCE
    while len(blocks(store)) < n_blocks:
        if os.waitpid(child, os.WNOHANG) != (0, 0):
            return True
        assert time.monotonic() < end
        time.sleep(0.001)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False


def test_a_run_killed_again_and_again_ends_with_the_same_chains(tmp_path: Path) -> None:
    kills = 0
    while not killed_after(tmp_path, len(blocks(tmp_path)) + 1):
        kills += 1
    assert kills >= 5
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
