"""What the published data say went wrong in the thesis: every claim tested, as one JSON file.

    python -m benchmarks.thesis_revisited --runs runs/thesis-revisited \\
        --json docs/verification/thesis_revisited.json

FE runs (14 a reading, three for mesh and pin) are kept in --runs and not done again; with --stored
only readings whose runs are all there are used.  Units mm, N, MPa.
"""

from __future__ import annotations

import argparse
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import logsumexp

from benchmarks.meshes import SAMPLING_CELLS
from benchmarks.run_key import is_kept
from benchmarks.thesis_claims import (
    INDEPENDENT,
    elsewhere,
    field_claims,
    implied_maxima,
    printed_scatter,
    quadrature_of,
    scatter_p_value,
    stiffness,
)
from benchmarks.thesis_force_control import both_controls, published_at_forces
from benchmarks.thesis_hypotheses import READINGS, TRAVEL, Reading, TrainedReading, design, train
from calib import __version__
from calib.data import PUBLISHED_CONSTANTS, thesis_forces
from calib.inference import fit_of, theta_of_constants
from calib.inference.leave_out import (
    Scores,
    differences,
    increment_blocks,
    leave_out,
    refitted,
    stacking,
)
from calib.inference.quadrature import Quadrature
from calib.study.artifacts import write_json

N_DRAWS = 4000


