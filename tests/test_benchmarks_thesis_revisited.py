"""Claims about the thesis from its printed numbers, and the stored answer of the notebook."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.thesis_claims import (
    _travel_with,
    elsewhere,
    implied_maxima,
    printed_scatter,
    published_theta,
    scatter_p_value,
)
from benchmarks.thesis_force_control import FARTHEST, FieldAtForces, published_at_forces
from benchmarks.thesis_hypotheses import READINGS, TRAVEL, design
from calib.data import thesis_forces
from calib.data.thesis.forces import SCALE
from calib.inference import theta_of_constants

ANSWER = Path(__file__).parent.parent / "docs" / "verification" / "thesis_revisited.json"


def test_maxima_are_rmse_over_percentage_of_section_5_5_4() -> None:
    found = implied_maxima()
    assert found["x"]["maximum_mm"] == pytest.approx(0.041 / 0.0722)
    assert found["y"]["maximum_mm"] == pytest.approx(0.108, abs=5e-4)
    low, high = found["z"]["by_rounding_mm"]
    assert low < 0.79 < high and high - low > 0.15  # 0.04 is printed with one digit


def test_table_5_3_has_one_sum_and_many_constants() -> None:
    found = printed_scatter()
    assert found["starts"] == [1, 2, 4, 6, 8]
    assert found["sd_ln_kappa_start"] > 20 * found["sd_ln_kappa_end"]
    assert found["sd_ln_C10_end"] > 4 * found["sd_ln_kappa_end"]
    low, high = found["sd_ln_kappa_end_90"]
    assert low < found["sd_ln_kappa_end"] < high
    slope, error = found["slope_of_end_on_start"]
    assert abs(slope - 1.0) > 50 * error


def test_scatter_p_value_is_uniform_for_equal_scatters_and_small_for_a_smaller_one() -> None:
    rng = np.random.default_rng(0)
    values = [
        scatter_p_value(np.exp(rng.normal(size=5)), np.exp(rng.normal(size=5))) for _ in range(400)
    ]
    assert np.mean(np.array(values) < 0.5) == pytest.approx(0.5, abs=5 * 0.025)
    assert scatter_p_value(np.exp(0.02 * rng.normal(size=5)), np.exp(rng.normal(size=5))) < 1e-4


def test_tension_of_section_5_6_moved_four_times_as_far_as_the_model() -> None:
    found = elsewhere()
    assert found["tension_motion_over_model"]["y"] == pytest.approx(4.0162)
    assert found["published_mu_MPa"] == pytest.approx(2 * published_theta()[0])


def test_travel_of_a_maximum() -> None:
    largest = np.outer([0.9, 1.1], TRAVEL)
    assert _travel_with(largest, 0.5) == pytest.approx(0.5, abs=2e-3)
    assert _travel_with(largest, 2.0) is None


RATIOS = np.array([0.4, 0.1])


class PowerLaw:
    """Forces 50 d^2, fields d times a shape: an emulator of which all is known."""

    stiffness = 50.0

    def unit_force(self, ratios: np.ndarray) -> tuple[np.ndarray, None]:
        return np.tile(self.stiffness * np.array(TRAVEL) ** 2, (len(ratios), 1)), None

    def displacement(self, ratios: np.ndarray) -> np.ndarray:
        shape = np.random.default_rng(1).random((1, 1, 7, 3))
        return np.array(TRAVEL)[None, :, None, None] * shape


class Stiffer(PowerLaw):
    stiffness = 200.0


class Trained:
    def __init__(self, emulator: PowerLaw | None = None) -> None:
        self.emulator = emulator or PowerLaw()


def test_four_times_the_force_is_one_error_at_four_times_the_stiffness() -> None:
    truth = theta_of_constants(0.008, 0.004, 0.001)
    observed = PowerLaw().displacement(truth[None, 1:])[0]
    force = 4.0 * truth[0] * PowerLaw().unit_force(truth[None, 1:])[0][0]
    objective = FieldAtForces(Trained(), observed, force)  # type: ignore[arg-type]
    scaled = np.array([0.008, 0.004, 0.001]) / SCALE
    assert objective(4.0 * scaled) == pytest.approx(0.0, abs=1e-12)
    assert objective(4.4 * scaled) > 0.01
    assert objective(3.6 * scaled) > 0.01
    # Too soft for the forces: beyond the travel to which the model is continued, a failed solve.
    assert np.isnan(objective(4.0 * scaled * (1.4 / FARTHEST) ** 2 / 1.1))
    assert np.isnan(objective(np.zeros(3)))


def test_travel_under_a_force_follows_the_power_law_beyond_the_increments() -> None:
    truth = theta_of_constants(0.008, 0.004, 0.001)
    wanted = np.array([0.3, 0.7, 1.0, 1.4, 1.9])
    objective = FieldAtForces(Trained(), np.zeros((5, 7, 3)), truth[0] * 50 * wanted**2)  # type: ignore[arg-type]
    assert objective.travel(truth) == pytest.approx(wanted, rel=1e-9)


def test_a_force_on_a_quarter_presses_twice_as_far_where_it_goes_as_travel_squared() -> None:
    found = published_at_forces(Trained(Stiffer()), {"x": 0.5, "z": 0.5}, RATIOS)  # type: ignore[arg-type]
    whole, quarter = found["whole"], found["quarter"]
    assert quarter["travel_mm"] == pytest.approx(2.0 * whole["travel_mm"])
    by_hand = np.sqrt(4.0 * thesis_forces().force_mean / (200.0 * published_theta()[0]))
    assert quarter["travel_mm"] == pytest.approx(by_hand, rel=1e-9)
    assert quarter["maxima_mm"]["x"] == pytest.approx(2.0 * whole["maxima_mm"]["x"])
    maxima = {axis: quarter["maxima_mm"][axis] for axis in ("x", "z")}
    exact = published_at_forces(Trained(Stiffer()), maxima, RATIOS)  # type: ignore[arg-type]
    assert exact["quarter"]["p_of_maxima"] == pytest.approx(1.0)
    assert exact["whole"]["p_of_maxima"] < 1e-6
    sample = PowerLaw().displacement(RATIOS[None])[0]
    pressed = sample * (by_hand / TRAVEL)[:, None, None]
    error = np.linalg.norm(pressed - sample, axis=-1).mean()
    assert quarter["mean_error_to_sample_mm"] == pytest.approx(error, rel=1e-6)


def test_readings_have_names_and_folders_of_their_own_and_one_design() -> None:
    assert len({r.name for r in READINGS}) == len({r.folder for r in READINGS}) == len(READINGS)
    ratios = design()
    assert ratios[:4].tolist() == [[0, 0], [0, 0.5], [1, 0], [1, 0.5]]
    assert np.all((ratios >= 0) & (ratios <= [1.0, 0.5]))


def test_the_stored_answer_is_complete_and_dated() -> None:
    stored = json.loads(ANSWER.read_text())
    assert stored["command"] == "python -m benchmarks.thesis_revisited"
    assert len(stored["date"]) == 10
    assert set(stored["readings"]) <= {r.name for r in READINGS} and len(stored["readings"]) >= 6
    total = sum(found["probability_by_forces"] for found in stored["readings"].values())
    assert total == pytest.approx(1.0)
    printed = printed_scatter()
    assert stored["table_5_3"]["sd_ln_kappa_end"] == pytest.approx(printed["sd_ln_kappa_end"])
