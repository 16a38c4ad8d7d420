"""Blocks of chains on disk: what is read back, and where a damaged one ends them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.inference.block_store import BlockStore


def _kept(folder: Path, key: str = "a run", n: int = 3) -> BlockStore:
    store = BlockStore(folder, key)
    for index in range(n):
        store.keep(index, {"chains": np.full((2, 3), float(index))})
    return store


def test_blocks_come_back_in_their_order(tmp_path: Path) -> None:
    found = _kept(tmp_path).load()
    assert [block["chains"][0, 0] for block in found] == [0.0, 1.0, 2.0]


def test_blocks_of_another_run_are_thrown_away(tmp_path: Path) -> None:
    _kept(tmp_path)
    assert BlockStore(tmp_path, "another run").load() == []
    assert list(tmp_path.glob("*.h5")) == []


@pytest.mark.parametrize("damage", [b"", b"no HDF5"], ids=["emptied", "overwritten"])
def test_a_run_goes_on_from_the_block_before_a_damaged_one(tmp_path: Path, damage: bytes) -> None:
    store = _kept(tmp_path)
    (tmp_path / "block_00001.h5").write_bytes(damage)
    assert len(store.load()) == 1
    assert [path.name for path in tmp_path.glob("*.h5")] == ["block_00000.h5"]
