"""Log-probabilities per second, forces only and with a field, beside dense scipy evaluation.

    python -m benchmarks.bench_log_prob

One thread, processor time. The emulators are fitted to a smooth function of the ratios with the
shape of the thesis study (24 runs, 5 increments, 840 points): their cost depends on shapes, not on
values.
"""

from __future__ import annotations

import argparse
import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import time  # noqa: E402
from collections.abc import Callable  # noqa: E402
from dataclasses import replace  # noqa: E402

import numpy as np  # noqa: E402
from scipy.stats import multivariate_normal  # noqa: E402

from calib.data import Dataset, FieldData, thesis_forces  # noqa: E402
from calib.inference import (  # noqa: E402
    EmulatorForward,
    Marginal,
    NoiseSettings,
    Posterior,
    Prior,
    build_likelihood,
    theta_of,
)
from fe.response import Array  # noqa: E402
from surrogate import Emulator, ScaledEmulator, TrainingSet, sobol_design  # noqa: E402

N_RUNS = 24
GRID = (35, 24)
PRIOR = Prior(
    Marginal("log_uniform", 0.001, 0.1), Marginal("uniform", 0, 1), Marginal("uniform", 0, 0.5)
)


def main() -> None:
    """Print rates and ratios."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    rng = np.random.default_rng(0)
    points, training, dataset = smooth_study(rng)
    print(f"{N_RUNS} runs, {dataset.travel.size} increments, {len(points)} points, one thread")
    for with_field in (False, True):
        used = training if with_field else replace(training, displacement=None)
        forward = EmulatorForward(
            ScaledEmulator(Emulator.fit(used, 1, n_restarts=1)), with_field=with_field
        )
        data = dataset if with_field else replace(dataset, field=None)
        likelihood = build_likelihood(
            data, forward, NoiseSettings(), force_discretisation=0.03, field_floor=0.002
        )
        compare(Posterior(PRIOR, likelihood), data, rng)


def smooth_study(rng: np.random.Generator) -> tuple[Array, TrainingSet, Dataset]:
    """Points, training set and data of a smooth analytic stand-in."""
    ratios = sobol_design(N_RUNS, PRIOR.bounds[1:], 1)
    x, y = np.meshgrid(np.linspace(0, 5, GRID[0]), np.linspace(0, 2.5, GRID[1]), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])
    travel = thesis_forces().travel
    shape = np.stack([np.sin(x.ravel()), np.cos(y.ravel()), x.ravel() * y.ravel() / 10], axis=1)
    growth = 1.0 + ratios[:, :1] * travel + ratios[:, 1:] * travel**2
    wobble = np.sin(np.multiply.outer(growth, x.ravel() / 3))[..., None]
    field = growth[:, :, None, None] * shape * 0.2 + 0.02 * wobble
    training = TrainingSet(ratios=ratios, force=60 * np.exp(growth), displacement=field)
    noise = np.array([0.01, 0.01, 0.02])
    data = FieldData(
        points, field[7] + noise * rng.standard_normal(field[7].shape), noise, 0.5, 0.5
    )
    return points, training, replace(thesis_forces(), field=data)


def compare(posterior: Posterior, data: Dataset, rng: np.random.Generator) -> None:
    """Rates of batches of several sizes and of the dense evaluation of the same density."""
    what = "force and field" if data.field is not None else "force only"
    posterior.log_prob(PRIOR.sample(rng, 2))  # prepares what is computed once
    rates = []
    for batch in (16, 64, 1024, 65_536):
        x = PRIOR.sample(rng, batch)
        rates.append(batch / seconds_of(lambda x=x: posterior.log_prob(x)))
        print(f"{what}, batches of {batch}: {rates[-1]:,.0f} log-probabilities/s")
    x = PRIOR.sample(rng, 1)
    dense_force = seconds_of(lambda: dense_force_log_prob(posterior, x))
    if data.field is None:
        print(
            f"{what}, dense scipy: {1 / dense_force:,.0f}/s, ratio {rates[-1] * dense_force:,.0f}"
        )
        return
    # Building the dense matrix is left out of the time: only scipy's factorisation counts.
    residual, covariance = dense_field(posterior)
    start = time.process_time()
    multivariate_normal.logpdf(residual, cov=covariance, allow_singular=True)
    one = time.process_time() - start
    size, full = residual.size, data.field.displacement.size
    print(
        f"{what}, dense scipy with {size:,} of the {full:,} field values: {1 / one:.3g}/s, ratio "
        f"{rates[-1] * one:,.0f}; the whole field would cost {(full / size) ** 3:,.0f} times that"
    )


def seconds_of(call: Callable[[], object]) -> float:
    """Processor seconds of one call: the best of some repeats that last half a second together."""
    best, spent = np.inf, 0.0
    while spent < 0.5:
        start = time.process_time()
        call()
        taken = time.process_time() - start
        best, spent = min(best, taken), spent + taken
    return best


def dense_force_log_prob(posterior: Posterior, x: Array) -> float:
    """The forces' log posterior by scipy's multivariate normal, one theta at a time."""
    likelihood = posterior.likelihood
    prediction = likelihood.forward.predict(theta_of(x))
    covariance = likelihood.force_covariance(prediction)[0]
    density = multivariate_normal.logpdf(likelihood.force, prediction.force[0], covariance)
    return float(density + posterior.prior.log_prob(x)[0])


def dense_field(posterior: Posterior) -> tuple[Array, Array]:
    """Residual and dense covariance of every third point: all 12,600 values would need 1.3 GB."""
    field = posterior.likelihood.field
    assert field is not None
    noise = field.covariance.with_patterns(field.basis.truncation)
    keep = np.arange(0, noise.floor_values.size, 3)
    own = noise.correlation[np.ix_(keep, keep)]
    inverse = np.linalg.inv(noise.vectors)
    smooth = ((inverse.T * noise.floor_values) @ inverse)[np.ix_(keep, keep)]
    n_step = noise.step.shape[0]
    total = np.kron(noise.step, np.kron(own, np.diag(noise.noise_variance)))
    floor = np.einsum("cij,pq,cd->ipcjqd", noise.floor, smooth, np.eye(3))
    total += floor.reshape(total.shape)
    flat = noise.patterns[:, :, keep].reshape(-1, n_step * keep.size * 3)
    residual = (field.observed - field.basis.offset)[:, keep].ravel()
    return residual, total + flat.T @ flat


if __name__ == "__main__":
    main()
