"""A run of the hierarchical model that is killed ends with the same chains."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.linear_population import condensed, dataset, forces, population
from calib.inference.hierarchical import HierarchicalPosterior
from calib.inference.hierarchical_sampling import PopulationDraws, sample_population
from calib.inference.sampling import SamplerSettings

FORCE = forces(
    np.column_stack([0.1 * np.arange(4), np.full(4, 0.4)]), np.random.default_rng(2), 0.1
)
SETTINGS = SamplerSettings(
    n_ensembles=2, n_walkers=8, n_autocorrelation=1e6, max_steps=22, check_every=4
)
PATIENCE = 120.0
"""seconds for what takes much less"""


def run(store: Path | None, seed: int = 1, settings: SamplerSettings = SETTINGS) -> PopulationDraws:
    posterior = HierarchicalPosterior(population(), condensed(dataset(FORCE), 0.1))
    return sample_population(posterior, settings, np.random.default_rng(seed), store=store)


def blocks(store: Path) -> int:
    return len(list(store.glob("block_*.h5")))


def killed_after(store: Path, n_blocks: int) -> bool:
    """Run in a fork and kill it once so many blocks are there; whether it ended by itself."""
    child = os.fork()
    if child == 0:
        run(store)
        os._exit(0)
    end = time.monotonic() + PATIENCE
    while blocks(store) < n_blocks:
        if os.waitpid(child, os.WNOHANG) != (0, 0):
            return True
        assert time.monotonic() < end
        time.sleep(0.001)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False


def assert_same(found: PopulationDraws, known: PopulationDraws) -> None:
    for name in ("x", "tau", "own", "z", "alone", "p_value", "acceptance"):
        assert np.array_equal(getattr(found, name), getattr(known, name)), name
    assert found.message == known.message


def test_a_run_killed_again_and_again_ends_with_the_same_chains(tmp_path: Path) -> None:
    kills = 0
    while not killed_after(tmp_path, blocks(tmp_path) + 1):
        kills += 1
    assert kills >= 4
    assert_same(run(tmp_path), run(None))


def test_blocks_of_another_run_are_thrown_away(tmp_path: Path) -> None:
    short = replace(SETTINGS, max_steps=8)
    run(tmp_path, seed=1, settings=short)
    assert_same(run(tmp_path, seed=2, settings=short), run(None, seed=2, settings=short))
    assert blocks(tmp_path) == 3