def main(argv: list[str] | None = None) -> int:
    """Run what is missing, test the claims, write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=Path, default=Path("runs") / "thesis-revisited")
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--stored", action="store_true", help="only readings whose runs are there")
    arguments = parser.parse_args(argv)
    started = time.perf_counter()

    def tell(line: str) -> None:
        print(f"{time.perf_counter() - started:6.0f} s  {line}", flush=True)

    trained = []
    for reading in READINGS:
        if arguments.stored and not complete(reading, arguments.runs):
            tell(f"{reading.name}: left out, its runs are not complete")
            continue
        trained.append(train(reading, arguments.runs, tell))
    facts = answer(trained, tell)
    facts["seconds"] = time.perf_counter() - started
    write_json(arguments.json, facts)
    tell(f"wrote {arguments.json}")
    return 0


def complete(reading: Reading, store: Path) -> bool:
    """Whether the design's runs are in the store, made by today's FE code, and those of a check.

    Where the check is made is known after training alone, so that its runs count whatever code or
    place they are of; `train` makes those three anew where they are of another.
    """
    folder = store / reading.folder
    if not is_kept(reading.model(SAMPLING_CELLS[reading.mesh]), design(), folder / "design"):
        return False
    return all(any((folder / name).glob("run_*.npz")) for name in ("coarse", "stiffer", "fine"))


def answer(trained: list[TrainedReading], tell: Any) -> dict[str, Any]:
    """All claims for the readings, as JSON data."""
    readings: dict[str, Any] = {}
    scores: list[Scores] = []
    rng = np.random.default_rng(20261122)
    for entry in trained:
        quadrature = quadrature_of(entry)
        found, score = of_reading(entry, quadrature, rng)
        readings[entry.reading.name] = found
        scores.append(score)
        tell(f"{entry.reading.name}: ln evidence {found['log_evidence'][0]:.2f}")
    rank(readings, tuple(scores), rng)
    return {
        "command": "python -m benchmarks.thesis_revisited",
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "softcal": __version__,
        "units": {"travel": "mm", "force": "N", "constants": "MPa"},
        "travel": TRAVEL,
        "force_mean": thesis_forces().force_mean,
        "readings": readings,
        "implied_maxima": implied_maxima(),
        "elsewhere": elsewhere(),
        "table_5_3": printed_scatter(),
        "controls": controls(trained[0]),
        "scatter_by_reading": {
            entry.reading.name: scatter(controls(entry, seed))
            for seed, entry in enumerate(trained, start=2)
        },
    }


def of_reading(
    entry: TrainedReading, quadrature: Quadrature, rng: np.random.Generator
) -> tuple[dict[str, Any], Scores]:
    """Evidence, fit, score, stiffness and fields of one reading."""
    posterior = entry.posterior()
    fit = fit_of(entry.reading.name, posterior, quadrature)
    weights = quadrature.weights / quadrature.weights.sum()
    draws = quadrature.x[rng.choice(len(weights), N_DRAWS, p=weights)]
    blocks = increment_blocks(thesis_forces().travel)
    score = leave_out(posterior.likelihood, draws, blocks)
    score = refitted(posterior, score, blocks)
    mesh = entry.mesh
    return {
        "n_runs": int(entry.campaign.reached.sum()),
        "mesh_force_difference": None if mesh is None else mesh.signed_force[0],
        "mesh_force_sd": None if mesh is None else mesh.force,
        "log_evidence": [fit.log_evidence, fit.log_evidence_error],
        "predictive_p": fit.p_value,
        "max_log_likelihood": fit.max_log_likelihood,
        "best_force_misfit": fit.best_misfit,
        "mu_MPa": [fit.mu_mean, fit.mu_sd],
        "ratios_mean": quadrature.mean[1:],
        "ratios_sd": quadrature.sd[1:],
        "elpd": [score.total, score.total_error],
        "pareto_k": score.pareto_k,
        "refit": score.refit,
        "stiffness": stiffness(entry, quadrature),
        "field": field_claims(entry, quadrature),
        "published_at_forces": published_at_forces(
            entry,
            {axis: implied_maxima()[axis]["maximum_mm"] for axis in ("x", "z")},
            quadrature.mean[1:],
        ),
    }, score


def rank(readings: dict[str, Any], scores: tuple[Scores, ...], rng: np.random.Generator) -> None:
    """Probabilities by evidence, with and without the maxima, and stacking; put into readings."""
    weights = stacking(scores, rng)
    off = differences(scores)
    evidence = np.array([found["log_evidence"][0] for found in readings.values()])
    by_force = _share(evidence)
    # Of the last increment, and of one of the five, unknown which; points seen likewise.
    density = np.array(
        [
            [seen["log_density_of_maxima"] for seen in found["field"]["seen"].values()]
            for found in readings.values()
        ]
    )
    last = logsumexp(density[:, :, -1], axis=1) - np.log(density.shape[1])
    any_step = logsumexp(density, axis=(1, 2)) - np.log(density[0].size)
    for i, found in enumerate(readings.values()):
        found["probability_by_forces"] = by_force[i]
        found["probability_with_maxima_at_1.4_mm"] = _share(evidence + last)[i]
        found["probability_with_maxima_at_some_increment"] = _share(evidence + any_step)[i]
        found["elpd_difference"] = [off[i].mean, off[i].error]
        found["stacking_weight"] = [weights.weights[i], weights.low[i], weights.high[i]]


def _share(log_weight: np.ndarray) -> np.ndarray:
    """Weights of the same proportions that sum to 1."""
    return np.exp(log_weight - logsumexp(log_weight))


def scatter(found: dict[str, Any]) -> dict[str, Any]:
    """SD of ln (C10 + C01) at the end, and the probability of that printed, by control."""
    return {
        name: [found[name]["sd_ln_kappa"], found[name]["p_of_printed_scatter"]]
        for name in ("travel_control", "force_control")
    }


def controls(stuck: TrainedReading, seed: int = 1) -> dict[str, Any]:
    """The thesis' method at travels and at four times the forces of a quarter of its constants."""
    truth = np.array([PUBLISHED_CONSTANTS[name] for name in ("C10", "C01", "C11")]) / 4.0
    theta = theta_of_constants(*truth)
    force = theta[0] * stuck.emulator.unit_force(theta[None, 1:])[0][0]
    found = both_controls(stuck, truth, 4.0 * force, seed)
    printed = np.array(printed_scatter()["kappa_end_MPa"])
    rows = list(INDEPENDENT)
    for name in ("travel_control", "force_control", "force_control_60_iterations"):
        part = found[name]
        good = [i for i in rows if part["end"][i] != "FAILED_START"]
        kappa = part["result_MPa"][good, :2].sum(axis=1)
        part["kappa_MPa"] = kappa
        part["sd_ln_kappa"] = float(np.log(kappa).std(ddof=1))
        part["p_of_printed_scatter"] = scatter_p_value(printed, kappa)
    found["reading"] = stuck.reading.name
    return found


if __name__ == "__main__":
    sys.exit(main())
