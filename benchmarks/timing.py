"""Wall-clock times of a warm call, and the peak memory of a process."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


def median_seconds(work: Callable[[], T], n_repeat: int, *, warm: bool = True) -> tuple[T, float]:
    """Result of the last call and the median seconds of `n_repeat` calls.

    A first call that is not counted pays for compilation and caches, unless `warm` is false.
    """
    if warm:
        work()
    times = []
    for _ in range(max(n_repeat, 1)):
        started = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - started)
    return result, statistics.median(times)


def peak_memory_gb() -> float:
    """Largest resident memory of this process so far, GB (Linux)."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return float(line.split()[1]) * 1024 / 1e9
    raise RuntimeError("/proc/self/status: no VmHWM, so the peak memory is unknown")


def peak_memory_of(code: str) -> float:
    """Peak memory, GB, of a fresh Python process that runs `code` from the project's folder."""
    tail = "\nfrom benchmarks.timing import peak_memory_gb\nprint(peak_memory_gb())\n"
    done = subprocess.run(
        [sys.executable, "-c", code + tail],
        cwd=Path(__file__).parents[1],
        capture_output=True,
        text=True,
        check=True,
    )
    return float(done.stdout.split()[-1])
