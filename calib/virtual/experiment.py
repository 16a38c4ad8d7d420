"""A synthetic experiment: forces and front-face field of the FE model, with noise added."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.data.dataset import Dataset, FieldData
from calib.inference.field_noise import field_covariance
from calib.inference.noise import (
    LOAD_CELL_SD,
    NoiseSettings,
    between_sample_covariance,
    slope_matrix,
)
from fe.response import Array, Response, Status


@dataclass(frozen=True)
class VirtualNoise:
    """Errors of the virtual experiment. Raises ValueError when a value is impossible."""

    n_samples: int = 23
    force_sd_share: float = 0.09
    """SD of the force between samples, load cell left out, as a share of the force"""
    load_cell_sd: float = LOAD_CELL_SD
    """SD of the load cell's noise in one reading, N"""
    sample_correlation: float = 0.9
    """correlation of one sample's deviation between neighbouring increments"""
    travel_zero_sd: float = 0.0
    """SD of the error in the zero of the travel, one draw for the whole experiment, mm"""
    field_noise_std: tuple[float, float, float] = (0.005, 0.005, 0.01)
    """SD of the field's noise in x, y, z, mm"""
    field_correlation_length: float = 0.3
    """mm"""
    field_reference_share: float = 0.5

    def __post_init__(self) -> None:
        if self.n_samples < 2:
            raise ValueError(f"n_samples: an SD needs at least 2 samples, got {self.n_samples}")
        if not self.force_sd_share > 0:
            raise ValueError(f"force_sd_share: expected positive, got {self.force_sd_share}")
        NoiseSettings(self.load_cell_sd, self.sample_correlation, self.travel_zero_sd)
        std = self.field_noise_std
        if len(std) != 3 or not all(0.0 <= sd < math.inf for sd in std):
            raise ValueError(f"field_noise_std: expected three SDs of 0 or more, got {std}")
        length, share = self.field_correlation_length, self.field_reference_share
        if not 0.0 < length < math.inf:
            raise ValueError(f"field_correlation_length: expected positive, got {length}")
        if not 0.0 <= share < 1.0:
            raise ValueError(f"field_reference_share: expected a share in [0, 1), got {share}")


def virtual_experiment(
    simulate: Callable[[Array], Response],
    theta_true: Array,
    noise: VirtualNoise,
    rng: np.random.Generator,
    *,
    points: Array | None = None,
    name: str = "virtual",
) -> Dataset:
    """Simulate an experiment on `n_samples` samples with theta_true = (kappa [MPa], r, s).

    `simulate` should have a finer mesh than the model that is calibrated, so that the
    discretisation error is real. Every sample's forces are drawn, and the dataset holds their
    mean and their standard deviation (n - 1), as a laboratory would report. The field is given
    when `points` (n_point, 2) [mm] are. Raises ValueError when the simulation does not reach
    every travel.
    """
    response = simulate(np.asarray(theta_true[1:], dtype=np.float64))
    if response.status is not Status.CONVERGED or not np.all(np.isfinite(response.force)):
        raise ValueError(
            f"theta_true: the simulation stopped at {response.reached:g} mm "
            f"({response.message}); choose other constants or smaller increments"
        )
    shift = noise.travel_zero_sd * rng.standard_normal()
    slope = slope_matrix(response.travel)
    force = theta_true[0] * (response.force + shift * (slope @ response.force))
    samples = _samples(force, noise, rng)
    field = None
    if points is not None:
        moved = response.displacement + shift * np.tensordot(slope, response.displacement, axes=1)
        field = _field(moved, points, noise, rng)
    return Dataset(
        name=name,
        synthetic=True,
        travel=np.array(response.travel),
        force_mean=samples.mean(axis=0),
        force_sd=samples.std(axis=0, ddof=1),
        n_samples=noise.n_samples,
        field=field,
    )


def _samples(force: Array, noise: VirtualNoise, rng: np.random.Generator) -> Array:
    """(n_samples, n_step) forces of each sample, N, from the noise model of the likelihood."""
    own = noise.force_sd_share * force
    total = np.sqrt(own**2 + noise.load_cell_sd**2)
    covariance = between_sample_covariance(total, noise.load_cell_sd, noise.sample_correlation)
    factor = np.linalg.cholesky(covariance)
    return force + rng.standard_normal((noise.n_samples, force.size)) @ factor.T


def _field(
    displacement: Array, points: Array, noise: VirtualNoise, rng: np.random.Generator
) -> FieldData:
    clean = FieldData(
        points=points,
        displacement=displacement,
        noise_std=np.array(noise.field_noise_std),
        correlation_length=noise.field_correlation_length,
        reference_share=noise.field_reference_share,
    )
    error = field_covariance(clean).sample(rng, 1)[0]
    return FieldData(
        points=clean.points,
        displacement=displacement + error,
        noise_std=clean.noise_std,
        correlation_length=clean.correlation_length,
        reference_share=clean.reference_share,
    )
