"""Speed and error of image correlation beside SUN-DIC, muDIC and pyvale, on the same images.

    python benchmarks/dic.py [--json FILE] [--peers DIR] [--install] [--step 5] [--limit 1800]

The pair is synthetic with exact truth: 1280 x 960 px, 8 bit, noise 1 % of full scale, shifted by a
few px and stretched by 1 %; subset 31, step 5, as many threads as cores. Each program runs twice;
the second run counts. On a machine that others use, processor seconds say more than seconds
(they do not hold those of SUN-DIC's Ray workers). --peers names a folder with one virtual
environment a program, which --install makes from PyPI; a program without one is left out and named,
one that is not done after --limit seconds is ended and named.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from skimage import io

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.dic_peers import PEERS
from benchmarks.exact_speckle import Array, exposed, speckle
from benchmarks.peer_process import run_peer
from calib.dic import CorrelationSettings, correlate, read_image

WIDTH, HEIGHT, SUBSET = 1280, 960, 31
BOX = (40, 40, 1240, 920)
STRETCH, SHIFT = np.array([1.01, 0.99]), np.array([2.37, -3.61])
CENTRE = np.array([WIDTH / 2, HEIGHT / 2])
LONGEST = 1800.0
"""s that a program may take for its two runs"""


def truth(points: Array) -> Array:
    """(n, 2) displacements of points, px."""
    return (points - CENTRE) * (STRETCH - 1) + SHIFT


def write_pair(folder: Path, step: int) -> None:
    """The two images and what is to be done with them."""
    rng = np.random.default_rng(0)
    pattern = speckle(WIDTH, HEIGHT, rng, 1.8)
    X, Y = np.arange(float(WIDTH)), np.arange(float(HEIGHT))
    first = pattern(X, Y)
    spread = float(first.std())
    back = [(axis - SHIFT[k] - CENTRE[k]) / STRETCH[k] + CENTRE[k] for k, axis in enumerate((X, Y))]
    (folder / "pair").mkdir()
    for name, brightness in (("a", first), ("b", pattern(*back))):
        grey = exposed(brightness, rng, spread=spread).astype(np.uint8)
        io.imsave(folder / "pair" / f"{name}.tif", grey, check_contrast=False)
    job = {
        "order": 1,
        "subset": SUBSET,
        "step": step,
        "runs": 2,
        "box": BOX,
        "threads": len(os.sched_getaffinity(0)),
        "shape": [HEIGHT, WIDTH],
        "stretch": STRETCH.tolist(),
        "centre": CENTRE.tolist(),
        "move": SHIFT.tolist(),
    }
    (folder / "job.json").write_text(json.dumps(job))


def judged(points: Array, displacement: Array, seconds: float, processor: float) -> dict[str, Any]:
    """Figures of one program."""
    found = np.isfinite(displacement).all(axis=1)
    error = displacement[found] - truth(points[found])
    return {
        "points": len(points),
        "points_found": int(found.sum()),
        "seconds": round(seconds, 3),
        "points_per_second": round(int(found.sum()) / seconds, 1),
        "processor_seconds": round(processor, 3),
        "points_per_processor_second": round(int(found.sum()) / processor, 1),
        "rmse_px": round(float(np.sqrt(np.mean(error**2))), 5),
    }


def ours(folder: Path, degree: int, step: int) -> dict[str, Any]:
    """softcal, from the files to displacements with deviations."""
    x, y = np.meshgrid(np.arange(BOX[0], BOX[2], step), np.arange(BOX[1], BOX[3], step))
    points = np.column_stack([x.ravel(), y.ravel()]).astype(float)
    settings = CorrelationSettings(subset=SUBSET, degree=5 if degree == 5 else 3)
    for _ in range(2):
        start, before = time.perf_counter(), time.process_time()
        a, b = (read_image(folder / "pair" / f"{name}.tif").grey for name in "ab")
        found = correlate(a, b, points, settings)
        seconds, processor = time.perf_counter() - start, time.process_time() - before
    return judged(points, found.displacement, seconds, processor)


def peer(name: str, python: Path, folder: Path, limit: float) -> dict[str, Any]:
    """Another program in its own environment, for no longer than `limit` s."""
    found = run_peer(name, python, folder, limit)
    return {"failed": found} if isinstance(found, str) else judged(*found)


def install(name: str, place: Path) -> None:
    """A virtual environment with one program from PyPI."""
    subprocess.run([sys.executable, "-m", "venv", place], check=True)
    subprocess.run([place / "bin" / "pip", "install", "--quiet", name], check=True)


def main() -> None:
    """Run all programs that are there."""
    parser = argparse.ArgumentParser(prog="benchmarks/dic.py", description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there too")
    parser.add_argument("--peers", type=Path, default=Path("runs/dic-peers"), metavar="DIR")
    parser.add_argument("--step", type=int, default=5, help="px between points")
    parser.add_argument("--limit", type=float, default=LONGEST, help="seconds a program may take")
    parser.add_argument("--install", action="store_true", help="make missing environments")
    options = parser.parse_args()
    figures: dict[str, Any] = {"subset": SUBSET, "step": options.step}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write_pair(folder, options.step)
        figures["softcal"] = ours(folder, 5, options.step)
        print("softcal", figures["softcal"], flush=True)
        figures["softcal cubic"] = ours(folder, 3, options.step)
        print("softcal cubic", figures["softcal cubic"], flush=True)
        for name in PEERS:
            home = (options.peers / name).resolve()
            if options.install and not home.exists():
                install(name, home)
            python = home / "bin" / "python"
            figures[name] = (
                peer(name, python, folder, options.limit)
                if python.exists()
                else {"failed": "not installed"}
            )
            print(name, figures[name], flush=True)
    figures["load_average"] = [round(value, 2) for value in os.getloadavg()]
    figures["cores"] = len(os.sched_getaffinity(0))
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
