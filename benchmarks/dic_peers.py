"""One other DIC program on one pair of images; run by `benchmarks/peer_process.py` in its venv.

    PYTHON benchmarks/dic_peers.py NAME FOLDER

FOLDER holds pair/a.tif, pair/b.tif and job.json (order, subset, step, box, threads, affine start,
runs). Writes FOLDER/found.npz with x, y, u, v of the points (px) and prints the seconds of the last
run, so that with two of them compilation and imports do not count. Settings are the program's own
but for order, subset, step, region and threads.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Found = tuple[Any, Any, Any, Any]


def sundic(folder: Path, job: dict[str, Any]) -> Found:
    """SUN-DIC: local, IC-GN, numba; more than one process by Ray."""
    import sundic.post_process as post
    import sundic.settings as options
    import sundic.sundic as engine

    left, top, right, bottom = job["box"]
    settings = options.Settings()
    settings.ImageFolder = str(folder / "pair")
    settings.SubsetSize, settings.StepSize = job["subset"], job["step"]
    settings.ROI = [left, top, right - left, bottom - top]
    settings.ShapeFunctions = {1: "Affine", 2: "Quadratic"}[job["order"]]
    settings.CPUCount = job["threads"]
    settings.ReferenceStrategy = "Absolute"
    results = str(folder / "results.sdic")
    engine.planarDICLocal(settings, results)
    table, _, _ = post.getDisplacements(results, -1)
    return table[:, 0], table[:, 1], table[:, 3], table[:, 4]


def mudic(folder: Path, job: dict[str, Any]) -> Found:
    """muDIC: global; Q4 elements of the subset's side, the field taken at the centres."""
    import muDIC

    if job["order"] != 1:
        raise ValueError("order: expected 1, its elements are bilinear here")
    left, top, right, bottom = job["box"]
    images = muDIC.IO.image_stack_from_folder(str(folder / "pair"), file_type=".tif")
    mesh = muDIC.Mesher(type="q4").mesh(
        images,
        Xc1=left,
        Xc2=right,
        Yc1=top,
        Yc2=bottom,
        n_elx=(right - left) // job["subset"],
        n_ely=(bottom - top) // job["subset"],
        GUI=False,
    )
    inputs = muDIC.DICInput(mesh, images)
    inputs.interpolation_order = 5
    inputs.tol = 1e-4
    # its images stand on their heads; from where the nodes are it does not find displacements of
    # some px, which the others find themselves: it starts from the truth in whole px
    height = job["shape"][0] - 1
    nodes = np.stack([np.asarray(mesh.xnodes), height - np.asarray(mesh.ynodes)])
    stretch, centre, shift = (
        np.array(job[name])[:, None] for name in ("stretch", "centre", "move")
    )
    start = np.round((nodes - centre) * (stretch - 1.0) + shift) * [[1.0], [-1.0]]
    inputs.node_hist = [
        np.stack([at, at + by], axis=1)
        for at, by in zip((mesh.xnodes, mesh.ynodes), start, strict=True)
    ]
    result = muDIC.DICAnalysis(inputs).run()
    x, y = np.asarray(result.xnodesT), np.asarray(result.ynodesT)
    return x[:, 0], height - y[:, 0], x[:, -1] - x[:, 0], y[:, 0] - y[:, -1]


def pyvale(folder: Path, job: dict[str, Any]) -> Found:
    """pyvale: local, C++ with OpenMP."""
    import pyvale.dic as engine

    left, top, right, bottom = job["box"]
    mask = np.zeros(job["shape"], dtype=bool)
    # its subsets lie whole in the region, ours around points in the box
    half = job["subset"] // 2
    mask[top - half : bottom + half + 1, left - half : right + half + 1] = True
    seed = [(left + right) // 2, (top + bottom) // 2]
    engine.calculate_2d(
        reference=folder / "pair" / "a.tif",
        deformed=folder / "pair" / "b.tif",
        roi_mask=mask,
        seed=seed,
        subset_size=job["subset"],
        subset_step=job["step"],
        shape_function={1: "AFFINE", 2: "QUAD"}[job["order"]],
        num_threads=job["threads"],
        output_basepath=folder,
        output_prefix="pyvale_",
        print_level=0,
    )
    # its header has one name more than its lines have values
    path = next(folder.glob("pyvale_*.csv"))
    x, y, u, v = np.genfromtxt(path, delimiter=",", skip_header=1, usecols=(0, 1, 2, 3)).T
    return x, y, u, v


PEERS: dict[str, Callable[[Path, dict[str, Any]], Found]] = {
    "SUN-DIC": sundic,
    "muDIC": mudic,
    "pyvale": pyvale,
}


def main() -> None:
    """Run NAME in FOLDER as often as the job says."""
    name, folder = sys.argv[1], Path(sys.argv[2]).resolve()
    job = json.loads((folder / "job.json").read_text())
    os.chdir(folder)
    for _ in range(job["runs"]):
        for old in folder.glob("pyvale_*"):
            old.unlink()
        start, before = time.perf_counter(), os.times()
        x, y, u, v = PEERS[name](folder, job)
        seconds, after = time.perf_counter() - start, os.times()
    # with processes that have ended; those of Ray live on, and are not counted
    processor = sum(after[:4]) - sum(before[:4])
    np.savez(folder / "found.npz", x=x, y=y, u=u, v=v)
    print(f"SECONDS {seconds} {processor}")


if __name__ == "__main__":
    main()
