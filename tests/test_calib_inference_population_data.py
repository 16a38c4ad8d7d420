"""What is kept of a population: the force of a new sample."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from calib.inference import NoiseSettings
from calib.inference.population_data import _force_of_new
from calib.inference.sample_errors import SampleErrors
from fe.response import Array

FORCE, MOVED = np.array([1.0, 2.0, 4.0]), np.array([0.3, -0.2, 0.1])
SLOPE = np.array([[2.0, 1.0, 0.0], [0.0, 3.0, 0.5], [-1.0, 0.0, 2.0]])
"""d force / d travel is this times the forces"""


def _forces(theta: Array, z: Array) -> tuple[Array, Array]:
    return np.broadcast_to(FORCE, (len(theta), 3)), z @ MOVED[None, :]


def test_the_force_of_a_new_sample_has_the_common_errors_its_zero_and_the_load_cell() -> None:
    """Moments of 200000 draws within 5 of their standard errors: false alarm 1e-5 (fixed seed)."""
    samples = SimpleNamespace(forces=_forces, errors=SimpleNamespace(slope=SLOPE))
    posterior = cast("Any", SimpleNamespace(samples=samples))
    n = 200_000
    z = np.full((n, 1), 2.0)
    errors = NoiseSettings(load_cell_sd=0.05), SampleErrors(travel_zero_sd=0.02)
    force = _force_of_new(posterior, np.zeros((n, 3)), z, errors, np.random.default_rng(0))

    along = 0.02 * SLOPE @ FORCE
    expected = np.outer(along, along) + 0.05**2 * np.eye(3)
    sd = np.sqrt(np.diag(expected))
    assert (np.abs(force.mean(axis=0) - FORCE - 2.0 * MOVED) < 5.0 * sd / np.sqrt(n)).all()
    error = np.sqrt((expected**2 + np.outer(sd, sd) ** 2) / n)
    assert (np.abs(np.cov(force.T) - expected) < 5.0 * error).all()
