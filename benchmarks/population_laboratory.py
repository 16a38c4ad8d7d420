"""A virtual laboratory whose samples differ in stiffness, from its files to the population.

    python -m benchmarks.population_laboratory [3] [runs/end_to_end] [FILE.json]

Every seed is one laboratory: 12 samples, of which two are misplaced and must be rejected, with a
known SD of ln(stiffness) between samples. Its files go through readers and quality control into a
data set; an emulator is trained on a coarser mesh than the truth's; the hierarchical model says
population, scatter and each sample's kappa. Runs and results are kept in the folder. The meshes
are those of `benchmarks.end_to_end`, whose runs serve here too.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.end_to_end import (
    PRIOR,
    SLIDING,
    draw_truth,
    settings,
    training,
    truth_response,
)
from calib.data import Dataset
from calib.data.qc import analyse
from calib.inference.condensed import condense
from calib.inference.forward import EmulatorForward
from calib.inference.hierarchical import HierarchicalPosterior
from calib.inference.hierarchical_sampling import sample_population
from calib.inference.noise import NoiseSettings
from calib.inference.population import Population, ScatterPrior
from calib.inference.sample_errors import SampleErrors
from calib.inference.sampling import SamplerSettings
from calib.virtual import Cameras, Placing, make_laboratory
from fe.response import Array
from surrogate import Emulator, ScaledEmulator

N_SAMPLES, MISPLACED = 12, 2
N_TRAINING = 24
"""runs of the emulator: the first of the design of `benchmarks.end_to_end`"""
SCATTER = 0.1
"""true SD of ln kappa between samples"""
SIZES = {"kappa": ScatterPrior(0.3)}
TRUTH_SEED = 0
"""of `end_to_end.draw_truth`: the constants are the same in all laboratories"""
NOISE = NoiseSettings(load_cell_sd=0.015, travel_zero_sd=0.01)
"""0.07 N in a reading, averaged over a hold; a common zero of the travel"""
SAMPLER = SamplerSettings(
    n_ensembles=4, n_walkers=24, n_autocorrelation=20, max_steps=750, check_every=125
)


def laboratory(seed: int, runs: Path) -> tuple[Array, dict[str, float], Dataset]:
    """True (kappa [MPa], r, s), true kappa of every sample, and what the files give."""
    theta = draw_truth(TRUTH_SEED)
    response = truth_response(SLIDING, theta, runs)
    chosen = replace(
        settings(),
        samples=N_SAMPLES,
        cameras=Cameras(format="softcal", grid=(100, 26)),
        placing=Placing(misplaced=MISPLACED, stiffness_sd=SCATTER),
    )
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "laboratory"
        samples = make_laboratory(folder, response, chosen, seed)
        found = analyse(folder)
    if found.dataset is None:
        raise ValueError(f"seed {seed}: expected a data set, found {found.rejections}")
    own = {sample.name: float(theta[0] * sample.placement.stiffness) for sample in samples}
    return theta, own, found.dataset


def one(seed: int, runs: Path) -> dict[str, object]:
    """What the hierarchical model says of one laboratory, beside the truth."""
    theta, own, dataset = laboratory(seed, runs)
    assert dataset.field is not None and dataset.samples is not None
    train, mesh = training(SLIDING, runs, dataset.field.points, dataset.travel, N_TRAINING)
    forward = EmulatorForward(
        ScaledEmulator(Emulator.fit(train, 1)), with_field=True, correction=mesh.correction
    )
    samples = condense(
        dataset, forward, NOISE, SampleErrors(), force_discretisation=mesh.force,
        field_floor=mesh.field_floor, field_patterns=mesh.field_patterns(dataset, NOISE, forward),
    )  # fmt: skip
    posterior = HierarchicalPosterior(Population(PRIOR, SIZES), samples)
    draws = sample_population(posterior, SAMPLER, np.random.default_rng(seed))
    truth = np.log([own[name] for name in dataset.samples.names])
    each = draws.own[..., 0].reshape(-1, len(truth))
    x = draws.x.reshape(-1, draws.x.shape[-1])
    true_x = np.array([np.log(theta[0]), *theta[1:]])
    return {
        "seed": seed,
        "kept": list(dataset.samples.names),
        "message": draws.message,
        "truth": true_x.tolist(),
        "mean": x.mean(axis=0).tolist(),
        "sd": x.std(axis=0).tolist(),
        "z": ((x.mean(axis=0) - true_x) / x.std(axis=0)).tolist(),
        "scatter_true": SCATTER,
        "scatter_of_these": float(truth.std(ddof=1)),
        "scatter_mean": float(draws.tau.mean()),
        "scatter_sd": float(draws.tau.std()),
        "sample_z": ((each.mean(axis=0) - truth) / each.std(axis=0)).tolist(),
        "sample_sd": each.std(axis=0).tolist(),
        "difference_z": _differences(each, truth),
        "alone_sd": draws.alone[..., 0].std(axis=0).tolist(),
        "fit_p": draws.p_value.tolist(),
    }


def _differences(each: Array, truth: Array) -> list[float]:
    """Z of ln kappa of each sample less the mean of all: free of what all share."""
    own = each - each.mean(axis=1, keepdims=True)
    off = own.mean(axis=0) - (truth - truth.mean())
    return list((off / own.std(axis=0)).tolist())


def main() -> None:
    """Print every seed; write where a file is named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("n", nargs="?", type=int, default=3, help="seeds, from 0 on")
    parser.add_argument(
        "runs", nargs="?", type=Path, default=Path("runs/end_to_end"), help="where runs are kept"
    )
    parser.add_argument("out", nargs="?", type=Path, help="file for the report")
    args = parser.parse_args()
    found = []
    for seed in range(args.n):
        kept = args.runs / f"population-{seed}.json"
        if not kept.exists():
            kept.write_text(json.dumps(one(seed, args.runs), indent=1) + "\n", encoding="utf-8")
        found.append(json.loads(kept.read_text(encoding="utf-8")))
        print(kept.read_text(encoding="utf-8"), flush=True)
    if args.out is not None:
        args.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
