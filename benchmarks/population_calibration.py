"""How often populations hold their truth: ranks of mean, scatter, common unknown and samples.

    python -m benchmarks.population_calibration [200] [runs/population_calibration.npz] [FILE.json]

Simulation-based calibration of the hierarchical model: each virtual population has a mean, an SD
between samples, a ratio r that all samples share and a common error of the model drawn from their
priors, and n samples with noise of their own. The forward model is linear, so that 200 populations
take minutes; everything else is the product's. Populations that are done are kept in the npz file.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np

from benchmarks.linear_population import MEAN, SD, condensed, dataset, forces, population
from calib.inference.hierarchical import HierarchicalPosterior
from calib.inference.hierarchical_sampling import sample_population
from calib.inference.rank_uniformity import LEVELS, coverage, uniformity
from calib.inference.sampling import SamplerSettings
from fe.response import Array

N_SAMPLES = 8
SIZE = 0.3
"""of the half-normal prior of the SD between samples of ln kappa"""
COMMON_SD = 0.2
"""of an error of the model that all samples share, N"""
NAMES = ("mean of ln kappa", "SD between samples", "r", "ln kappa of one sample")
SETTINGS = SamplerSettings(
    n_ensembles=2, n_walkers=32, n_autocorrelation=8, max_r_hat=1.05, max_steps=240, check_every=60
)
FALSE_ALARM = 0.01
"""of the band of the ranks' distribution function, each quantity by itself"""


def ranks(seed: int) -> Array:
    """(4,) posterior probability below the truth of `NAMES` of one virtual population."""
    rng = np.random.default_rng([6, seed])
    mean = MEAN + SD * rng.standard_normal()
    tau = abs(SIZE * rng.standard_normal())
    r = rng.random()
    own = mean + tau * rng.standard_normal(N_SAMPLES)
    force = forces(np.column_stack([own, np.full(N_SAMPLES, r)]), rng, COMMON_SD)
    posterior = HierarchicalPosterior(population(SIZE), condensed(dataset(force), COMMON_SD))
    found = sample_population(posterior, SETTINGS, rng)
    shift = np.log(0.01)
    return np.array(
        [
            np.mean(found.x[..., 0] - shift < mean),
            np.mean(found.tau < tau),
            np.mean(found.x[..., 1] < r),
            np.mean(found.own[..., 0, 0] - shift < own[0]),
        ]
    )


def all_ranks(n: int, kept: Path | None = None) -> Array:
    """(n, 4) ranks of n populations; those in the file are not made again."""
    done = np.zeros((0, len(NAMES)))
    if kept is not None and kept.exists():
        done = np.load(kept)["ranks"][:n]
    for seed in range(len(done), n):
        done = np.vstack([done, ranks(seed)])
        if kept is not None:
            kept.parent.mkdir(parents=True, exist_ok=True)
            np.savez(kept, ranks=done)
    return done


def report(below: Array) -> dict[str, object]:
    """Tests of uniformity and coverage of each quantity."""
    found: dict[str, object] = {"n": len(below), "n_samples": N_SAMPLES, "levels": LEVELS}
    inside = coverage(below)
    for column, name in enumerate(NAMES):
        tested = uniformity(below[:, column], n_bin=len(below) // 10, false_alarm=FALSE_ALARM)
        found[name] = {**asdict(tested), "coverage": inside[:, column].tolist()}
    return found


def main() -> None:
    """Print, and write where a file is named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("n", nargs="?", type=int, default=200, help="synthetic experiments")
    parser.add_argument(
        "kept",
        nargs="?",
        type=Path,
        default=Path("runs/population_calibration.npz"),
        help="where ranks are kept",
    )
    parser.add_argument("out", nargs="?", type=Path, help="file for the report")
    args = parser.parse_args()
    text = json.dumps(report(all_ranks(args.n, args.kept)), indent=1)
    print(text)
    if args.out is not None:
        args.out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
