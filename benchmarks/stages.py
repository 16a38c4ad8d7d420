"""Time one FE run of each hypothesis of the thesis study, and fit and prediction of an emulator.

    python -m benchmarks.stages

Prints wall-clock times of one process with one thread. The emulator is fitted to a smooth function
of the ratios with the shape of the real runs: its cost depends on shapes, not on what was computed.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from calib.study import Study, load_study
from calib.study.context import block_pin_model
from surrogate import Emulator, ScaledEmulator, TrainingSet, sobol_design

T = TypeVar("T")
N_POINT = 840  # points of the front face
N_THETA = 64  # thetas of one batch: the walkers of two ensembles


def main() -> None:
    """Print one line per stage."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    study = load_study("thesis-forces")
    time_simulations(study)
    time_emulator(study)


def time_simulations(study: Study) -> None:
    """One run on the sampling mesh at the centre of the prior, the second call of each model."""
    ratios = np.array([(p.low + p.high) / 2 for p in (study.prior.r, study.prior.s)])
    for hypothesis in study.hypotheses:
        simulate = block_pin_model(study, hypothesis, study.sampling_cells(hypothesis))
        simulate(ratios)  # compiles and caches
        response, seconds = timed(lambda run=simulate: run(ratios))
        cells = " x ".join(map(str, study.sampling_cells(hypothesis)))
        print(
            f"FE run, {hypothesis.name}, {cells} elements: {seconds:.1f} s, "
            f"{response.n_factorisations} factorisations, {response.status}"
        )


def time_emulator(study: Study) -> None:
    """Fit to the study's number of runs with fields, and predict forces of a batch."""
    bounds = np.array([(p.low, p.high) for p in (study.prior.r, study.prior.s)])
    ratios = sobol_design(study.design.n_runs, bounds, study.seed)
    travel = np.array(study.increments)
    growth = 1.0 + ratios.sum(axis=1)[:, None] * travel
    modes = np.random.default_rng(study.seed).standard_normal((len(travel), N_POINT, 3))
    field = growth[:, :, None, None] ** 2 * modes
    training_set = TrainingSet(ratios=ratios, force=np.exp(growth), displacement=field)
    emulator, seconds = timed(lambda: Emulator.fit(training_set, study.seed))
    print(f"Emulator, fit to {len(ratios)} runs with fields: {seconds:.1f} s")

    scaled = ScaledEmulator(emulator)
    inside = sobol_design(N_THETA, bounds, study.seed + 1)
    theta = np.column_stack([np.full(N_THETA, 0.05), inside])
    scaled.force(theta)
    n_repeat = 200
    _, seconds = timed(lambda: [scaled.force(theta) for _ in range(n_repeat)])
    print(f"Emulator, forces of {N_THETA} thetas: {1e3 * seconds / n_repeat:.2f} ms")


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """Result and wall-clock seconds."""
    start = time.perf_counter()
    result = work()
    return result, time.perf_counter() - start


if __name__ == "__main__":
    main()
