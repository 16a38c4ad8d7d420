"""The walkers of a population's chains on disk, so that a killed run ends with the same chains."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.inference.block_store import Arrays, BlockStore
from calib.inference.condensed import White
from calib.inference.population_moves import Moves, Place, Walkers

FORMAT = 1


@dataclass(frozen=True)
class PopulationStore:
    """Blocks of steps, the last of them with the walkers and random numbers to go on with.

    Without a folder nothing is kept.
    """

    folder: Path | None
    moves: Moves
    key: str

    def load(self) -> tuple[list[Place], Walkers] | None:
        """The steps so far and the walkers after them; None where there are none.

        Sets the random numbers and counts of the moves to what they were.
        """
        blocks = [] if self.folder is None else BlockStore(self.folder, self.key).load()
        if not blocks:
            return None
        last = blocks[-1]
        self.moves.rng.bit_generator.state = json.loads(bytes(last["random"]).decode())
        self.moves.accepted[:] = last["accepted"]
        white = White(last["residual"], last["factor"])
        places = [
            Place(*parts)
            for block in blocks
            for parts in zip(*(block[name] for name in Place._fields), strict=True)
        ]
        return places, Walkers(last["walkers_y"], last["walkers_v"], last["walkers_z"], white)

    def keep(
        self, index: int, places: Sequence[Place], walkers: Walkers, before: Sequence[Place]
    ) -> None:
        """Write block `index`: its steps and the walkers after them; `before` are those before it.

        Raises OSError for a folder that cannot be written.
        """
        if self.folder is None:
            return
        store = BlockStore(self.folder, self.key)
        random = json.dumps(self.moves.rng.bit_generator.state).encode()
        state: Arrays = {
            "walkers_y": walkers.y,
            "walkers_v": walkers.v,
            "walkers_z": walkers.z,
            "residual": walkers.white.residual,
            "factor": walkers.white.factor,
            "accepted": self.moves.accepted,
            "random": np.frombuffer(random, dtype=np.uint8),
        }
        store.keep(index, {**_stacked(places), **state})
        if index > 0:
            # The walkers take more room than their steps: only the last block goes on with them.
            store.keep(index - 1, _stacked(before))


def _stacked(places: Sequence[Place]) -> Arrays:
    names = Place._fields
    if not places:
        return {name: np.zeros(0) for name in names}
    return {name: np.array([getattr(place, name) for place in places]) for name in names}


def store_of(
    folder: Path | None, settings: object, moves: Moves, walkers: Walkers
) -> PopulationStore:
    """The store of a run, known by settings, starts, random numbers and density at the starts."""
    digest = hashlib.sha256(repr((FORMAT, settings)).encode())
    digest.update(json.dumps(moves.rng.bit_generator.state).encode())
    density = moves.posterior.sample_log_prob(walkers.white, walkers.z)
    for values in (walkers.y, walkers.v, walkers.z, density):
        digest.update(np.ascontiguousarray(values).tobytes())
    return PopulationStore(folder, moves, digest.hexdigest())
