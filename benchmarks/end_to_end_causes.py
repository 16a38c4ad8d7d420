"""Where the errors of `benchmarks.end_to_end` come from, on its stored runs.

    python -m benchmarks.end_to_end_causes [20] [runs/end_to_end] [--contact friction]

Prints z of every seed with the photographed field and with the exact field and forces in its
place, then the error of the measured field that the seeds share.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.end_to_end import (
    CASES,
    SLIDING,
    Case,
    at_points,
    common_points,
    dataset_of,
    outcome,
    solved,
    training,
)
from calib.data.dataset import Dataset
from fe.response import Array
from surrogate import Emulator

UPPER = 0.35
"""mm below the uppermost points"""


def exact(case: Case, theta: Array, dataset: Dataset, runs: Path) -> Dataset:
    """The data set with the true field and forces and the same statement of their errors."""
    assert dataset.field is not None
    truth = solved(case, case.truth, theta[1:], runs)
    field = replace(
        dataset.field, displacement=truth.field_at(dataset.field.points, dataset.travel)
    )
    return replace(dataset, field=field, force_mean=theta[0] * truth.force_at(dataset.travel))


def left_over(dataset: Dataset, true: Dataset) -> Array:
    """(n_step, n, 3) error of the measured field without its patterns, mm."""
    field, right = dataset.field, true.field
    assert field is not None and right is not None and field.patterns is not None
    off = (field.displacement - right.displacement) / field.noise_std
    shapes = (field.patterns / field.noise_std).reshape(len(field.patterns), -1)
    sizes = np.linalg.lstsq(shapes.T, off.ravel(), rcond=None)[0]
    found: Array = (off.ravel() - sizes @ shapes).reshape(off.shape) * field.noise_std
    return found


def main() -> None:
    """Print z of all seeds and the shared error by place."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("n", nargs="?", type=int, default=20, help="seeds, from 0 on")
    parser.add_argument(
        "runs", nargs="?", type=Path, default=Path("runs/end_to_end"), help="where runs are kept"
    )
    parser.add_argument("--contact", choices=CASES, default=SLIDING.name)
    args = parser.parse_args()
    n, runs, case = args.n, args.runs, CASES[args.contact]
    made = [dataset_of(case, seed, runs) for seed in range(n)]
    points = common_points([dataset for _, dataset in made])
    train, mesh = training(case, runs, points, made[0][1].travel)
    emulator = Emulator.fit(train, 1)
    errors, scores = [], []
    for seed, (theta, whole) in enumerate(made):
        dataset = at_points(whole, points)
        true = exact(case, theta, dataset, runs)
        both = [outcome(theta, one, emulator, mesh).z for one in (dataset, true)]
        scores.append(both)
        errors.append(left_over(dataset, true))
        print(f"seed {seed}: z {both[0].round(2)}, exact {both[1].round(2)}", flush=True)
    print("mean z, photographed and exact:", np.mean(scores, axis=0).round(2).tolist())
    residual = 1e3 * np.array(errors)
    upper = points[:, 1] > points[:, 1].max() - UPPER
    chance = np.sqrt((residual.var(axis=0, ddof=1) / n).mean(axis=1))
    print("RMS of one seed's error, um:", np.sqrt((residual**2).mean(axis=(0, 1, 2))).round(3))
    print("SD of its shared part by chance, um:", chance.round(3).tolist())
    for name, here in (("upper", upper), ("other", ~upper)):
        shared = np.sqrt((residual.mean(axis=0)[:, here] ** 2).mean(axis=1))
        print(f"shared, {name} points, um:", shared.round(3).tolist())


if __name__ == "__main__":
    main()
