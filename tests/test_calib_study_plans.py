"""Experiments that a study may be followed by: which blocks are tried beside its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from calib.data.dataset import Dataset
from calib.inference.field_floor import FieldFloor
from calib.inference.noise import NoiseSettings
from calib.inference.planned import FirstOrderForward
from calib.inference.tangent_errors import Mistaken
from calib.study.config import load_study
from calib.study.context import Context, block_pin_model
from calib.study.design_next import _between, _draws, _least_sd, _left_out
from calib.study.plans import (
    Errors,
    _other_blocks,
    _solved,
    by_emulator,
    by_runs,
    planned_likelihood,
)
from calib.study.views import Run, Seen
from calib.study.views_file import kept_run
from fe import BlockPin, BlockPinModel, Contact
from fe.executors import serial_map


@pytest.mark.parametrize(
    ("pin_width", "fillet", "width", "expected"),
    [
        (4.0, 0.3, 10.0, ["3", "5"]),
        (1.0, 0.3, 10.0, ["0.75", "1.25"]),
        (1.0, 0.45, 10.0, ["1.25"]),  # two fillets leave no flat on a narrower one
        (3.5, 0.3, 4.0, ["2.62"]),  # a wider one would be wider than the block
    ],
)
def test_other_pins_are_narrower_and_wider_by_a_quarter_as_far_as_they_can_be(
    pin_width: float, fillet: float, width: float, expected: list[str]
) -> None:
    block = BlockPin(width=width, pin_width=pin_width, pin_fillet=fillet)
    found = dict(_other_blocks(BlockPinModel(block, Contact("stick", "stick"), (4, 2, 1), (0.5,))))
    pins = [name for name in found if name.startswith("pin")]
    assert pins == [f"pin {size} mm wide" for size in expected]
    for name in pins:
        assert found[name].specimen.pin_width == pytest.approx(float(name.split()[1]), abs=0.01)
    assert len(found) == len(pins) + 2


TRAVEL, FORCE = np.array([0.6, 1.0, 1.4]), np.array([0.5, 1.1, 2.0])
POINTS = np.array([[0.0, 0.5], [1.0, 1.5], [2.0, 2.0], [3.0, 1.0]])
MEASURED = np.outer(FORCE, FORCE) * (
    0.05**2 * np.array([[1, 0.9, 0.2], [0.9, 1, 0.5], [0.2, 0.5, 1]])
)


def forward() -> FirstOrderForward:
    """Random forces and fields, linear in two ratios."""
    rng = np.random.default_rng(5)
    field, slope = rng.normal(size=(3, 4, 3)), rng.normal(size=(3, 4, 3, 2))
    return FirstOrderForward(np.array([0.3, 0.1]), FORCE, rng.normal(size=(3, 2)), field, slope)


def errors(load_cell_sd: float) -> Errors:
    """Of twenty samples whose forces and fields differ as measured."""
    data = Dataset(
        "measured", False, TRAVEL, FORCE, np.sqrt(np.diag(MEASURED)), 20, force_covariance=MEASURED
    )
    between = _between(data, load_cell_sd)
    assert between is not None
    return Errors(
        own_share=np.full(3, 0.05),
        noise=NoiseSettings(load_cell_sd=load_cell_sd),
        n_samples=20,
        discretisation=np.zeros(3),
        floor=FieldFloor(np.zeros((3, 3))),
        mistaken=Mistaken(np.zeros(2), (), np.zeros((0, 0)), np.array([[0.0, 1.0], [0.0, 0.5]])),
        noise_std=np.full(3, 0.01),
        length=0.5,
        reference_share=0.5,
        nugget=1e-6,
        between=between,
        directions=np.random.default_rng(6).normal(size=(2, 3, 4, 3)),
    )


@pytest.mark.parametrize("load_cell_sd", [0.0, 0.005, 0.007])
def test_the_same_again_has_the_measured_errors_of_samples(load_cell_sd: float) -> None:
    theta, found = np.array([1.0, 0.3, 0.1]), errors(load_cell_sd)
    planned = planned_likelihood(forward(), TRAVEL, POINTS, found, theta)
    # 20 samples at 3 increments: the mean is t-distributed (`mean_covariance`)
    expected = MEASURED / 20 * 19 / 15
    np.testing.assert_allclose(planned.errors.mean, expected, rtol=1e-5)
    assert planned.field is not None and found.directions is not None
    np.testing.assert_allclose(planned.field.covariance.patterns[:2], found.directions)


def test_plans_change_what_they_say_of_samples_and_load_cell() -> None:
    theta, found = np.array([1.0, 0.3, 0.1]), errors(0.005)
    plans = {p.name: p.likelihood for p in by_emulator(forward(), TRAVEL, POINTS, found, theta)}
    better = plans["load cell noise / 10"].errors.mean * 20 * 15 / 19
    np.testing.assert_allclose(better, MEASURED - 0.99 * 0.005**2 * np.eye(3), rtol=1e-5)
    more = plans["4 times the samples"]  # what is known of the covariance is by the twenty
    np.testing.assert_allclose(more.errors.mean, MEASURED / 80 * 19 / 15, rtol=1e-5)
    assert more.field is not None and found.directions is not None
    np.testing.assert_allclose(more.field.covariance.patterns[:2], found.directions / 2)
    assert more.field.covariance.noise_variance == pytest.approx((found.noise_std / 2) ** 2)
    alone = plans["only 1 mm"].errors.mean  # t-distributed with 17 degrees of freedom, not 15
    np.testing.assert_allclose(np.diag(alone), np.diag(MEASURED) / 20 * 19 / 17, rtol=1e-5)


def test_a_load_cell_said_to_be_noisier_than_the_samples_is_as_noisy_as_they_allow() -> None:
    sd = np.sqrt(np.diag(MEASURED))
    data = Dataset("measured", False, TRAVEL, FORCE, sd, 20, force_covariance=MEASURED)
    least = _least_sd(data)
    assert least == pytest.approx(np.sqrt(np.linalg.eigvalsh(MEASURED)[0])) and least < 0.5 * sd[0]
    between = _between(data, 0.99 * least)
    assert between is not None and np.linalg.eigvalsh(between).min() > 0
    assert _least_sd(replace(data, force_covariance=None)) == sd[0]


def test_plans_by_fe_runs_see_points_at_which_samples_were_not_compared(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    rng = np.random.default_rng(7)
    gradient = rng.normal(size=(3, 4, 3, 2))
    seen = Seen(POINTS, rng.normal(size=(3, 4, 3)), gradient)
    run = Run(
        np.array([0.3, 0.1]), TRAVEL, FORCE, rng.normal(size=(3, 2)), {"front": seen, "side": seen}
    )
    monkeypatch.setattr("calib.study.plans._solved", lambda *_: run)
    study, theta = load_study("virtual"), np.array([1.0, 0.3, 0.1])
    plans = list(by_runs(study, study.hypotheses[0], errors(0.005), theta, print, tmp_path))
    assert "front camera, by one FE run" in [plan.name for plan in plans]
    for plan in plans:
        assert plan.likelihood.field is not None
        assert len(plan.likelihood.field.covariance.patterns) == 2  # of the ratios alone
    np.testing.assert_allclose(plans[0].likelihood.errors.mean, MEASURED / 20 * 19 / 15, rtol=1e-5)


def test_plans_by_fe_runs_have_the_same_mesh_error_at_all_points(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """They see three points, the study four; without its profile the floor is of its size."""
    rng = np.random.default_rng(7)
    seen = Seen(POINTS[:3], rng.normal(size=(3, 3, 3)), rng.normal(size=(3, 3, 3, 2)))
    faces = {"front": seen, "side": seen}
    run = Run(np.array([0.3, 0.1]), TRAVEL, FORCE, rng.normal(size=(3, 2)), faces)
    monkeypatch.setattr("calib.study.plans._solved", lambda *_: run)
    floor = FieldFloor(np.full((3, 3), 0.01), np.array([0.5, 0.5, 1.0, 1.6]))
    study, found = load_study("virtual"), replace(errors(0.005), floor=floor)
    plans = by_runs(study, study.hypotheses[0], found, np.array([1.0, 0.3, 0.1]), print, tmp_path)
    sizes = {}
    for plan in plans:
        assert plan.likelihood.field is not None
        sizes[plan.name] = plan.likelihood.field.covariance.floor[0, 0, 0]
    assert sizes["front camera, by one FE run"] == pytest.approx(1e-4)
    assert sizes["4 mm sample, camera as before"] == pytest.approx(0.4**2 * 1e-4)
    assert _left_out(found) == [
        "where on the face the mesh errs",
        "the directions in which the fields of the samples differ",
    ]
    assert _left_out(replace(found, floor=floor.even, directions=None)) == []


def test_fe_runs_of_plans_are_kept_by_model_and_ratios(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    model = BlockPinModel(BlockPin(), Contact("slide", "slide"), (2, 1, 1), (0.1,))
    theta, said = np.array([1.0, 0.3, 0.1]), []
    first = _solved("a", model, theta, said.append, tmp_path)
    assert first is not None and said == ["FE run     a"]
    monkeypatch.setattr(
        "calib.study.plans.run_with_views", lambda *_: pytest.fail("is kept, and solved again")
    )
    again = _solved("a", model, theta, said.append, tmp_path)
    assert again is not None and said[-1] == "FE run     a (kept)"
    for name in Run._fields[:-1]:
        np.testing.assert_array_equal(getattr(again, name), getattr(first, name))
    for face, seen in first.faces.items():
        for ours, theirs in zip(again.faces[face], seen, strict=True):
            np.testing.assert_array_equal(ours, theirs)
    higher = replace(model, specimen=BlockPin(height=2.6))
    assert kept_run(tmp_path, higher, theta[1:]) is None
    assert kept_run(tmp_path, model, theta[1:] + 1e-9) is None
    [path] = tmp_path.iterdir()
    path.write_bytes(b"cut")
    with pytest.raises(ValueError, match=f"{path}: found no whole FE run in it; delete it and ask"):
        kept_run(tmp_path, model, theta[1:])


def test_draws_of_a_plan_are_worth_what_their_chain_is(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    study = load_study("virtual")
    times = np.array([[20.0, 25.0], [22.0, 24.0]])  # (ensemble, coordinate), steps
    result = SimpleNamespace(draws=np.zeros((5000, 2)), autocorrelation_time=times)
    monkeypatch.setattr(
        "calib.study.design_next.load_samples", lambda *_: SimpleNamespace(result=result)
    )
    context = Context(study, tmp_path, block_pin_model, serial_map, print, show_progress=False)
    draws, chain = _draws(context, study.hypotheses[0])
    assert draws.shape == (4500, 2) and chain == pytest.approx(200.0)
