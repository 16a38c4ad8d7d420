"""Virtual laboratories through the pipeline: who is rejected, what is found, how long it takes."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binom, kstest

from calib.data.qc import QcResult, analyse
from calib.virtual import (
    Cameras,
    LaboratorySettings,
    SampleTruth,
    TruthResponse,
    make_laboratory,
)
from calib.virtual.agreement import field_agreement, force_agreement

QUICK = (100, 26)
"""points of a frame along width and height where 50 laboratories are analysed"""
FULL = (200, 50)
"""the same of the laboratory that is timed: 10,000 points"""


@dataclass(frozen=True)
class Analysed:
    """One laboratory and what the pipeline made of it."""

    samples: tuple[SampleTruth, ...]
    result: QcResult
    wall_s: float
    processor_s: float


def analysed(truth: TruthResponse, seed: int, grid: tuple[int, int]) -> Analysed:
    """Write the laboratory of a seed, with its third misplaced, and analyse its files."""
    settings = LaboratorySettings(cameras=Cameras(grid=grid))
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "laboratory"
        samples = make_laboratory(place, truth, settings, seed)
        wall, processor = time.perf_counter(), time.process_time()
        result = analyse(place)
        wall, processor = time.perf_counter() - wall, time.process_time() - processor
    return Analysed(samples, result, wall, processor)


def confusion(one: Analysed) -> dict[str, int]:
    """Samples by truth and verdict; positive is a rejection."""
    rejected = {r.sample for r in one.result.rejections}
    pairs = [(sample.placement.beyond != "", sample.name in rejected) for sample in one.samples]
    return {
        "true_positive": pairs.count((True, True)),
        "true_negative": pairs.count((False, False)),
        "false_positive": pairs.count((False, True)),
        "false_negative": pairs.count((True, False)),
    }


def placing_errors(one: Analysed) -> np.ndarray:
    """(n, 2) errors of the x-shift, mm, and of the angle, degrees, of the samples analysed."""
    errors = []
    for sample, found in zip(one.samples, one.result.samples, strict=True):
        if found.face is not None:
            at, true = found.face.placement, sample.placement
            # turned about the upward axis, the right-hand side goes away from the cameras
            errors.append((at.x_shift - true.x_shift, at.angle_deg + true.angle))
    return np.array(errors)


def of_seed(truth: TruthResponse, seed: int) -> dict[str, Any]:
    """Verdicts, errors of the placement and agreement with the truth of one laboratory."""
    one = analysed(truth, seed, QUICK)
    found: dict[str, Any] = {"counts": confusion(one), "errors": placing_errors(one).tolist()}
    if one.result.dataset is not None:
        field = field_agreement(one.result.dataset, truth)
        found["field"] = [field.chi2 / field.n, field.p]
        found["force_p"] = force_agreement(one.result.dataset, truth).p
        found["travel_error"] = _travel_error(one)
    print(f"seed {seed}: {found['counts']}, field {found.get('field')}", flush=True)
    return found


def _travel_error(one: Analysed) -> float:
    """Mean over the kept samples of how much deeper a hold is than its travel says, mm."""
    errors = []
    for sample, true, kept in zip(one.result.samples, one.samples, one.result.kept, strict=True):
        if kept and sample.machine is not None:
            numbers, travel, _ = sample.machine.loaded()
            errors.append(np.mean(true.travel[numbers.astype(int) - 1] - travel))
    return float(np.mean(errors))


def over_seeds(
    truth: TruthResponse, seeds: Sequence[int], store: Path | None = None
) -> dict[str, Any]:
    """Confusion table, errors of the placement and agreement with the truth over the seeds.

    Seeds found in the folder `store` are not run again: it is of one version of the code.
    """
    every = []
    for seed in seeds:
        path = None if store is None else store / f"laboratory-{seed}.json"
        if path is not None and path.exists():
            every.append(json.loads(path.read_text()))
            continue
        every.append(of_seed(truth, seed))
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(every[-1]))
    counts = {name: sum(one["counts"][name] for one in every) for name in every[0]["counts"]}
    shift, angle = np.concatenate([one["errors"] for one in every]).T
    ratio, field_p = np.array([one["field"] for one in every if "field" in one]).T
    force_p = np.array([one["force_p"] for one in every if "field" in one])
    travel = 1e3 * np.array([one["travel_error"] for one in every if "field" in one])
    return counts | {
        "seeds": len(seeds),
        "first_seed": min(seeds),
        "points": int(np.prod(QUICK)),
        "x_shift_error_sd_mm": round(float(shift.std()), 5),
        "x_shift_error_max_mm": round(float(np.abs(shift).max()), 5),
        "angle_error_sd_deg": round(float(angle.std()), 5),
        "angle_error_max_deg": round(float(np.abs(angle).max()), 5),
        "field_chi2_per_number": round(float(ratio.mean()), 4),
        "field_chi2_per_number_sd": round(float(ratio.std(ddof=1)), 4),
        "field_p_below_0.05": int((field_p < 0.05).sum()),
        "force_p_below_0.05": int((force_p < 0.05).sum()),
        "travel_error_um": round(float(travel.mean()), 2),
        "travel_error_um_sd": round(float(travel.std(ddof=1)), 2),
        # numbers below 0.05 that uniform p would give in 95 of 100 times
        "p_below_0.05_band": [int(n) for n in binom.interval(0.95, len(field_p), 0.05)],
        "field_p_kolmogorov_smirnov": round(float(kstest(field_p, "uniform").pvalue), 4),
        "force_p_kolmogorov_smirnov": round(float(kstest(force_p, "uniform").pvalue), 4),
    }


def full_size(truth: TruthResponse, seed: int) -> dict[str, Any]:
    """Agreement and time of 24 samples of 10 frames of 10,000 points."""
    one = analysed(truth, seed, FULL)
    dataset = one.result.dataset
    if dataset is None:
        raise ValueError(f"seed {seed}: expected a data set, found too few samples left")
    field, force = field_agreement(dataset, truth), force_agreement(dataset, truth)
    return {
        "chi2": round(field.chi2, 1),
        "chi2_n": field.n,
        "chi2_p": round(field.p, 6),
        "force_chi2_p": round(force.p, 6),
        "pipeline_seconds": round(one.wall_s, 2),
        "pipeline_processor_seconds": round(one.processor_s, 2),
        "pipeline_points": int(np.prod(FULL)),
    }
