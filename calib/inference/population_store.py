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
from calib.inference.sampling import SamplerSettings

FORMAT = 1


@dataclass(frozen=True)
class PopulationStore:
    """Blocks of steps, the last two with the walkers and random numbers to go on with.

    The last but one is for a last that a power cut or a full disk has damaged. Without a folder
    nothing is kept.
    """

    folder: Path | None
    moves: Moves
    key: str
    n_steps: int
    """of a block; the first, number 0, has none"""

    def load(self) -> tuple[list[Place], Walkers] | None:
        """The steps so far and the walkers after them; None where there are none.

        Sets the random numbers and counts of the moves to what they were.
        """
        if self.folder is None:
            return None
        store = BlockStore(self.folder, self.key)
        blocks = store.load()
        while blocks and "random" not in blocks[-1]:
            blocks.pop()
        store.forget(len(blocks))
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

    def keep(self, index: int, places: Sequence[Place], walkers: Walkers) -> None:
        """Write block `index`, the last of all steps so far, and the walkers after them.

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
        store.keep(index, {**self._stacked(index, places), **state})
        if index > 1:
            # The walkers take more room than their steps: only the last blocks go on with them.
            store.keep(index - 2, self._stacked(index - 2, places))

    def _stacked(self, index: int, places: Sequence[Place]) -> Arrays:
        own = places[max(0, index - 1) * self.n_steps : index * self.n_steps]
        names = Place._fields
        if not own:
            return {name: np.zeros(0) for name in names}
        return {name: np.array([getattr(place, name) for place in own]) for name in names}


def store_of(
    folder: Path | None, settings: SamplerSettings, moves: Moves, walkers: Walkers
) -> PopulationStore:
    """The store of a run, known by settings, starts, random numbers and density at the starts."""
    digest = hashlib.sha256(repr((FORMAT, settings)).encode())
    digest.update(json.dumps(moves.rng.bit_generator.state).encode())
    density = moves.posterior.sample_log_prob(walkers.white, walkers.z)
    for values in (walkers.y, walkers.v, walkers.z, density):
        digest.update(np.ascontiguousarray(values).tobytes())
    return PopulationStore(folder, moves, digest.hexdigest(), settings.check_every)
