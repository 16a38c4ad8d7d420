"""Chains that are sampled in a fork and killed as soon as another block of them is stored."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

PATIENCE = 120.0
"""seconds for what takes much less"""


def blocks(store: Path) -> list[str]:
    """Names of the blocks of steps in a store."""
    return sorted(path.name for path in store.glob("block_*.h5"))


def kill_again_and_again(run: Callable[[Path], object], store: Path) -> int:
    """Start `run` until it ends by itself; how often it was killed before."""
    kills = 0
    while _killed_after_a_block(run, store):
        kills += 1
    return kills


def _killed_after_a_block(run: Callable[[Path], object], store: Path) -> bool:
    known = len(blocks(store))
    child = os.fork()
    if child == 0:
        run(store)
        os._exit(0)
    end = time.monotonic() + PATIENCE
    while len(blocks(store)) <= known:
        if os.waitpid(child, os.WNOHANG) != (0, 0):
            return False
        assert time.monotonic() < end, f"not within {PATIENCE} s: block number {known + 1}"
        time.sleep(0.001)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return True
