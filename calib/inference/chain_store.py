"""Chains of emcee as blocks of steps, each with what it takes to go on from there."""

from __future__ import annotations

import hashlib
from typing import NamedTuple

import emcee
import numpy as np

from fe.response import Array

FORMAT = 1


class Block(NamedTuple):
    """Some steps of all ensembles, and the random numbers with which they go on."""

    chains: Array
    """(n_ensemble, n_step, n_walker, n) positions of the walkers"""
    log_prob: Array
    """(n_ensemble, n_step, n_walker)"""
    accepted: Array
    """(n_ensemble, n_walker) proposals accepted in these steps"""
    random_key: Array
    """(n_ensemble, 624) words of the Mersenne twister"""
    random_rest: Array
    """(n_ensemble, 3) its place, whether it keeps a normal number, and that number"""

    @property
    def states(self) -> list[emcee.State]:
        """Where the ensembles go on."""
        return [
            emcee.State(
                self.chains[index, -1],
                log_prob=self.log_prob[index, -1],
                random_state=(
                    "MT19937",
                    self.random_key[index],
                    int(self.random_rest[index, 0]),
                    int(self.random_rest[index, 1]),
                    float(self.random_rest[index, 2]),
                ),
            )
            for index in range(len(self.chains))
        ]


def block_of(samplers: list[emcee.EnsembleSampler], states: list[emcee.State]) -> Block:
    """What the samplers hold, and the states in which they stopped."""
    random = [state.random_state for state in states]
    return Block(
        chains=np.array([sampler.get_chain() for sampler in samplers]),
        log_prob=np.array([sampler.get_log_prob() for sampler in samplers]),
        accepted=np.array([sampler.backend.accepted for sampler in samplers]),
        random_key=np.array([found[1] for found in random], dtype=np.uint32),
        random_rest=np.array([found[2:] for found in random], dtype=np.float64),
    )


def run_key(settings: object, starts: list[emcee.State], log_prob: Array) -> str:
    """Letters for a run: its settings, starts, random numbers and density at the starts.

    Another posterior has another density there, and another seed other starts.
    """
    digest = hashlib.sha256(repr((FORMAT, settings)).encode())
    for state in starts:
        digest.update(np.ascontiguousarray(state.coords).tobytes())
        digest.update(np.ascontiguousarray(state.random_state[1]).tobytes())
    digest.update(np.ascontiguousarray(log_prob).tobytes())
    return digest.hexdigest()
