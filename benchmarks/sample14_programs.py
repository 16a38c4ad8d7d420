"""DIC Challenge sample 14 by softcal and by other programs, in one run at the same points."""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.dic_peers import PEERS
from benchmarks.peer_process import run_peer
from benchmarks.sample14 import (
    BOX,
    LEVELS,
    Sample,
    averaged,
    file_of,
    grid,
    ours,
    trade_off,
)
from benchmarks.sample14_efficiency import indicator
from calib.dic import CorrelationSettings
from calib.dic.interpolation import Array

STEP = 16
SETTINGS = ((1, 31), (2, 51))
"""order and subset"""
GLOBAL = ("muDIC",)
"""programs with elements in place of subsets, whose nodes stand an element apart"""
LIMIT = 600.0
"""s for one program at one setting and level"""
MARGIN = 0.5
"""px: points of a program whose grid reaches beyond the box are left out"""


def programs(sample: Sample, data: Path, peers: Path) -> dict[str, Any]:
    """Loss and noise of every program that has its environment in `peers`.

    Without any there is nothing to set beside ours: no figures. Says which are left out.
    """
    there = {name: peers.resolve() / name / "bin" / "python" for name in PEERS}
    missing = [name for name, python in there.items() if not python.exists()]
    if missing:
        print(
            f"sample14: no environment of {', '.join(missing)} in {peers}, left out; "
            "python benchmarks/dic.py --install makes them",
            file=sys.stderr,
        )
    if len(missing) == len(there):
        return {}
    figures: dict[str, Any] = {}
    for order, subset in SETTINGS:
        name = f"order_{order}_subset_{subset}"
        figures[name] = {"softcal": _ours(sample, order, subset)}
        for peer, python in there.items():
            if python.exists():
                figures[name][peer] = _theirs(sample, data, peer, python, order, subset)
                print(f"sample14, {name}, {peer}: {figures[name][peer]}", flush=True)
    return figures


def _ours(sample: Sample, order: int, subset: int) -> dict[str, Any]:
    points = grid(sample, STEP)
    settings = CorrelationSettings(subset=subset, order=order)
    return {
        level: _judged(
            points,
            ours(sample, level, points, settings).displacement[:, 0],
            sample,
            level,
            settings,
        )
        for level in LEVELS
    }


def _judged(
    points: Array,
    u: Array,
    sample: Sample,
    level: str,
    settings: CorrelationSettings,
    of_subsets: bool = True,
) -> dict[str, Any]:
    """Trade-off of a program, and in one number where its loss is large enough to be measured."""
    left, top, right, bottom = BOX
    x, y = points.T
    inside = (x > left - MARGIN) & (x < right + MARGIN)
    inside &= (y > top - MARGIN) & (y < bottom + MARGIN)
    wave, truth = averaged(points[inside], u[inside]), sample.truth[level]
    figures: dict[str, Any] = {"points": int(np.isfinite(u[inside]).sum())}
    figures |= trade_off(wave, truth, settings.subset, settings.order)
    if not of_subsets:
        # what a subset would pass says nothing of elements
        del figures["filter_loss_px"], figures["mean_filter_loss_px"]
    elif level == "L5" and settings.order == 1:
        figures["indicator_px2"] = indicator(wave, truth, settings)
    return figures


def _theirs(
    sample: Sample, data: Path, peer: str, python: Path, order: int, subset: int
) -> dict[str, Any]:
    folder = data / "dic2d_sample14_sinusoid"
    figures: dict[str, Any] = {}
    for level in LEVELS:
        with tempfile.TemporaryDirectory() as place:
            job = {
                "order": order,
                "subset": subset,
                "step": STEP,
                "runs": 1,
                "box": BOX,
                "threads": len(os.sched_getaffinity(0)),
                "shape": sample.reference.shape,
                # all start from rest
                "stretch": [1.0, 1.0],
                "centre": [0.0, 0.0],
                "move": [0.0, 0.0],
            }
            (Path(place) / "job.json").write_text(json.dumps(job))
            (Path(place) / "pair").mkdir()
            for name, file in (
                ("a", folder / "Sample14 Reference.tif"),
                ("b", file_of(folder, level)),
            ):
                shutil.copyfile(file, Path(place) / "pair" / f"{name}.tif")
            found = run_peer(peer, python, Path(place), LIMIT)
        if isinstance(found, str):
            return {"failed": found}
        points, displacement, _, _ = found
        settings = CorrelationSettings(subset=subset, order=order)
        try:
            figures[level] = _judged(
                points, displacement[:, 0], sample, level, settings, peer not in GLOBAL
            )
        except ValueError as error:  # a field that is no subset's: the other programs' go on
            return {"failed": str(error)}
    return figures
