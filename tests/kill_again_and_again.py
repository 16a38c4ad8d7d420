"""A program that starts one campaign again and again and kills it, at random moments.

Its campaigns are forks of itself, so that none has to import anything first.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np
from toy_simulation import MANY, Toy, files, run

from fe.executors import process_map, serial_map

PATIENCE = 60.0
"""seconds for what takes much less"""


def _campaign(store: Path, n_workers: int) -> int:
    """Process id of a campaign that has just been started in a session of its own."""
    child = os.fork()
    if child == 0:
        os.setsid()
        map_fn = process_map(n_workers) if n_workers else serial_map
        run(store, Toy(seconds=0.02), MANY, map_fn=map_fn)
        os._exit(0)
    return child


def _wait_for_files(store: Path, n: int, child: int) -> None:
    end = time.monotonic() + PATIENCE
    while len(list(store.glob("run_*.npz"))) < n:
        assert os.waitpid(child, os.WNOHANG) == (0, 0), "the campaign ended before it was killed"
        assert time.monotonic() < end, f"not within {PATIENCE} s: file number {n}"
        time.sleep(0.002)


def _wait_for_workers(session: int) -> None:
    """Wait until the workers have followed the campaign."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        try:
            os.killpg(session, 0)
        except ProcessLookupError:
            return
        time.sleep(0.002)
    raise AssertionError(f"not within {PATIENCE} s: workers gone with their campaign")


def _kill_again_and_again(store: Path, n_workers: int, n_kills: int) -> None:
    rng = np.random.default_rng(n_workers)
    kept: dict[str, bytes] = {}
    for kill in range(n_kills):
        child = _campaign(store, n_workers)
        if kill > 0:  # the first one while it starts
            _wait_for_files(store, len(kept) + 1, child)
        time.sleep(rng.uniform(0.0, 0.06))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        assert os.waitstatus_to_exitcode(status) == -signal.SIGKILL, "it ended by itself"
        _wait_for_workers(child)
        now = files(store)
        assert kept.items() <= now.items(), "a finished run was lost or changed"
        kept = now
    print(len(kept))


if __name__ == "__main__":
    _kill_again_and_again(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
