"""Tables and verdicts of a validation."""

from __future__ import annotations

from typing import Any

import pytest

from calib.study.validation_tables import validation_tables, verdicts


def _found(error: float, error_sd: float | None, r2: float = 0.97) -> dict[str, Any]:
    passed = error < 0.1 and r2 >= 0.95
    quantity = {
        "error": error,
        "error_sd": error_sd,
        "error_by_step": [error],
        "ratio": 1.0,
        "r2": r2,
        "r2_sd": 0.002,
        "r2_of_noise": 0.99,
        "correlation": 0.99,
        "coverage": {"0.94": 1.0},
        "area": 0.01,
        "area_by_step": [0.01],
        "pooled_area": 0.1,
        "passed": passed,
    }
    one = {"quantities": {"answer": quantity}, "judged": ["answer"], "passed": passed}
    return {
        "predictions": {"stuck": one},
        "requirement": {"max_error": 0.1, "min_r2": 0.95},
        "quantity": "travel [mm]",
        "data": "plate",
        "synthetic": True,
        "n_samples": 3,
        "control": "force",
        "levels": [1.0],
    }


@pytest.mark.parametrize(
    ("error", "r2", "told"),
    [
        (0.093, 0.97, "its error is 0.7 % from the limit of 10 %, less than two Monte Carlo SDs"),
        (0.107, 0.97, "its error is 0.7 % from the limit of 10 %"),
        (0.05, 0.953, "its R2 is 0.003 from the limit of 0.95, less than two Monte Carlo SDs"),
        (0.091, 0.97, None),
        (0.098, 0.90, None),  # the other fails, whatever draws say
        (0.13, 0.951, None),
    ],
)
def test_a_verdict_that_other_draws_might_turn_is_told(
    error: float, r2: float, told: str | None
) -> None:
    lines = verdicts(_found(error, 0.004, r2))
    assert lines[0].startswith("PASS" if error < 0.1 and r2 >= 0.95 else "FAIL (answer)")
    assert len(lines) == (1 if told is None else 2)
    assert told is None or told in lines[1]


@pytest.mark.parametrize(("error_sd", "shown"), [(0.004, "9.30 (0.4)"), (None, "9.30")])
def test_the_error_stands_with_its_monte_carlo_sd(error_sd: float | None, shown: str) -> None:
    table, _ = validation_tables(_found(0.093, error_sd))
    assert table.rows[0][2] == shown


def test_a_file_of_before_that_has_no_sd_is_shown_without() -> None:
    found = _found(0.093, None)
    del found["predictions"]["stuck"]["quantities"]["answer"]["error_sd"]
    assert len(verdicts(found)) == 1
    assert validation_tables(found)[0].rows[0][2] == "9.30"


def test_a_component_that_is_zero_throughout_has_no_error() -> None:
    found = _found(0.093, None)
    quantity = found["predictions"]["stuck"]["quantities"]["answer"]
    quantity |= {"error": None, "r2": None, "error_by_step": [None], "passed": False}
    [line] = verdicts(found)
    assert "answer - %, R2 -" in line
    overall, by_step = validation_tables(found)
    assert overall.rows[0][2] == "-" and by_step.rows[0][2].startswith("- (")
