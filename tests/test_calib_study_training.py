"""What emulators of a study learn from: complete runs and their derivatives, by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from analytic_block import AnalyticBlock, analytic_block

from calib.data import FieldData, thesis_forces
from calib.study.config import Study, load_study
from calib.study.context import Context
from calib.study.judgement import measurement_noise
from calib.study.sections import Cells, Hypothesis
from calib.study.stages import run_stages
from calib.study.train_stage import FIRST, load_diagnostics, load_emulator, load_maps
from calib.study.training_runs import SAME_POINT, held_out_set, partial_runs, rows, training_set
from calib.study.unknowns import design_points
from fe.campaign import CampaignFailed
from fe.campaign_result import Campaign
from fe.executors import serial_map
from fe.response import Array, Response, Status
from surrogate import Emulator

STUDY = load_study("thesis-forces")
HYPOTHESIS = STUDY.hypotheses[0]


def block(stops_above: float = np.inf) -> AnalyticBlock:
    model = analytic_block(STUDY, HYPOTHESIS, STUDY.mesh.sampling)
    return replace(model, stops_above=stops_above)


def campaign(ratios: Array, model: AnalyticBlock | None = None) -> Campaign:
    simulate = model or block()
    return Campaign(ratios, tuple(simulate(row) for row in ratios), n_reused=0)


def altered(found: Campaign, row: int, change: dict[str, object]) -> Campaign:
    responses: list[Response] = list(found.responses)
    responses[row] = replace(responses[row], **change)  # type: ignore[arg-type]
    return Campaign(found.theta, tuple(responses), n_reused=0)


def ratios(n: int = 12) -> Array:
    return design_points(STUDY, STUDY.hypotheses[0])[:n]


def test_the_derivatives_of_every_run_reach_the_emulator() -> None:
    found = campaign(ratios())
    training = training_set([found], gradients=True)
    assert training.force_gradient is not None and training.displacement_gradient is not None
    step = 1e-6
    for axis in range(2):
        shift = step * np.eye(2)[axis]
        up, down = campaign(ratios() + shift), campaign(ratios() - shift)
        by_difference = (up.force - down.force) / (2 * step)
        np.testing.assert_allclose(training.force_gradient[..., axis], by_difference, rtol=1e-6)
        field = (up.displacement - down.displacement) / (2 * step)
        np.testing.assert_allclose(training.displacement_gradient[..., axis], field, atol=1e-8)


def test_without_the_switch_no_derivative_does() -> None:
    training = training_set([campaign(ratios())], gradients=False)
    assert training.force_gradient is None and training.displacement_gradient is None


def test_an_unstable_run_teaches_by_its_values_alone() -> None:
    pivots = np.array([0, 0, 0, 1, 0])
    found = altered(campaign(ratios()), 3, {"negative_pivots": pivots})
    training = training_set([found], gradients=True)
    assert training.force_gradient is not None
    usable = np.isfinite(training.force_gradient).all(axis=(1, 2))
    assert usable.tolist() == [row != 3 for row in range(12)]
    np.testing.assert_array_equal(training.force, found.force)


def test_a_parameter_that_a_run_has_no_derivative_by_is_left_open() -> None:
    whole = campaign(ratios())
    only_s = {
        "parameters": ("s",),
        "force_gradient": whole.responses[2].force_gradient[:, 1:],
        "displacement_gradient": whole.responses[2].displacement_gradient[..., 1:],
    }
    training = training_set([altered(whole, 2, only_s)], gradients=True)
    assert training.force_gradient is not None
    np.testing.assert_array_equal(training.force_gradient[2, :, 1], whole.force_gradient[2, :, 1])
    assert np.isnan(training.force_gradient[2, :, 0]).all()


@pytest.mark.lasting
def test_with_derivatives_fewer_runs_do() -> None:
    held_out = held_out_set(campaign(np.random.default_rng(0).uniform(0.02, 0.48, (12, 2))))
    assert held_out is not None

    def error(n: int, gradients: bool) -> float:
        training = training_set([campaign(ratios(n))], gradients=gradients)
        mean, _ = Emulator.fit(training, 1).unit_force(held_out.ratios)
        return float(np.sqrt(np.mean((mean / held_out.force - 1.0) ** 2)))

    assert error(6, True) < 0.2 * error(6, False)
    assert error(8, True) < error(12, False)


def test_runs_at_the_same_place_count_once() -> None:
    first = campaign(ratios())
    extent = np.ptp(first.theta, axis=0)
    near = first.theta[4] + 0.5 * SAME_POINT * extent
    apart = first.theta[4] + 3.0 * SAME_POINT * extent
    training = training_set([first, campaign(np.array([near, apart]))], gradients=True)
    np.testing.assert_array_equal(training.ratios, [*first.theta, apart])
    np.testing.assert_array_equal(training.force[-1], block()(apart).force)
    assert training.force_gradient is not None
    np.testing.assert_array_equal(training.force_gradient[-1], block()(apart).force_gradient)


def test_runs_that_ended_early_are_counted_and_judge_as_far_as_they_went() -> None:
    top = float(ratios(12)[:, 1].max())
    found = campaign(ratios(12), block(stops_above=0.999 * top))
    n_early = int((~found.reached).sum())
    assert 0 < n_early < 12
    training = training_set([found], gradients=True)
    assert training.n_excluded == n_early and len(training.ratios) == 12 - n_early
    assert training.partial is not None
    np.testing.assert_array_equal(training.partial.force[:, 0], found.force[~found.reached, 0])
    assert not np.isfinite(training.partial.force[:, 1:]).any()
    emulator = Emulator.fit(training, 1)
    early = partial_runs(emulator, [rows(found, slice(6)), rows(found, slice(6, None))])
    np.testing.assert_array_equal(early.ratios, found.theta[~found.reached])
    # They are good at the first of five travels.
    assert np.isfinite(early.relative).tolist() == [[True, *[False] * 4]] * n_early
    mean, covariance = emulator.by_complete_runs.unit_force(early.ratios)
    truth = np.array([block()(row).force[0] for row in early.ratios])
    np.testing.assert_allclose(early.relative[:, 0], mean[:, 0] / truth - 1.0, rtol=1e-9)
    z = (mean[:, 0] - truth) / np.sqrt(covariance[:, 0, 0])
    np.testing.assert_allclose(early.standardised[:, 0], z)
    assert (early.reached == STUDY.increments[0]).all()
    assert early.field_rms is not None
    field = emulator.by_complete_runs.displacement(early.ratios)[:, 0]
    off = field - found.displacement[~found.reached, 0]
    np.testing.assert_allclose(early.field_rms[:, 0], np.sqrt(np.mean(off**2, axis=(1, 2))))
    assert not np.isfinite(early.field_rms[:, 1:]).any()


def test_an_early_run_within_the_box_teaches_the_travels_that_it_reached() -> None:
    found = campaign(ratios(8))
    place = int(np.argmin(np.sum((ratios(8) - ratios(8).mean(axis=0)) ** 2, axis=1)))
    early = replace(
        found.responses[place],
        force=np.where(np.arange(5) < 3, found.force[place], np.nan),
        displacement=np.where(np.arange(5)[:, None, None] < 3, found.displacement[place], np.nan),
        reached=1.0,
        status=Status.STOPPED,
    )
    responses = list(found.responses)
    responses[place] = early
    stopped = replace(found, responses=tuple(responses))
    runs = training_set([stopped], gradients=False)
    emulator = Emulator.fit(runs, 1)
    here = found.theta[[place]]
    error, before = (
        np.abs(each.unit_force(here)[0][0] / found.force[place] - 1.0)
        for each in (emulator, emulator.by_complete_runs)
    )
    assert (error[:3] < 0.5 * before[:3]).all() and error[3] < before[3]
    judged = partial_runs(emulator, [stopped])  # by the complete runs, not by what it taught
    np.testing.assert_allclose(np.abs(judged.relative[0, :3]), before[:3], rtol=1e-9)


def test_an_early_run_beside_a_complete_one_teaches_nothing() -> None:
    first = campaign(ratios(12))
    extent = np.ptp(first.theta, axis=0)
    inside = first.theta[5]
    again = campaign(np.array([inside, inside + 3.0 * SAME_POINT * extent]), block(stops_above=0.0))
    assert not again.reached.any()
    training = training_set([first, again], gradients=False)
    assert training.n_excluded == 2 and training.partial is not None
    np.testing.assert_array_equal(training.partial.ratios, again.theta[1:])


def test_without_early_runs_there_is_nothing_to_tell() -> None:
    found = campaign(ratios())
    emulator = Emulator.fit(training_set([found], gradients=True), 1)
    early = partial_runs(emulator, [found])
    assert early.relative.shape == (0, 5) and early.ratios.shape == (0, 2)


def test_noise_is_the_standard_error_of_the_measured_mean() -> None:
    noise = measurement_noise(STUDY)
    data = thesis_forces()
    rows = [data.travel.tolist().index(travel) for travel in STUDY.increments]
    expected = data.force_sd[rows] / np.sqrt(data.n_samples) / data.force_mean[rows]
    np.testing.assert_allclose(noise.force, expected)
    assert noise.field is None
    virtual = load_study("virtual")
    assert virtual.virtual is not None
    stated = measurement_noise(virtual)
    np.testing.assert_allclose(stated.force, 0.08 / np.sqrt(23))
    assert stated.field == 0.01
    forces = replace(virtual, data=replace(virtual.data, level="summary"))
    assert measurement_noise(forces).field is None


def test_noise_of_a_measured_field_is_that_of_its_most_exact_component(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Refinement and the check of the mesh then know that the field counts."""
    data = thesis_forces()
    field = FieldData(np.zeros((2, 2)), np.zeros((5, 2, 3)), np.array([0.02, 0.01, 0.05]), 0.5, 0.3)
    found = SimpleNamespace(dataset=replace(data, field=field))
    monkeypatch.setattr("calib.study.judgement.measured", lambda _: found)
    assert measurement_noise(STUDY).field == 0.01


