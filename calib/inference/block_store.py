"""Chains on disk, block by block, so that a killed run goes on and ends with the same chains.

emcee's own HDF5 backend writes into one open file, which a kill in the middle of a write can leave
unreadable. Here a block is one HDF5 file that appears whole or not at all.
"""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from fe.atomic_file import replacing

Arrays = Mapping[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class BlockStore:
    """Blocks of one run in a folder, each some named arrays; those of another are thrown away."""

    folder: Path
    key: str

    def load(self) -> list[Arrays]:
        """The blocks of this run in their order, up to the first that is missing or damaged."""
        found: list[Arrays] = []
        while (path := self._path(len(found))).exists():
            try:
                with h5py.File(path, "r") as file:
                    if file.attrs.get("key") != self.key:
                        break
                    found.append({name: np.array(values) for name, values in file.items()})
            except (OSError, RuntimeError, KeyError):  # of HDF5 at what is no whole file of its own
                if not os.access(path, os.R_OK):
                    raise
                break
        self.forget(len(found))
        return found

    def keep(self, index: int, block: Arrays) -> None:
        """Write block number `index`; raises OSError when the folder cannot be written."""
        self.folder.mkdir(parents=True, exist_ok=True)
        content = io.BytesIO()  # HDF5 itself may crash on a full disk
        with h5py.File(content, "w") as file:
            file.attrs["key"] = self.key
            for name, values in block.items():
                file.create_dataset(name, data=values)
        with replacing(self._path(index)) as path:
            path.write_bytes(content.getbuffer())

    def _path(self, index: int) -> Path:
        return self.folder / f"block_{index:05d}.h5"

    def forget(self, first: int) -> None:
        """Throw away blocks from number `first` on."""
        while (path := self._path(first)).exists():
            path.unlink()
            first += 1
