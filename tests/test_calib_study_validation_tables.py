"""Tables and verdicts of a validation."""

from __future__ import annotations

from typing import Any

import pytest

from calib.study.validation_tables import validation_tables, verdicts


def _found(error: float, error_sd: float | None) -> dict[str, Any]:
    quantity = {
        "error": error,
        "error_sd": error_sd,
        "error_by_step": [error],
        "ratio": 1.0,
        "r2": 0.97,
        "r2_of_noise": 0.99,
        "correlation": 0.99,
        "coverage": {"0.94": 1.0},
        "area": 0.01,
        "area_by_step": [0.01],
        "pooled_area": 0.1,
        "passed": error < 0.1,
    }
    one = {"quantities": {"answer": quantity}, "judged": ["answer"], "passed": True, "n_draws": 24}
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


@pytest.mark.parametrize(("error", "told"), [(0.093, True), (0.107, True), (0.091, False)])
def test_a_verdict_that_other_draws_might_turn_is_told(error: float, told: bool) -> None:
    lines = verdicts(_found(error, 0.004))
    assert (len(lines) == 2) is told
    if told:
        assert "LOOK AT  answer: 24 draws know the error to 0.4 % (SD)" in lines[1]


@pytest.mark.parametrize(("error_sd", "shown"), [(0.004, "9.30 (0.4)"), (None, "9.30")])
def test_the_error_stands_with_its_monte_carlo_sd(error_sd: float | None, shown: str) -> None:
    table, _ = validation_tables(_found(0.093, error_sd))
    assert table.rows[0][2] == shown


def test_a_file_of_before_that_has_no_sd_is_shown_without() -> None:
    found = _found(0.093, None)
    del found["predictions"]["stuck"]["quantities"]["answer"]["error_sd"]
    assert len(verdicts(found)) == 1
    assert validation_tables(found)[0].rows[0][2] == "9.30"
