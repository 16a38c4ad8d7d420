"""Chains on disk, block by block, so that a killed run goes on and ends with the same chains.

emcee's own HDF5 backend writes into one open file, which a kill in the middle of a write can leave
unreadable. Here a block is one HDF5 file that appears whole or not at all.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import emcee
import h5py
import numpy as np

from fe.atomic_file import replacing
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


@dataclass(frozen=True)
class ChainStore:
    """Blocks of one run in a folder; those of another run are thrown away."""

    folder: Path
    key: str

    def load(self) -> list[Block]:
        """The blocks of this run in their order, up to the first that is missing."""
        found: list[Block] = []
        while (path := self._path(len(found))).exists():
            with h5py.File(path, "r") as file:
                if file.attrs.get("key") != self.key:
                    break
                found.append(Block(*(np.array(file[name]) for name in Block._fields)))
        self._forget(len(found))
        return found

    def keep(self, index: int, block: Block) -> None:
        """Write block number `index`; raises OSError when the folder cannot be written."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with replacing(self._path(index)) as path, h5py.File(path, "w") as file:
            file.attrs["key"] = self.key
            for name, values in block._asdict().items():
                file.create_dataset(name, data=values)

    def _path(self, index: int) -> Path:
        return self.folder / f"block_{index:05d}.h5"

    def _forget(self, first: int) -> None:
        while (path := self._path(first)).exists():
            path.unlink()
            first += 1
