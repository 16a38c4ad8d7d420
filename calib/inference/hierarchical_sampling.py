"""Draws of a population and its samples, by independent ensembles of walkers.

An ensemble sampler in all coordinates at once fails where every sample brings its own. Here
walkers move in blocks (`calib.inference.population_moves`), and a round is

1. population, common unknowns and SDs between samples, at fixed v_i: all samples go along;
2. common unknowns, with population and samples shifted by one distance; in 1 and 2 the common
   errors are integrated out, then drawn from their exact normal distribution;
3. every sample by itself given the rest, twice: at a fixed population samples are independent;
4. population and SDs at fixed constants of the samples, which takes no forward model.

1 moves well where the data of one sample say little beside the population's scatter, 4 where they
say much (interweaving, Yu & Meng, J. Comput. Graph. Stat. 20 (2011) 531); 2 along ridges of common
unknowns and constants. All moves are exact: nothing but the length of the chains is approximate.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.inference.chain_verdict import BURN_SHARE, ChainVerdict, judge, what_is_missing
from calib.inference.hierarchical import HierarchicalPosterior
from calib.inference.population_moves import Moves, Place, Walkers
from calib.inference.population_store import store_of
from calib.inference.sampling import Progress, SamplerSettings, SamplingStatus
from fe.response import Array

ROUNDS = 2
"""rounds of a kept step"""
ALONE = 40
"""moves after which samples have forgotten the population, and as many that are kept"""
N_COMMON = 4
"""places of the common unknowns and errors of each walker among which these are, as far apart as
chains remember, or `check_every` steps where that is longer or not known"""


@dataclass(frozen=True)
class PopulationDraws:
    """Kept part of the chains of a population, and how they were obtained."""

    x: Array
    """(n_ensemble, n_step, n_walker, d) population's and common coordinates"""
    tau: Array
    """(n_ensemble, n_step, n_walker, c) SDs between samples"""
    own: Array
    """(n_ensemble, n_step, n_walker, n, c) coordinates of the samples that differ"""
    z: Array
    """(n_ensemble, n_step, n_walker, q) common errors"""
    alone: Array
    """(m, n, d) each sample by its own data, common unknowns and errors as all data say: draws of
    these stand beside what is its own"""
    p_value: Array
    """(n,) mean p-value of each sample's residuals"""
    autocorrelation_time: Array
    """(n_ensemble, d + c + n c) steps, of x, tau and samples"""
    r_hat: float
    """largest over the same; infinite where the chains were too short to tell"""
    acceptance: Array
    """(4,) accepted share of the proposals of the moves 1 to 4"""
    status: SamplingStatus
    message: str
    """one sentence on how sampling ended"""


def sample_population(
    posterior: HierarchicalPosterior,
    settings: SamplerSettings,
    rng: np.random.Generator,
    progress: Progress | None = None,
    store: Path | None = None,
) -> PopulationDraws:
    """Run the ensembles until they are long enough and agree, by the rules of `sample_posterior`.

    A first `check_every` rounds only settle the walkers; strays are brought back after them. The
    result depends on `rng`'s seed and on nothing else. With a folder `store` every block of
    `check_every` steps is kept there: a run that was killed goes on where it was and ends with the
    same bits; blocks of another run are thrown away. Reaching `max_steps` is a status, no error.
    Raises ValueError when too few prior draws have a finite density.
    """
    moves = Moves(posterior, settings.n_ensembles, settings.n_walkers, rng)
    walkers = moves.start()
    kept = store_of(store, settings, moves, walkers)
    if (found := kept.load()) is not None:
        places, walkers = found
    else:
        places, walkers = list[Place](), _settled(moves, walkers, settings.check_every)
        kept.keep(0, places, walkers)
    while not (verdict := _judged(places, settings)).ended:
        done = len(places)
        for _ in range(min(settings.check_every, settings.max_steps - done)):
            for _ in range(ROUNDS):
                walkers = moves.round(walkers)
            places.append(moves.place(walkers))
            if progress is not None:
                progress(len(places), max(verdict.expected, len(places)))
        kept.keep(1 + done // settings.check_every, places, walkers)
    acceptance = moves.accepted[:, 0] / moves.accepted[:, 1]
    alone = _alone(moves, walkers, verdict, settings)
    burn = len(places) // BURN_SHARE
    x, tau, own, z, p_value = (
        _by_ensemble([place[index] for place in places[burn:]], settings) for index in range(5)
    )
    return PopulationDraws(
        x=x,
        tau=tau,
        own=own,
        z=z,
        alone=alone,
        p_value=p_value.mean(axis=(0, 1, 2)),
        autocorrelation_time=verdict.times,
        r_hat=verdict.r_hat,
        acceptance=acceptance,
        status=SamplingStatus.CONVERGED if verdict.converged else SamplingStatus.MAX_STEPS,
        message=_message(verdict, settings, len(places), burn),
    )


def _alone(
    moves: Moves, walkers: Walkers, verdict: ChainVerdict, settings: SamplerSettings
) -> Array:
    """(m', n, d) draws of every sample from its own data, of `N_COMMON` places of each walker."""
    longest = float(np.max(verdict.times))
    apart = settings.check_every
    if np.isfinite(longest):
        apart = min(max(1, int(np.ceil(longest))), apart)
    found = [moves.alone(walkers, ALONE, ALONE // N_COMMON)]
    for _ in range(N_COMMON - 1):
        for _ in range(ROUNDS * apart):
            walkers = moves.round(walkers)
        found.append(moves.alone(walkers, ALONE, ALONE // N_COMMON))
    return np.concatenate(found)


def _settled(moves: Moves, walkers: Walkers, n_rounds: int) -> Walkers:
    """After rounds that do not count, walkers that were lost in them brought back."""
    for _ in range(n_rounds):
        walkers = moves.round(walkers)
    moves.accepted[:] = 0
    return moves.brought_back(walkers)


def _judged(places: list[Place], settings: SamplerSettings) -> ChainVerdict:
    chains = None
    if places:
        parts = [
            np.concatenate([place.x, place.tau, place.own.reshape(len(place.x), -1)], axis=1)
            for place in places
        ]
        chains = _by_ensemble(parts, settings)
    return judge(
        chains,
        n_autocorrelation=settings.n_autocorrelation,
        max_r_hat=settings.max_r_hat,
        max_steps=settings.max_steps,
        check_every=settings.check_every,
    )


def _by_ensemble(steps: list[Array], settings: SamplerSettings) -> Array:
    """(n_ensemble, n_step, n_walker, ...) of one array (m, ...) a step."""
    stacked = np.array(steps)
    shape = (len(steps), settings.n_ensembles, settings.n_walkers, *stacked.shape[2:])
    return np.ascontiguousarray(stacked.reshape(shape).swapaxes(0, 1))


def _message(verdict: ChainVerdict, settings: SamplerSettings, done: int, burn: int) -> str:
    slowest = verdict.times.max()
    return (
        f"{done} steps of {settings.n_walkers} walkers in {settings.n_ensembles} ensembles, "
        f"kept {(done - burn) / slowest:.0f} autocorrelation times of {slowest:.1f} steps"
    ) + what_is_missing(verdict, settings.n_autocorrelation, settings.max_r_hat)
