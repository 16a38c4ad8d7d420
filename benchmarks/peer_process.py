"""Another DIC program in a process and an environment of its own."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np

from benchmarks.exact_speckle import Array

# Ray would put SUN-DIC's workers behind all other work of the machine (niceness 15)
EQUAL_RANK = {"RAY_worker_niceness": "0"}
SCRIPT = Path(__file__).with_name("dic_peers.py")
Found = tuple[Array, Array, float, float]
"""points (n, 2), displacements (n, 2) px, seconds, processor seconds"""


def run_peer(name: str, python: Path, folder: Path, limit: float) -> Found | str:
    """What a program finds for the job in `folder` (see `dic_peers`), or why it finds nothing.

    It is ended after `limit` seconds.
    """
    try:
        run = subprocess.run(
            [python, SCRIPT, name, folder],
            capture_output=True,
            text=True,
            timeout=limit,
            env=os.environ | EQUAL_RANK,
        )
    except subprocess.TimeoutExpired:
        return f"not done after {limit:g} s"
    lines = [line for line in run.stdout.splitlines() if line.startswith("SECONDS ")]
    if run.returncode != 0 or not lines:
        return (run.stderr.strip().splitlines() or ["no output"])[-1]
    with np.load(folder / "found.npz") as found:
        points = np.column_stack([found["x"], found["y"]])
        displacement = np.column_stack([found["u"], found["v"]])
    _, seconds, processor = lines[0].split()
    return points, displacement, float(seconds), float(processor)
