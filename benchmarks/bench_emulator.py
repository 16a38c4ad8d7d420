"""Batched prediction of the force emulator against scikit-learn's predict, side by side.

Run: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python -m benchmarks.bench_emulator
"""

from __future__ import annotations

import timeit
from collections.abc import Callable

import numpy as np

from surrogate import Emulator, ScaledEmulator, TrainingSet, sobol_design
from surrogate.gp import fit_regressor

N_RUNS, N_STEP, N_THETA = 24, 5, 64


def synthetic_runs() -> TrainingSet:
    """Smooth synthetic forces over the ratios (not of the FE model: only the sizes matter)."""
    x = sobol_design(N_RUNS, np.array([[0.0, 1.0], [0.0, 0.5]]), seed=1)
    travel = np.linspace(0.6, 1.4, N_STEP)
    force = 30.0 * travel ** (1.5 + 0.3 * x[:, :1] + 0.4 * x[:, 1:]) * np.exp(np.sin(2 * x[:, :1]))
    noise = 0.01 * np.random.default_rng(0).normal(size=force.shape)
    return TrainingSet(x, force * np.exp(noise), None)


def microseconds(call: Callable[[], object]) -> float:
    """Least mean time of a call over nine repetitions."""
    call()
    return min(timeit.repeat(call, number=50, repeat=9)) / 50 * 1e6


def main() -> None:
    """Print the times and the largest difference between the two means."""
    runs = synthetic_runs()
    emulator = Emulator.fit(runs, 1, n_restarts=2)
    processes = emulator.force.processes
    seeds = [int(s.generate_state(1)[0]) for s in np.random.SeedSequence(1).spawn(N_STEP)]
    regressors = [
        fit_regressor(processes.inputs, target, seed, n_restarts=2)
        for target, seed in zip(processes.targets, seeds, strict=True)
    ]
    rng = np.random.default_rng(2)
    theta = np.column_stack(
        [np.full(N_THETA, 0.02), rng.uniform(size=N_THETA), 0.5 * rng.uniform(size=N_THETA)]
    )
    ratios = theta[:, 1:]
    unit = (ratios - processes.low) / processes.span

    def one_by_one() -> list[tuple[np.ndarray, np.ndarray]]:
        return [regressor.predict(unit, return_std=True) for regressor in regressors]

    scaled = ScaledEmulator(emulator)
    rows = {
        "scikit-learn predict, mean and SD": microseconds(one_by_one),
        "softcal processes, mean and variance": microseconds(lambda: processes.predict(ratios)),
        "softcal force, mean and covariance": microseconds(lambda: scaled.force(theta)),
    }
    reference = rows["scikit-learn predict, mean and SD"]
    print(f"{N_THETA} parameter vectors, {N_STEP} processes, {N_RUNS} runs")
    print(f"{'':40}{'time [us]':>12}{'ratio':>8}")
    for name, time in rows.items():
        print(f"{name:40}{time:12.1f}{reference / time:8.1f}")
    expected = np.array([mean for mean, _ in one_by_one()]).T
    found = (processes.predict(ratios)[0] - processes.offset) / processes.scale
    print(f"largest difference of scaled means: {np.abs(found - expected).max():.1e}")


if __name__ == "__main__":
    main()
