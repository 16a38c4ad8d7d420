"""Virtual experiments are noisy versions of the simulation, and say that they are synthetic."""

from __future__ import annotations

import numpy as np
import pytest
from analytic_models import TRAVEL, AnalyticBlock

from calib.virtual import VirtualNoise, virtual_experiment

THETA = np.array([0.03, 0.4, 0.1])
POINTS = np.random.default_rng(2).random((6, 2))


def test_mean_and_sd_are_those_of_the_noise_model() -> None:
    """Ten z scores below 5: false alarm 6e-6 (fixed seed)."""
    noise = VirtualNoise(n_samples=20_000)
    data = virtual_experiment(AnalyticBlock(), THETA, noise, np.random.default_rng(0))
    force = 0.03 * AnalyticBlock()(THETA[1:]).force
    sd = np.sqrt((0.09 * force) ** 2 + noise.load_cell_sd**2)
    assert np.abs(data.force_mean - force).max() < 5 * (sd / np.sqrt(20_000)).max()
    assert np.abs(data.force_sd / sd - 1).max() < 5 / np.sqrt(40_000)
    assert data.synthetic
    assert data.travel.tolist() == TRAVEL.tolist()


def test_same_generator_seed_gives_the_same_experiment() -> None:
    runs = [
        virtual_experiment(
            AnalyticBlock(points=POINTS),
            THETA,
            VirtualNoise(travel_zero_sd=0.02),
            np.random.default_rng(seed),
            points=POINTS,
        )
        for seed in (1, 1, 2)
    ]
    assert np.array_equal(runs[0].force_mean, runs[1].force_mean)
    assert runs[0].field is not None and runs[1].field is not None
    assert np.array_equal(runs[0].field.displacement, runs[1].field.displacement)
    assert not np.array_equal(runs[0].force_mean, runs[2].force_mean)


def test_field_noise_has_the_stated_sd() -> None:
    """Three component SDs over 400 experiments within 10 %: about 8 SD (fixed seed)."""
    rng = np.random.default_rng(3)
    noise = VirtualNoise(field_correlation_length=0.05)
    block = AnalyticBlock(points=POINTS)
    clean = block(THETA[1:]).displacement
    errors = []
    for _ in range(400):
        data = virtual_experiment(block, THETA, noise, rng, points=POINTS)
        assert data.field is not None
        errors.append(data.field.displacement - clean)
    found = np.std(np.array(errors), axis=(0, 1, 2))
    assert found == pytest.approx(np.array(noise.field_noise_std), rel=0.1)


def test_simulation_that_stops_is_refused_with_its_message() -> None:
    with pytest.raises(ValueError, match=r"stopped at 0 mm \(analytic\)"):
        virtual_experiment(
            AnalyticBlock(r_fails=0.1), THETA, VirtualNoise(), np.random.default_rng(0)
        )


@pytest.mark.parametrize(
    ("name", "value"), [("n_samples", 1), ("force_sd_share", 0.0), ("sample_correlation", 1.0)]
)
def test_impossible_noise_is_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        VirtualNoise(**{name: value})  # type: ignore[arg-type]
