"""The summary: numbers of the draws, failures by name, the same table for readers and programs."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
import xarray as xr

from calib.inference.at_bound import AtBound
from calib.inference.convergence import Convergence
from calib.inference.coordinates import CONSTANTS
from calib.inference.verdict import NONE_EXPLAINS
from calib.study.summary import (
    Summary,
    format_table,
    leaning,
    summarise,
)
from calib.study.summary_files import to_csv, to_frame, to_json
from calib.study.summary_tables import constants_table, points_table

GOOD = Convergence(ess_bulk=2000.0, ess_tail=1500.0, r_hat=1.001)
POINT = {"C10": 0.008, "C01": 0.004, "C11": 0.001, "mu": 0.024}


def _provenance(**changes: object) -> dict[str, object]:
    maximum = {
        "emulator": POINT,
        "fe": {name: 1.01 * value for name, value in POINT.items()},
        "difference_sd": dict.fromkeys(CONSTANTS, 0.1),
        "difference_sd_x": [0.1, -0.15, 0.0],
        "foretold_sd_x": [0.1, -0.15, 0.0],
        "converged": True,
        "n_fe_solves": 3,
        "message": "converged after 3 direct simulations",
    }
    hypothesis = {"map": maximum, "emulator": {}, "emulator_failures": [], "sampling": {}}
    return {
        "study": "synthetic-study",
        "seed": 3,
        "version": "0.1.0",
        "synthetic": True,
        "published": None,
        "truth": POINT,
        "truth_hypothesis": "stuck",
        "limits": {"max_r_hat": 1.01, "min_ess": 400.0},
        "hypotheses": {"stuck": hypothesis | changes},
    }


def _draws() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(17)
    return {name: value * (1 + 0.1 * rng.standard_normal(5000)) for name, value in POINT.items()}


def test_programs_are_told_whether_the_maximum_is_verified() -> None:
    [found] = json.loads(to_json([_summary()]))
    assert found["diagnostics"]["map"]["verified"] is True
    assert found["diagnostics"]["map"]["difference_sd"] == 0.15
    [found] = json.loads(to_json([_apart()]))
    assert found["diagnostics"]["map"]["verified"] is False and found["passed"] is True


def test_a_maximum_that_is_not_verified_is_told_below_the_tables() -> None:
    said = format_table([_apart()])
    assert "NOT VERIFIED  stuck: direct FE does not confirm the emulator's maximum within" in said
    assert "they lie 0.3 SD apart" in said and "All diagnostics are within" not in said
    assert "NOT VERIFIED" not in format_table([_summary()])


def _apart() -> Summary:
    [maximum] = (facts["map"] for facts in _provenance()["hypotheses"].values())
    return _summary(map=maximum | {"foretold_sd_x": [0.1, -0.3, 0.0]})


def _summary(found: Convergence = GOOD, **changes: object) -> Summary:
    provenance = _provenance(**changes)
    return summarise("stuck", _draws(), dict.fromkeys(CONSTANTS, found), provenance)


def test_mean_sd_and_interval_are_those_of_the_draws() -> None:
    summary, draws = _summary(), _draws()
    for name, constant in summary.constants.items():
        assert constant.mean == pytest.approx(draws[name].mean())
        assert constant.sd == pytest.approx(draws[name].std(ddof=1))
        inside = (draws[name] >= constant.hdi_low) & (draws[name] <= constant.hdi_high)
        assert inside.mean() == pytest.approx(0.94, abs=0.001)


def test_good_diagnostics_pass() -> None:
    assert _summary().passed and _summary().failures == ()


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (replace(GOOD, r_hat=1.2), "C10: R-hat is 1.2000, above 1.01"),
        (replace(GOOD, ess_bulk=100.0), "C10: ESS (bulk) is 100, below 400"),
        (replace(GOOD, ess_tail=5.0), "C10: ESS (tail) is 5, below 400"),
        (replace(GOOD, r_hat=float("nan")), "C10: R-hat is nan, above 1.01"),
    ],
)
def test_each_rule_of_convergence_is_named_when_violated(found: Convergence, expected: str) -> None:
    summary = _summary(found)
    assert not summary.passed and expected in summary.failures


def test_an_emulator_outside_its_stated_error_fails() -> None:
    summary = _summary(emulator_failures=["emulator: held-out force error is 0.1, above 0.02"])
    assert summary.failures == ("emulator: held-out force error is 0.1, above 0.02",)


def test_a_posterior_far_from_the_last_check_of_its_mesh_is_told_and_passes() -> None:
    said = "Its mesh was last checked at s = 0.1, 0.02 from the posterior mean: more than 3 SDs"
    summary = _summary(mesh_remark=said)
    assert summary.passed and said in points_table(summary).note
    assert said not in points_table(_summary()).note


def test_a_search_without_a_solve_fails_and_leaves_gaps_not_numbers() -> None:
    nothing = {
        "emulator": POINT,
        "fe": None,
        "difference_sd": None,
        "difference_sd_x": [None, None, None],
        "foretold_sd_x": [None, None, None],
        "converged": False,
        "n_fe_solves": 12,
        "message": "no direct simulation succeeded in 12",
    }
    summary = _summary(map=nothing)
    assert not summary.passed and "no direct simulation succeeded" in summary.failures[0]
    assert json.loads(to_json([summary]))[0]["constants"]["C10"]["map_fe"] is None
    assert "nan" not in points_table(summary).text()


def test_json_is_a_list_with_one_object_for_each_hypothesis() -> None:
    [found] = json.loads(to_json([_summary()]))
    assert found["interval"] == "94% HDI" and found["passed"] is True and found["failures"] == []
    expected = (
        "unit mean sd hdi_low hdi_high ess_bulk ess_tail r_hat map_emulator map_fe "
        "map_difference_sd published published_z"
    )
    assert list(found["constants"]["mu"]) == expected.split()


def test_json_holds_no_number_that_json_does_not_know() -> None:
    text = to_json([_summary(replace(GOOD, r_hat=float("nan")))])
    assert "NaN" not in text and json.loads(text)[0]["constants"]["C10"]["r_hat"] is None


def test_a_posterior_that_leans_on_a_bound_is_flagged_where_sds_are_counted() -> None:
    leaning = (AtBound("r", "low", 0.0, 0.9),)
    provenance = _provenance() | {"published": {name: 10 * v for name, v in POINT.items()}}
    draws, good = _draws(), dict.fromkeys(CONSTANTS, GOOD)
    summary = summarise("stuck", draws, good, provenance, leaning)
    assert "say little about distance" in points_table(summary).note
    [found] = json.loads(to_json([summary]))
    assert found["at_bound"] == [
        {"parameter": "r", "side": "low", "value": 0.0, "density_ratio": 0.9}
    ]
    free = summarise("stuck", draws, good, provenance)
    assert "leans" not in points_table(free).note
    assert json.loads(to_json([free]))[0]["at_bound"] == []


def test_bounds_of_constants_that_a_posterior_states_are_those_it_can_lean_on() -> None:
    """C10 begins at its lower bound, which cuts kappa and r nowhere."""
    rng = np.random.default_rng(12)
    c10, c01 = 0.001 + rng.exponential(5e-4, 8000), rng.normal(0.006, 4e-4, 8000)
    draws = {"kappa": c10 + c01, "r": c01 / (c10 + c01), "s": rng.normal(0.1, 0.005, 8000)}
    posterior = xr.Dataset({name: (("chain", "draw"), x[None]) for name, x in draws.items()})
    posterior["hypothesis"] = "stuck"
    facts = {"bounds": [[np.log(1e-4), 0.0], [0.0, 1.0], [0.0, 0.5]]}
    stated = {"constant_bounds": [[0.001, 0.02], [0.0, 0.02], [0.0, 0.004]]}
    assert leaning(posterior, {"hypotheses": {"stuck": facts}}) == ()
    [found] = leaning(posterior, {"hypotheses": {"stuck": facts | stated}})
    assert (found.parameter, found.side, found.value) == ("C10", "low", 0.001)


def test_csv_reads_back_with_one_line_for_each_constant() -> None:
    lines = list(csv.DictReader(StringIO(to_csv([_summary()]))))
    assert [line["constant"] for line in lines] == list(CONSTANTS)
    means = [float(line["mean"]) for line in lines]
    assert means == [c.mean for c in _summary().constants.values()]


def test_published_constants_are_measured_in_posterior_sds() -> None:
    provenance = _provenance() | {"published": {name: 10 * v for name, v in POINT.items()}}
    summary = summarise("stuck", _draws(), dict.fromkeys(CONSTANTS, GOOD), provenance)
    for name, constant in summary.constants.items():
        expected = (10 * POINT[name] - constant.mean) / constant.sd
        assert constant.published_z == pytest.approx(expected)
    assert "published" in points_table(summary).columns


def test_synthetic_data_are_called_so_and_the_truth_stands_beside_the_posterior() -> None:
    summary = _summary()
    table = constants_table(summary, summary.truth)
    assert "SYNTHETIC" in table.title and "synthetic truth" in table.columns
    assert all(row[-1] == "yes" for row in table.rows)
    assert "SYNTHETIC" in format_table([summary])


def test_the_truth_is_not_shown_beside_a_hypothesis_that_did_not_make_the_data() -> None:
    provenance = _provenance() | {"truth_hypothesis": "sliding"}
    assert summarise("stuck", _draws(), dict.fromkeys(CONSTANTS, GOOD), provenance).truth is None


def test_forces_that_no_hypothesis_explains_are_told_though_the_computation_is_good() -> None:
    """As forces in mN: constants at the prior's bound, sampled well."""
    wrong = _summary(predictive_p=1e-200)
    assert wrong.contradicted and wrong.passed
    said = format_table([wrong])
    assert "CONTRADICTED  stuck: the forces lie outside what it can explain" in said
    assert NONE_EXPLAINS in said
    both = format_table([wrong, _summary(predictive_p=0.4)])
    assert "CONTRADICTED  stuck" in both and NONE_EXPLAINS not in both
    assert "CONTRADICTED" not in format_table([_summary()])  # of a posterior that holds no p
    assert json.loads(to_json([wrong]))[0]["predictive_p"] == 1e-200
    assert to_frame([wrong])["predictive_p"].tolist() == [1e-200] * len(wrong.constants)


def test_the_printed_table_names_what_failed() -> None:
    assert "FAILED  stuck: C10: R-hat" in format_table([_summary(replace(GOOD, r_hat=2.0))])
    assert "All diagnostics are within" in format_table([_summary()])