def trained(out: Path, stops_above: float = np.inf, gradients: bool = True) -> Context:
    def factory(study: Study, hypothesis: Hypothesis, cells: Cells) -> AnalyticBlock:
        return replace(analytic_block(study, hypothesis, cells), stops_above=stops_above)

    study = replace(
        STUDY,
        design=replace(STUDY.design, n_runs=12, n_held_out=4),
        emulator=replace(STUDY.emulator, gradients=gradients),
    )
    context = Context(study, out, factory, serial_map, lambda _: None, show_progress=False)
    run_stages(context, until="train")
    return context


@pytest.mark.lasting
@pytest.mark.parametrize("gradients", [True, False])
def test_the_switch_of_the_study_reaches_the_emulator(tmp_path: Path, gradients: bool) -> None:
    trained(tmp_path, gradients=gradients)
    usable = load_emulator(tmp_path / FIRST, HYPOTHESIS).force.processes.usable
    assert bool(usable.all()) == gradients and bool(usable.any()) == gradients
    facts = load_diagnostics(tmp_path / FIRST)["stuck"]
    assert facts["n_with_gradients"] == (12 if gradients else 0)


@pytest.mark.lasting
def test_diagnostics_hold_every_run_and_every_point(tmp_path: Path) -> None:
    context = trained(tmp_path)
    facts = load_diagnostics(tmp_path / FIRST)["stuck"]
    for kind, n in (("leave_one_out", 12), ("held_out", 4)):
        errors = np.array(facts["runs"][kind]["relative_force_error"])
        assert errors.shape == (n, 5) and np.array(facts["runs"][kind]["field_rms"]).shape == (n, 5)
        rms = np.sqrt(np.mean(errors**2, axis=0))
        np.testing.assert_allclose(rms, facts[kind]["force_rms"], rtol=1e-9)
        assert np.abs(errors).max() == pytest.approx(facts[kind]["force_max"])
    maps = load_maps(tmp_path / FIRST, HYPOTHESIS)
    assert maps["points"].shape == (12, 2) and maps["held_out"].shape == (5, 12)
    by_step = np.sqrt(np.mean(maps["held_out"] ** 2, axis=1))
    np.testing.assert_allclose(by_step, facts["held_out"]["field_rms"], rtol=1e-9)
    noise = measurement_noise(context.study).force
    expected = np.max(np.array(facts["held_out"]["force_rms"]) / noise)
    assert facts["share_of_noise"] == {"force": pytest.approx(expected), "field": None}


def test_early_runs_are_in_the_diagnostics(tmp_path: Path) -> None:
    trained(tmp_path, stops_above=0.999 * STUDY.prior.s.high)
    facts = load_diagnostics(tmp_path / FIRST)["sliding"]
    assert facts["n_excluded"] == 2
    runs = facts["partial_runs"]
    assert [row[1] for row in runs["ratios"]] == [STUDY.prior.s.high] * 2
    known: Sequence[float | None] = runs["relative"][0]
    assert known[0] is not None and list(known[1:]) == [None] * 4


def test_a_design_of_which_no_run_was_complete_is_refused_in_words() -> None:
    with pytest.raises(CampaignFailed, match="none of its 6 runs reached the last increment"):
        training_set([campaign(ratios(6), block(stops_above=-1.0))], gradients=False)
