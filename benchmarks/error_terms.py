"""Log-probabilities a second with each optional term of the errors: 840 points, 5 increments.

    python -m benchmarks.error_terms

One thread, processor time, best of 30 batches of 1,024. The forward model is eight given modes with
an emulator's covariance, so that the likelihood alone is timed; without the prior.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from calib.data import Dataset, FieldData, thesis_forces
from calib.inference import NoiseSettings, build_likelihood
from calib.inference.forward import FieldBasis, Prediction
from fe.response import Array

N_MODES = 8
BATCH = 1024
NUISANCES = NoiseSettings(
    compliance_sd=0.01, gain_sd=0.01, field_scale_sd=0.002, translation_sd=0.002, rotation_sd=0.05
)
NOISE, DISCREPANCY = {"field_noise": (0.5, 2.0)}, {"discrepancy": (1e-3, 0.05)}
CASES: dict[str, tuple[NoiseSettings, dict[str, tuple[float, float]]]] = {
    "none": (NoiseSettings(), {}),
    "all nuisances": (NUISANCES, {}),
    "factor of the force's errors": (NoiseSettings(), {"force_noise": (0.3, 3.0)}),
    "factor of the field's noise": (NoiseSettings(), NOISE),
    "discrepancy of the field": (NoiseSettings(), DISCREPANCY),
    "both": (NoiseSettings(), NOISE | DISCREPANCY),
    "all of these": (NUISANCES, {"force_noise": (0.3, 3.0)} | NOISE | DISCREPANCY),
}


class GivenModes:
    """Forces and weights as smooth functions of r, with the covariance of an emulator."""

    def __init__(self, points: Array) -> None:
        rng = np.random.default_rng(0)
        order = np.arange(N_MODES)[:, None]
        shape = np.cos(order * points[:, 0] / 2.0) * np.cos(order * points[:, 1])
        component = rng.standard_normal((N_MODES, 3))
        modes = 0.02 * np.einsum("i,kp,kc->kipc", np.arange(1, 6) / 5.0, shape, component)
        self.field_basis = FieldBasis(np.zeros(modes.shape[1:]), modes, 1e-3 * modes[:2])

    def predict(self, theta: Array) -> Prediction:
        """Prediction at theta (m, 3)."""
        force = (
            theta[:, :1] * np.array([34.0, 53.0, 78.0, 113.0, 163.0]) * (1 + 0.1 * theta[:, 1:2])
        )
        own = 1e-4 * force[:, :, None] * force[:, None, :] * (0.5 + 0.5 * np.eye(5))
        weights = np.cos(theta[:, 1:2] * np.arange(1, N_MODES + 1))
        return Prediction(force, own, weights, np.full(weights.shape, 1e-4))


def main() -> None:
    """Print one line a case."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    x, y = np.meshgrid((np.arange(35) + 0.5) / 7.0, (np.arange(24) + 0.5) * 2.5 / 24, indexing="ij")
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    rng = np.random.default_rng(1)
    noise = 0.01 * rng.standard_normal((5, len(points), 3))
    field = FieldData(points, noise, np.array([0.01, 0.01, 0.02]), 0.5, 0.5)
    data = replace(thesis_forces(), field=field)
    for name, (settings, unknown) in CASES.items():
        rate, first = speed(data, GivenModes(points), settings, unknown, rng)
        print(f"{name:<32} {rate:>10,.0f} a second, first call {first:.1f} s")


def speed(
    data: Dataset,
    forward: GivenModes,
    settings: NoiseSettings,
    unknown: dict[str, tuple[float, float]],
    rng: np.random.Generator,
) -> tuple[float, float]:
    """Log-probabilities a second, and the time to the end of the first call, s."""
    started = time.process_time()
    likelihood = build_likelihood(
        data,
        forward,  # type: ignore[arg-type]  # without derivatives, which are not asked for
        settings,
        force_discretisation=0.02,
        field_floor=0.003,
        unknown=unknown,
    )
    low = np.array([0.008, 0.0, 0.0, *(np.log(bounds[0]) for bounds in unknown.values())])
    high = np.array([0.02, 1.0, 0.5, *(np.log(bounds[1]) for bounds in unknown.values())])
    theta = low + (high - low) * rng.random((BATCH, low.size))
    likelihood.log_prob(theta)
    first, best = time.process_time() - started, np.inf
    for _ in range(30):
        begun = time.process_time()
        likelihood.log_prob(theta)
        best = min(best, time.process_time() - begun)
    return BATCH / best, first


if __name__ == "__main__":
    with threadpool_limits(limits=1):
        main()
