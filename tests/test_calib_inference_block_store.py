"""Blocks of chains on disk: what is read back, and where a damaged one ends them."""

from __future__ import annotations

import resource
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


@pytest.mark.parametrize("size", [100, 100_000])
def test_a_full_disk_is_an_error_that_names_the_block(tmp_path: Path, size: int) -> None:
    """HDF5 by itself raises another error, or crashes, as it closes what it could not write."""
    store = BlockStore(tmp_path, "key")
    store.keep(0, {"x": np.arange(10.0)})
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        with pytest.raises(OSError, match="File too large") as error:
            store.keep(1, {"x": np.arange(float(size))})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert error.value.filename == str(tmp_path / "block_00001.h5")
    assert len(store.load()) == 1
    assert not list(tmp_path.glob(".*.tmp"))
