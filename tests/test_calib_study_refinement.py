"""The loop of refinement: runs where the posterior is, an end, and no inference from bad emulators.

On an analytic stand-in for the FE model.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from analytic_block import AnalyticBlock, analytic_block
from toy_simulation import MANY
from toy_simulation import run as run_toy

import surrogate.refine
from calib import cli
from calib.inference.forward import EmulatorForward
from calib.inference.likelihood import build_likelihood
from calib.inference.mesh_correction import MeshCorrection
from calib.inference.posterior import Posterior
from calib.inference.quadrature import integrate
from calib.study.config import Study, load_study
from calib.study.context import Context
from calib.study.data_stage import load_data
from calib.study.emulator_figures import refinement_loop, worst_errors
from calib.study.emulator_tables import coverage_table, partial_table, refinement_table
from calib.study.figure_style import png_bytes
from calib.study.local_design import LOCAL, REFINEMENT
from calib.study.posterior_setup import emulator_posterior, noise_of
from calib.study.refine_stage import load_refinement
from calib.study.refinement import outlook
from calib.study.sections import Cells, Hypothesis
from calib.study.stages import run_stages
from calib.study.train_report import WORST, EmulatorRefused, refuse_bad_emulators
from calib.study.train_stage import (
    DIAGNOSTICS,
    FIRST,
    LEAST_HELD_OUT,
    StudyRuns,
    load_diagnostics,
    load_emulator,
    load_maps,
    maps_path,
)
from calib.study.training_runs import rows, training_set
from calib.study.unknowns import design_points, prior_of
from fe.campaign import CampaignFailed
from fe.campaign_result import Campaign
from fe.executors import serial_map
from fe.response import Array, Response
from surrogate import Emulator, ScaledEmulator, TrainingSet

Factory = Callable[[Study, Hypothesis, Cells], object]


def small(**design: float) -> Study:
    study = load_study("thesis-forces")
    return replace(
        study,
        prior=replace(
            study.prior,
            kappa=replace(study.prior.kappa, low=0.008, high=0.02),
            r=replace(study.prior.r, high=0.5),
            s=replace(study.prior.s, high=0.25),
        ),
        design=replace(study.design, **({"n_runs": 8, "n_held_out": 4} | design)),
    )


def a_context(study: Study, out: Path, factory: Factory = analytic_block) -> Context:
    return Context(study, out, factory, serial_map, lambda _: None, show_progress=False)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def refined(tmp_path_factory: pytest.TempPathFactory) -> Context:
    context = a_context(small(), tmp_path_factory.mktemp("refined"))
    run_stages(context, until="check")
    return context


def read(context: Context) -> dict[str, dict[str, list[dict[str, object]]]]:
    found: dict[str, dict[str, list[dict[str, object]]]] = json.loads(
        (context.out / REFINEMENT).read_text()
    )
    return found


@pytest.mark.lasting
def test_the_loop_ends_when_the_posterior_mean_rests(refined: Context) -> None:
    for found in read(refined).values():
        last = found["rounds"][-1]
        assert max(last["predicted_shift"]) < surrogate.refine.STOP_BELOW  # type: ignore[call-overload]
        assert len(found["ratios"]) == sum(entry["n_added"] for entry in found["rounds"])  # type: ignore[misc]
        assert last["n_train"] == 8 + len(found["ratios"]) - 1
        assert len(found["ratios"]) < refined.study.design.n_refine


@pytest.mark.lasting
def test_runs_are_added_where_the_posterior_is(refined: Context) -> None:
    hypothesis = refined.study.hypotheses[1]
    added = load_refinement(refined, hypothesis)
    emulator = load_emulator(refined.out, hypothesis)
    assert added.reached.all() and emulator.header.n_train == 8 + len(added.theta)
    found = integrate(emulator_posterior(refined, hypothesis))
    distance = np.abs(added.theta - found.mean[1:]) / found.sd[1:]
    assert distance.max() < 4.0
    # The last is at the mean.
    assert distance[-1].max() < 0.1


@pytest.mark.lasting
def test_without_an_end_in_sight_the_largest_number_of_runs_is_kept_to_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(surrogate.refine, "STOP_BELOW", 0.0)
    study = small(n_refine=3)
    context = a_context(replace(study, hypotheses=study.hypotheses[1:]), tmp_path)
    run_stages(context, until="refine")
    found = read(context)
    assert [len(facts["ratios"]) for facts in found.values()] == [3]
    for facts in found.values():
        facts["limit"] = 0.0  # type: ignore[assignment]
    table = refinement_table(found)
    assert table.note.count("largest number of runs was reached") == 1


def _posterior(context: Context, emulator: Emulator) -> Posterior:
    likelihood = build_likelihood(
        load_data(context.out).dataset,
        EmulatorForward(ScaledEmulator(emulator)),
        noise_of(context.study),
        force_discretisation=0.02,
    )
    return Posterior(
        prior_of(context.study, context.study.hypotheses[0], with_field=False), likelihood
    )


def an_outlook(context: Context, runs: TrainingSet) -> Array:
    emulator = Emulator.fit(runs, 1)
    posterior, rng = _posterior(context, emulator), np.random.default_rng(3)
    forward = EmulatorForward(ScaledEmulator(emulator))
    return outlook(emulator, runs, posterior, forward, rng).shift.shift


@pytest.mark.lasting
def test_the_shift_foretold_falls_with_the_emulators_error(refined: Context) -> None:
    """By an emulator of 4 runs without derivatives against one of 8 with them."""
    study, hypothesis = refined.study, refined.study.hypotheses[0]
    model = analytic_block(study, hypothesis, study.mesh.sampling)
    theta = design_points(study, study.hypotheses[0])
    runs = Campaign(theta, tuple(model(row) for row in theta), n_reused=0)
    few = Campaign(theta[:4], runs.responses[:4], n_reused=0)
    poor = training_set([few], gradients=False)
    good = training_set([runs], gradients=True)
    assert an_outlook(refined, good).max() < 0.2 * an_outlook(refined, poor).max()


@pytest.mark.lasting
def test_a_stated_model_says_what_the_emulator_says_on_the_finer_mesh(refined: Context) -> None:
    scaled = ScaledEmulator(load_emulator(refined.out, refined.study.hypotheses[0]))
    shape = scaled.emulator.field_shape
    assert shape is not None
    rng = np.random.default_rng(0)
    correction = MeshCorrection(0.9 + 0.1 * rng.random(5), 0.01 * rng.random(shape))
    forward = EmulatorForward(scaled, with_field=True, correction=correction)
    theta = np.array([[0.01, 0.2, 0.1], [0.02, 0.4, 0.2]])
    unit_force, _ = scaled.emulator.unit_force(theta[:, 1:])
    weights, _ = scaled.emulator.field_weights(theta[:, 1:])
    found = forward.stated(theta, unit_force, weights)
    expected = forward.predict(theta)
    np.testing.assert_allclose(found.force, expected.force, rtol=1e-12)
    np.testing.assert_array_equal(found.weights, expected.weights)
    assert found.force_covariance is None and found.weight_variance is None


@dataclass(frozen=True)
class OffDesign:
    """A block whose runs end early away from the points of a design."""

    block: AnalyticBlock
    design: tuple[tuple[float, float], ...]

    def points(self) -> Array:
        return self.block.points()

    def __call__(self, ratios: Array) -> Response:
        known = any(np.allclose(ratios, row, atol=1e-12) for row in self.design)
        return (self.block if known else replace(self.block, stops_above=-1.0))(ratios)


@pytest.mark.lasting
def test_runs_at_the_posterior_that_end_early_stop_the_study_beyond_the_rate(
    tmp_path: Path,
) -> None:
    study = small(max_failure_rate=0.05)
    study = replace(study, hypotheses=study.hypotheses[:1])
    design = tuple((float(r), float(s)) for r, s in design_points(study, study.hypotheses[0]))

    def factory(study: Study, hypothesis: Hypothesis, cells: Cells) -> OffDesign:
        return OffDesign(analytic_block(study, hypothesis, cells), design)

    with pytest.raises(CampaignFailed, match=r"stuck: 1 of 13 runs of design and refinement ended"):
        run_stages(a_context(study, tmp_path, factory), until="refine")


def strict() -> Study:
    study = small()
    return replace(
        study,
        hypotheses=study.hypotheses[:1],
        emulator=replace(study.emulator, max_force_error=1e-9),
    )


@pytest.mark.lasting
def test_nothing_is_inferred_from_an_emulator_beyond_the_limits(tmp_path: Path) -> None:
    context = a_context(strict(), tmp_path)
    with pytest.raises(
        EmulatorRefused, match=r"stuck: emulator: held-out force error .* above"
    ) as e:
        run_stages(context, until="sample")
    figure = tmp_path / WORST
    assert str(figure) in str(e.value) and figure.read_bytes().startswith(b"\x89PNG")
    assert not list(tmp_path.glob("samples_*"))
    # The runs and the emulators are kept: what is refused is to go on.
    lines: list[str] = []
    with pytest.raises(EmulatorRefused):
        run_stages(replace(context, echo=lines.append), until="sample")
    assert any(line.startswith("refine") and "up to date" in line for line in lines)


@pytest.mark.lasting
def test_a_refusal_of_the_emulator_of_a_box_alone_shows_where_that_one_errs(
    refined: Context, tmp_path: Path
) -> None:
    shutil.copytree(refined.out, tmp_path / "run")
    context = replace(refined, out=tmp_path / "run")
    refuse_bad_emulators(context)  # those of the whole box are good
    name = context.study.hypotheses[0].name
    boxes = json.loads((context.out / REFINEMENT).read_text())
    boxes[name]["box"] = [[0.1, 0.2], [0.05, 0.1]]
    (context.out / REFINEMENT).write_text(json.dumps(boxes))
    local = context.out / LOCAL
    local.mkdir(exist_ok=True)
    judged = load_diagnostics(context.out)[name] | {"failures": ["emulator: errs"]}
    (local / DIAGNOSTICS).write_text(json.dumps({name: judged}))
    shutil.copy(maps_path(context.out, context.study.hypotheses[0]), local)
    with pytest.raises(EmulatorRefused, match=rf"{name} in its box: .* raise design\.n_local") as e:
        refuse_bad_emulators(context)
    assert str(local / WORST) in str(e.value) and (local / WORST).exists()
    assert not (context.out / WORST).exists()


def test_one_or_two_runs_held_out_in_a_box_judge_nothing(tmp_path: Path) -> None:
    held_out = run_toy(tmp_path, theta=MANY[:20])
    first = np.sort(held_out.theta[:, 0])
    for n, expected in ((LEAST_HELD_OUT - 1, None), (LEAST_HELD_OUT, LEAST_HELD_OUT)):
        box = np.array([[0.0, 0.5 * (first[n - 1] + first[n])], [0.0, 1.0]])
        found = StudyRuns((held_out,), held_out, box).held_out_set()
        assert (None if found is None else len(found.ratios)) == expected
    two = StudyRuns((held_out,), rows(held_out, slice(2))).held_out_set()
    assert two is not None and len(two.ratios) == 2  # without a box as many as were asked for


def test_a_refusal_is_one_sentence_and_exit_code_1(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise EmulatorRefused("stuck: errs too much")

    monkeypatch.setattr("calib.study.stages.run_study", refuse)
    assert cli.main(["run", "thesis-forces", "--out", str(tmp_path)]) == cli.FAILED
    assert capsys.readouterr().err == "calib: stuck: errs too much\n"


@pytest.mark.lasting
def test_tables_and_figures_show_both_hypotheses(refined: Context) -> None:
    found, diagnostics = read(refined), load_diagnostics(refined.out)
    table = refinement_table(found)
    assert {row[0] for row in table.rows} == {"stuck", "sliding"}
    assert "largest number" not in table.note
    assert png_bytes(refinement_loop(found)).startswith(b"\x89PNG")
    coverage = coverage_table(diagnostics)
    assert [row[0] for row in coverage.rows[:2]] == ["stuck, force", "stuck, field"]
    assert coverage.columns[2:5] == ("of 50 %", "of 80 %", "of 95 %")
    assert {row[-1] for row in coverage.rows} == {"-"}, "8 runs do not tell how wide"
    told = {"stuck": {**diagnostics["stuck"], "scales": {"force": {"log_std": 0.2}}}}
    of_force = [row[-1] for row in coverage_table(told).rows if row[0] == "stuck, force"]
    assert "-" in of_force and set(of_force) != {"-"}, "of runs held out"
    assert partial_table(diagnostics) is None
    maps = {h.name: load_maps(refined.out, h) for h in refined.study.hypotheses}
    figure = worst_errors(diagnostics, maps, refined.study.increments)
    face = figure.axes[1]
    assert "front face" in face.get_title()
    # The first ring is at the point of the largest error.
    ringed = face.collections[1].get_offsets()
    worst = np.argmax(maps["stuck"]["held_out"].max(axis=0))
    np.testing.assert_allclose(np.asarray(ringed)[0], maps["stuck"]["points"][worst])
    assert load_emulator(refined.out / FIRST, refined.study.hypotheses[0]).header.n_train == 8
