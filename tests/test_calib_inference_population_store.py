"""A run of the hierarchical model that is killed ends with the same chains."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from killed_chains import blocks, kill_again_and_again

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


def run(store: Path | None, seed: int = 1, settings: SamplerSettings = SETTINGS) -> PopulationDraws:
    posterior = HierarchicalPosterior(population(), condensed(dataset(FORCE), 0.1))
    return sample_population(posterior, settings, np.random.default_rng(seed), store=store)


def assert_same(found: PopulationDraws, known: PopulationDraws) -> None:
    for name in ("x", "tau", "own", "z", "alone", "p_value", "acceptance"):
        assert np.array_equal(getattr(found, name), getattr(known, name)), name
    assert found.message == known.message


@pytest.mark.lasting
def test_a_run_killed_again_and_again_ends_with_the_same_chains(tmp_path: Path) -> None:
    assert kill_again_and_again(run, tmp_path) >= 4
    assert_same(run(tmp_path), run(None))


def test_blocks_of_another_run_are_thrown_away(tmp_path: Path) -> None:
    short = replace(SETTINGS, max_steps=8)
    run(tmp_path, seed=1, settings=short)
    assert_same(run(tmp_path, seed=2, settings=short), run(None, seed=2, settings=short))
    assert len(blocks(tmp_path)) == 3


@pytest.mark.parametrize("lost", [1, 2, 3])
def test_a_run_whose_last_blocks_are_damaged_ends_with_the_same_chains(
    tmp_path: Path, lost: int
) -> None:
    short = replace(SETTINGS, max_steps=14)
    known = run(tmp_path, settings=short)
    for name in blocks(tmp_path)[-lost:]:
        (tmp_path / name).write_bytes(b"no HDF5")
    assert_same(run(tmp_path, settings=short), known)
    assert len(blocks(tmp_path)) == 5
