"""What is told where data and model get on badly: errors pulled far, few samples, fields."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_calib_study_summary import _summary as stuck_summary

from calib.data.thesis import thesis_forces
from calib.study.artifacts import NEEDED, StageRecord, write_record
from calib.study.config import Study, load_study
from calib.study.predictive_tables import CHECKS
from calib.study.prior_sections import ParameterPrior
from calib.study.remarks import (
    few_samples,
    odd_one_out,
    of_chains,
    pulled,
    unlike_field,
    unlike_forces,
)
from calib.study.summary import _with_checks, judgement_lines

ZERO = {"name": "zero of the travel", "unit": "mm", "prior_sd": 0.02, "mean": -0.051, "sd": 0.006}
SCALE = {"name": "scale of the field", "unit": "1", "prior_sd": 0.01, "mean": 0.024, "sd": 0.002}


def test_errors_of_the_test_that_go_far_from_what_was_said_of_them_are_told() -> None:
    [said] = pulled([ZERO, SCALE])
    assert said.startswith("the zero of the travel goes to -0.051 mm, 2.5 SDs of what was said")
    [said] = pulled([ZERO | {"mean": 0.01}, SCALE | {"mean": -0.03}])
    assert said.startswith("the scale of the field goes to -0.030, 3.0 SDs")


def test_chains_that_were_cut_or_have_strays_are_told() -> None:
    whole = {"status": "converged", "message": "kept 60 times"}
    alike = {"x": ["ln kappa", "r"], "chains_sd_ratio": [1.01, 0.95]}
    assert of_chains(whole, alike) == []
    cut = {"status": "max_steps", "message": "kept 19 times; stopped at max_steps"}
    assert of_chains(cut, alike) == [f"its chains were stopped early: {cut['message']}"]
    [said] = of_chains(whole, alike | {"chains_sd_ratio": [1.05, 0.88]})
    assert said.startswith("by its chains the SD of r is 0.88 times that of quadrature")


def test_single_forces_that_the_model_does_not_predict_are_told() -> None:
    good, odd = ({"p_value": p, "coverage": {"0.94": c}} for p, c in ((0.02, 0.0), (5e-4, 0.0)))
    found = {"travel": [0.6, 1.0], "hypotheses": {"sliding": {"force": [good, odd]}}}
    [said] = unlike_forces(found, "sliding")
    assert said == "by itself the force at 1 mm (p = 0.0005) is not what it predicts"
    assert unlike_forces(found, "stuck") == []


def test_a_force_that_the_others_speak_against_is_told() -> None:
    found = {
        "travel": [0.4, 0.6, 0.8],
        "hypotheses": {"stuck": {"force_left_out_p": [3e-3, 4e-2, 0.7]}, "sliding": {}},
    }
    [said] = odd_one_out(found, "stuck")
    assert said.startswith(
        "given the other forces, that at 0.4 mm is not what it predicts (p = 0.003)"
    )
    assert odd_one_out(found, "sliding") == []
    right = {
        "stuck": {"force_left_out_p": [4e-3, 0.04, 0.7]},
        "sliding": {"force_left_out_p": None},
    }
    assert odd_one_out(found | {"hypotheses": right}, "stuck") == []  # 0.01 / 3 is 0.0033
    assert odd_one_out(found | {"hypotheses": right}, "sliding") == []


@pytest.fixture
def study() -> Study:
    return load_study("thesis-forces")


def test_sds_of_few_samples_are_not_taken_as_known_in_silence(study) -> None:
    stuck, many = study.hypotheses[0], thesis_forces()
    few = replace(many, n_samples=3)
    assert few_samples(study, stuck, many) == []
    [said] = few_samples(study, stuck, few)
    assert "are of 3 samples and taken as known, where they are to 50%" in said
    assert "force_freedom = 2" in said
    allowing = replace(study, noise=replace(study.noise, force_freedom=2.0))
    assert few_samples(allowing, stuck, few) == []
    factor = ParameterPrior(distribution="lognormal", low=0.1, high=10.0, mean=1.0, sd=0.7)
    allowing = replace(study, prior=replace(study.prior, force_noise=factor))
    assert few_samples(allowing, stuck, few) == []
    assert few_samples(study, stuck, replace(many, n_samples=1)) == []
    for refusing in (
        replace(study, noise=replace(study.noise, discrepancy=0.05)),
        SimpleNamespace(
            noise=study.noise, prior=study.prior, data=SimpleNamespace(level="samples")
        ),
    ):
        [said] = few_samples(refusing, stuck, few)
        assert "intervals are too narrow" in said and "force_freedom" not in said
    measured = replace(few, force_covariance=np.diag(many.force_sd**2))
    assert few_samples(study, stuck, measured) == []


def checks(p: float, share: float) -> dict[str, object]:
    """Predictive checks of two regions at two travels, one part of which is as given."""
    good = {"p_value": 0.6, "coverage": {"0.94": 0.95}}
    odd = {"p_value": p, "coverage": {"0.94": share}}
    field = {"near pin": [[good, good, odd], [good] * 3], "edge": [[good] * 3, [good] * 3]}
    return {"travel": [0.6, 1.0], "hypotheses": {"sliding": {"field": field}, "stuck": {}}}


def test_parts_of_a_field_that_the_model_does_not_predict_are_told() -> None:
    [said] = unlike_field(checks(0.0025, 0.1), "sliding")
    assert "near pin, u_z at 0.6 mm has p = 0.0025 and 10% of its points" in said
    assert unlike_field(checks(0.0025, 0.6), "sliding") == []
    assert unlike_field(checks(0.02, 0.1), "sliding") == []
    assert unlike_field(checks(0.0025, 0.1), "stuck") == []


def test_the_field_s_checks_are_told_with_the_posterior_of_the_same_run_alone(tmp_path) -> None:
    (tmp_path / CHECKS).write_text(json.dumps(checks(0.0025, 0.1)))
    summary = replace(stuck_summary(), hypothesis="sliding", remarks=("first",))
    told = _with_checks(summary, tmp_path)
    assert told.remarks[0] == "first" and len(told.remarks) == 2
    assert f"LOOK AT  sliding: {told.remarks[1]}" in judgement_lines([told])
    for stage, data in (("predict", "a"), ("posterior", "b")):
        write_record(tmp_path, StageRecord(stage, "0", 0, {f"{NEEDED}data": data}, {}, 0.0))
    assert _with_checks(summary, tmp_path).remarks == ("first",)


def test_a_force_that_the_others_speak_against_reaches_the_summary(tmp_path) -> None:
    force = [
        {"p_value": 0.6, "coverage": {"0.94": 1.0}},
        {"p_value": 0.5, "coverage": {"0.94": 1.0}},
    ]
    own = {"force": force, "force_left_out_p": [0.4, 1e-4]}
    found = {"travel": [0.6, 0.8], "hypotheses": {"sliding": own}}
    (tmp_path / CHECKS).write_text(json.dumps(found))
    told = _with_checks(replace(stuck_summary(), hypothesis="sliding", remarks=()), tmp_path)
    assert "that at 0.8 mm is not what it predicts (p = 0.0001)" in told.remarks[0]
    own["force"][0] = {"p_value": 1e-3, "coverage": {"0.94": 0.0}}  # what the fit itself shows
    (tmp_path / CHECKS).write_text(json.dumps(found))
    told = _with_checks(replace(stuck_summary(), hypothesis="sliding", remarks=()), tmp_path)
    assert told.remarks == ("by itself the force at 0.6 mm (p = 0.001) is not what it predicts",)
