"""The questions put to a finished study: verbs, tables, files; on a block in closed form."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import arviz as az
import numpy as np
import pytest
from analytic_block import analytic_block
from matplotlib.backends.backend_agg import FigureCanvasAgg
from test_calib_inference_leave_out import FORCE, TRAVEL, draws

from calib.asking_verbs import _say_answer
from calib.cli import main
from calib.inference.coordinates import Space, Unknown
from calib.inference.data_parts import Part
from calib.inference.fisher import spectrum
from calib.inference.knowledge import (
    Constants,
    Knowledge,
    PartKnowledge,
    constants_of,
    warnings_of,
)
from calib.inference.leave_out import Scores
from calib.inference.moments import Moments
from calib.inference.profile import Profile
from calib.inference.quadrature import integrate
from calib.inference.weighted_distribution import furthest_apart
from calib.study.artifacts import hash_of_file, plain
from calib.study.config import Study, StudyError, load_study
from calib.study.evidence import (
    N_LIVE,
    Standing,
    evidence_figure,
    rank,
    ranking_table,
    remarks,
    scores_table,
    stand,
)
from calib.study.figure_style import png_bytes
from calib.study.finished import changed_since, chosen, finished
from calib.study.identify import facts, tables
from calib.study.identify_figure import identify_figure
from calib.study.posterior_stage import _hashes
from calib.study.second_test import load_second_test
from calib.study.stages import run_study
from calib.study.study_file import write_study
from calib.study.validate import validate
from fe.executors import serial_map


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished study with a field, both hypotheses."""
    study = load_study("virtual")
    study = replace(
        study,
        design=replace(study.design, n_runs=12, n_held_out=4, n_refine=3),
        sampler=replace(study.sampler, n_ensembles=2, n_autocorrelation=10.0, max_steps=600),
    )
    out = tmp_path_factory.mktemp("questions") / "virtual"
    run_study(
        study,
        out,
        simulate_factory=analytic_block,
        map_fn=serial_map,
        echo=lambda _: None,
        show_progress=False,
    )
    return out


@pytest.mark.slow
def test_identify_says_what_each_part_of_the_data_knows(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["identify", str(run)]) == 0
    text = capsys.readouterr().out
    assert f"wrote {run / 'report.html'}" in text
    assert "<h2>What the data know of each constant</h2>" in (run / "report.html").read_text()
    assert "force: SD left [%]" in text and "field: SD left [%]" in text
    assert "The field alone says nothing of C10 + C01" in text
    found = json.loads((run / "identify.json").read_text())
    for parts in (known["parts"] for known in found.values()):
        by_part = {name: part["sd_over_prior"] for name, part in parts.items()}
        assert by_part["field"][0] == pytest.approx(1.0, abs=0.05)
        assert by_part["force"][0] < 0.3
        both = np.array(by_part["both"])
        assert np.all(both < 1.05 * np.minimum(by_part["force"], by_part["field"]))
    assert (run / "figures" / "identify.png").stat().st_size > 10_000


@pytest.mark.slow
def test_evidence_gives_no_number_without_its_error(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evidence", str(run)]) == 0
    text = capsys.readouterr().out
    assert f"wrote {run / 'report.html'}" in text
    assert "<h2>Ranking of the hypotheses</h2>" in (run / "report.html").read_text()
    rows = [line for line in text.splitlines() if line.startswith(("stuck ", "sliding "))]
    assert len(rows) == 4
    assert all(row.count("±") >= 5 for row in rows)
    found = json.loads((run / "evidence.json").read_text())
    for standing in found.values():
        (by_grid, error), (by_nested, sd) = (
            standing["log_evidence"],
            standing["log_evidence_nested"],
        )
        assert abs(by_grid - by_nested) < 5 * np.hypot(error, sd)
        assert standing["blocks"]["names"] == ["all forces", "whole field"]
    assert sum(s["stacking_weight"][0] for s in found.values()) == pytest.approx(1.0)


@pytest.mark.slow
def test_baseline_ends_at_one_error_and_many_stiffnesses(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["baseline", str(run), "--hypothesis", "sliding"]) == 0
    assert "Spread of the answers from nine starts" in (run / "report.html").read_text()
    text = capsys.readouterr().out
    assert "SYNTHETIC field" in text and "thesis Table 5.3, real data, as printed" in text
    found = json.loads((run / "baseline.json").read_text())
    exact = found["runs"][1]
    force = np.array(exact["force"])[:, -1]
    assert exact["exact_gradients"] and len(exact["error"]) == 9
    assert np.ptp(exact["error"]) < 0.05 * min(exact["error"])
    assert force.max() > 2.0 * force.min()


@pytest.mark.slow
def test_what_to_measure_next_stands_in_the_report(run: Path) -> None:
    assert main(["design-next", str(run), "--hypothesis", "sliding", "--no-runs"]) == 0
    report = (run / "report.html").read_text()
    assert "<h2>What to measure next</h2>" in report and "4 times the samples" in report


@pytest.mark.slow
def test_wrong_questions_are_refused_in_one_sentence(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = ["--truth", "0.01", "0.01", "0.001"]
    assert main(["baseline", str(run), "--hypothesis", "stuck", *truth]) == 2
    assert "the study has a field" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("missing", ["samples_sliding.npz", "emulator_sliding.npz", "data.npz"])
def test_what_a_damaged_study_lacks_is_named_by_every_verb(
    run: Path, missing: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "copy"
    shutil.copytree(run, out)
    (out / missing).unlink()
    boxed = out / "local" / missing  # the chain asks the emulator that was sampled alone
    chained = boxed if boxed.is_file() else out / missing
    boxed.unlink(missing_ok=True)
    verbs = (["evidence"], out / missing), (["direct-chain", "--hypothesis", "sliding"], chained)
    for (verb, *options), path in verbs:
        assert main([verb, str(out), *options]) == 2
        error = capsys.readouterr().err
        assert error.startswith(f"calib: {path}: found no such file, the study is not ")
        assert error.endswith(": run `calib run` on it\n") and error.count("\n") == 1


def _posterior_of(study: Study) -> az.InferenceData:
    """As much of a posterior as says of which study file it is."""
    file = {"study_file": plain(study)}
    return az.from_dict({"mu": np.zeros((1, 2))}, attrs={"provenance": json.dumps(file)})


def test_a_folder_of_two_runs_is_refused(tmp_path: Path) -> None:
    """Data changed under their name, and the run that took them was stopped."""
    study = load_study("virtual")
    (tmp_path / "data.json").touch()
    (tmp_path / "data.npz").write_bytes(b"of the posterior")
    hashes = {"data.npz": hash_of_file(tmp_path / "data.npz"), "map.json": "not there any more"}
    stated = {"study_file": plain(study), "input_hashes": hashes}
    posterior = az.from_dict({"mu": np.zeros((1, 2))}, attrs={"provenance": json.dumps(stated)})
    posterior.to_netcdf(str(tmp_path / "posterior.nc"))
    write_study(tmp_path / "study.toml", study)
    assert finished(tmp_path).study == study
    (tmp_path / "data.npz").write_bytes(b"of another run")
    with pytest.raises(ValueError, match=r"posterior\.nc: found data\.npz of another run"):
        finished(tmp_path)
    test, folder = load_second_test("notched-plate")
    with pytest.raises(ValueError, match="of another run beside it"):
        validate(tmp_path, test, folder, lambda _: None)
    assert "data.npz" in changed_since(tmp_path / "posterior.nc")


def test_a_finished_study_does_not_ask_for_its_data_file(tmp_path: Path) -> None:
    main(["init", str(tmp_path / "mine")])
    study = load_study(tmp_path / "mine" / "study.toml")
    (tmp_path / "data.json").touch()
    write_study(tmp_path / "study.toml", study)
    (tmp_path / "mine" / "forces.csv").unlink()
    _posterior_of(study).to_netcdf(str(tmp_path / "posterior.nc"))
    assert finished(tmp_path).study == study
    with pytest.raises(StudyError, match=r"data\.source: found .*forces\.csv\","):
        load_study(tmp_path / "study.toml")


def test_a_study_file_of_other_results_is_refused(tmp_path: Path) -> None:
    study = load_study("virtual")
    posterior = _posterior_of(study)
    posterior.to_netcdf(str(tmp_path / "posterior.nc"))
    (tmp_path / "data.json").touch()
    other = replace(study, compute=replace(study.compute, workers=3))
    for allowed in (study, other):
        write_study(tmp_path / "study.toml", allowed)
        assert finished(tmp_path).study == allowed
    louder = replace(study, seed=1, noise=replace(study.noise, sample_correlation=0.0))
    write_study(tmp_path / "study.toml", louder)
    with pytest.raises(ValueError, match=r"study\.toml: found seed, noise changed since posterior"):
        finished(tmp_path)
    before = plain(louder)
    del before["noise"]["force_freedom"]  # a key that came later, and is not set
    posterior.attrs["provenance"] = json.dumps({"study_file": before})
    posterior.to_netcdf(str(tmp_path / "posterior.nc"))
    assert finished(tmp_path).study == louder
    (tmp_path / "posterior.nc").write_bytes(b"cut")
    with pytest.raises(ValueError, match=r"posterior\.nc: not a readable posterior"):
        finished(tmp_path)


def test_a_study_without_its_posterior_is_asked_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its parts may be of runs with other settings, which the posterior alone would tell."""
    write_study(tmp_path / "study.toml", load_study("virtual"))
    (tmp_path / "data.json").touch()
    for verb in ("identify", "evidence", "baseline", "design-next", "direct-chain"):
        assert main([verb, str(tmp_path), *(["--hypothesis", "stuck"] * (verb[0] in "bd"))]) == 2
        said = (
            f"calib: {tmp_path}: found no posterior.nc, expected the folder of a finished study\n"
        )
        assert capsys.readouterr().err == said


def test_a_posterior_is_known_by_mesh_errors_and_boxes_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = load_study("virtual")
    names = ["data.npz", "data.json", "map.json", "boxes.json", "refinement.json"]
    for hypothesis in ("stuck", "sliding"):
        names += [f"emulator_{hypothesis}.npz", f"samples_{hypothesis}.npz"]
        names += [f"check/{hypothesis}/mesh_error.{end}" for end in ("json", "npz")]
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    monkeypatch.setattr("calib.study.posterior_stage.kept_box", lambda *_: None)
    assert _hashes(tmp_path, study) == {name: hash_of_file(tmp_path / name) for name in names}


def test_an_answer_stands_where_its_report_cannot_be_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "report.html").touch()

    def damaged(*_: object) -> None:
        raise ValueError("diagnostics.json: not a JSON file")

    monkeypatch.setattr("calib.study.finished.finished", damaged)
    _say_answer(tmp_path, ["found"], [tmp_path / "evidence.json"])
    assert capsys.readouterr().out.splitlines() == [
        "found",
        "report.html is not drawn again: diagnostics.json: not a JSON file",
        f"wrote {tmp_path / 'evidence.json'}",
    ]


def test_the_boxes_that_a_posterior_was_made_with_must_be_there(tmp_path: Path) -> None:
    study = load_study("virtual")
    (tmp_path / "data.json").touch()
    (tmp_path / "boxes.json").write_text("{}")
    hashes = {"boxes.json": hash_of_file(tmp_path / "boxes.json")}
    stated = {"study_file": plain(study), "input_hashes": hashes}
    posterior = az.from_dict({"mu": np.zeros((1, 2))}, attrs={"provenance": json.dumps(stated)})
    posterior.to_netcdf(str(tmp_path / "posterior.nc"))
    write_study(tmp_path / "study.toml", study)
    assert finished(tmp_path).study == study
    (tmp_path / "boxes.json").unlink()
    with pytest.raises(ValueError, match=r"posterior\.nc: found no boxes\.json beside it"):
        finished(tmp_path)


def test_a_second_test_is_not_solved_where_its_report_could_not_be_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_study(tmp_path / "study.toml", load_study("virtual"))
    for name in ("data.json", "report.html"):
        (tmp_path / name).touch()
    (tmp_path / "posterior.nc").write_bytes(b"cut")
    assert main(["validate", str(tmp_path), "notched-plate"]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and "posterior.nc: not a readable posterior" in captured.err


def test_the_hypothesis_may_be_left_out_where_there_is_one_only() -> None:
    study = load_study("virtual")
    alone = replace(study, hypotheses=study.hypotheses[1:])
    assert chosen(alone, None) == chosen(study, "sliding") == study.hypotheses[1]
    with pytest.raises(ValueError, match="--hypothesis: found none, expected one of stuck, slid"):
        chosen(study, None)
    with pytest.raises(ValueError, match="--hypothesis: found stuck, expected one of sliding"):
        chosen(alone, "stuck")


@pytest.mark.parametrize("verb", ["baseline", "direct-chain", "design-next"])
def test_every_verb_wants_the_hypothesis_named_where_there_are_several(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = load_study("virtual")
    write_study(tmp_path / "study.toml", study)
    (tmp_path / "data.json").touch()
    _posterior_of(study).to_netcdf(str(tmp_path / "posterior.nc"))
    assert main([verb, str(tmp_path)]) == 2
    expected = "calib: --hypothesis: found none, expected one of stuck, sliding\n"
    assert capsys.readouterr().err == expected


def test_a_folder_without_a_study_and_an_unknown_hypothesis_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for verb in ("identify", "evidence", "baseline"):
        assert main([verb, str(tmp_path)]) == 2
        assert f"{tmp_path}: found no study.toml, expected the folder" in capsys.readouterr().err
    with pytest.raises(ValueError, match="expected one of stuck, sliding"):
        chosen(load_study("virtual"), "glued")


SPACE = Space()
PRIOR_SD = np.array([1.3, 0.29, 0.14])


def part(name: Part, sd: list[float], correlation: float = 0.0) -> PartKnowledge:
    """A normal posterior of given SDs, r and s correlated."""
    matrix = np.eye(3)
    matrix[1, 2] = matrix[2, 1] = correlation
    covariance = np.outer(sd, sd) * matrix
    draws = np.random.default_rng(3).multivariate_normal([-4.0, 0.5, 0.1], covariance, 4000)
    moments = Moments(draws, np.full(4000, 1 / 4000))
    return PartKnowledge(
        name,
        moments,
        np.array(sd) / PRIOR_SD,
        np.zeros(3),
        spectrum(np.linalg.inv(covariance), PRIOR_SD),
        constants_of(moments, SPACE),
        np.zeros(4),
    )


def known(
    *parts: PartKnowledge, curved: tuple[float, float, float] = (50.0, 50.0, 50.0)
) -> Knowledge:
    """With parabolic profiles of given curvatures over the unit interval."""
    values = np.linspace(0.0, 1.0, 41)
    profiles = tuple(Profile(values, -0.5 * c * (values - 0.5) ** 2) for c in curved)
    names = tuple(unknown.x_name for unknown in SPACE.unknowns)
    law, prior = SPACE.law, Constants(np.full(4, 0.02), np.array([0.02, 0.02, 0.01, 0.04]))
    said = warnings_of(SPACE, PRIOR_SD, parts, profiles)
    units = tuple(unknown.x_unit for unknown in SPACE.unknowns)
    return Knowledge(names, units, PRIOR_SD, law.constants, law.units, prior, parts, profiles, said)


def test_coordinates_have_their_units_in_file_table_and_figure() -> None:
    height = Unknown("height", "mm", "height of the block")
    found = known(part("force", [0.02, 0.28, 0.01]))
    found = replace(found, names=(*found.names[:2], "height"), units=("ln MPa", "1", height.x_unit))
    assert facts(found)["units"] == {
        "ln kappa": "ln MPa",
        "r": "1",
        "height": "mm",
        **dict(zip(SPACE.law.constants, SPACE.law.units, strict=True)),
    }
    assert [row[1] for row in tables("stuck", found)[0].rows] == ["ln MPa", "-", "mm"]
    labels = [axis.get_xlabel() for axis in identify_figure({"stuck": found}).axes[:3]]
    assert labels == ["ln($\\kappa$ / MPa)", "$r$ [-]", "height [mm]"]


def test_long_names_of_coordinates_do_not_cover_one_another() -> None:
    found = known(part("force", [0.02, 0.28, 0.01]))
    several = ("ln kappa", "ln discrepancy", "ln discrepancy_of_force")

    def covered(names: tuple[str, ...]) -> bool:
        figure = identify_figure({"stuck": replace(found, names=names)})
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        boxes = [label.get_window_extent() for label in figure.axes[-1].get_xticklabels()]
        angles = {label.get_rotation() for label in figure.axes[-1].get_xticklabels()}
        return angles == {0.0} and any(a.overlaps(b) for a, b in pairwise(boxes))

    assert not covered(several) and not covered(found.names)


def test_where_the_constants_have_the_priors_words_are_of_these() -> None:
    whole = part("force", [0.02, 0.28, 0.01])
    profiles = known(whole).profiles
    sd = whole.constants.sd / np.array([0.5, 0.9, 0.3, 0.1])
    said = " ".join(warnings_of(SPACE, PRIOR_SD, (whole,), profiles, sd))
    assert "C01 is the prior: the data leave 90 % of its SD." in said
    assert (
        "r = C01" not in said and "C10 is the prior" not in said and "mu is the prior" not in said
    )


def test_words_say_what_is_the_prior_and_what_is_known_as_a_sum() -> None:
    found = known(part("force", [0.02, 0.28, 0.01]), curved=(50.0, 0.01, 50.0))
    text = " ".join(found.warnings)
    assert "C10 and C01 are known only as their sum, to 2 %" in text
    assert "r = C01 / (C10 + C01) is the prior: the data leave 97 % of its SD." in text
    assert "No value of r within the prior's bounds is refused" in text
    assert "No value of s" not in text


def test_what_the_data_move_is_not_called_the_prior_though_its_sd_stays() -> None:
    """Two ranges near the ends of a uniform prior are as wide as it is."""
    rng = np.random.default_rng(4)
    prior = Moments(rng.random((20_000, 1)), np.full(20_000, 1 / 20_000))
    nodes = np.array([[0.19], [0.2], [0.21], [0.79], [0.8], [0.81]])
    ranges = Moments(nodes, np.array([0.25, 0.5, 0.25, 0.25, 0.5, 0.25]) / 2.0)
    assert ranges.sd / prior.sd == pytest.approx(1.04, abs=0.02)
    [apart] = furthest_apart(prior, ranges)
    # Of the posterior seven sixteenths lie below 0.21, half of what is there among them.
    assert apart == pytest.approx(7 / 16 - 0.21, abs=0.01)
    even = Moments(np.linspace(0.0, 1.0, 12)[:, None], np.full(12, 1 / 12))
    assert furthest_apart(prior, even)[0] < 0.06
    whole = part("force", [0.02, 0.28, 0.01])
    other = replace(whole, moved=np.array([0.5, 0.23, 0.5]))
    text = " ".join(known(other).warnings)
    assert "r = C01 / (C10 + C01) is moved by the data, not narrowed" in text
    assert "is the prior" not in text
    alone = replace(other, contraction=np.array([0.1, 1.0, 0.1]))
    assert "alone says nothing" not in " ".join(known(alone, other).warnings)


def test_words_say_that_a_profile_leaves_separate_ranges() -> None:
    whole = part("force", [0.02, 0.28, 0.01])
    values = np.linspace(0.0, 1.0, 41)
    peaks = np.maximum(-0.5 * ((values - 0.1) / 0.1) ** 2, -0.5 * ((values - 0.9) / 0.1) ** 2)
    found = Profile(values, peaks)
    assert np.ravel(found.intervals) == pytest.approx([0.0, 0.296, 0.704, 1.0], abs=0.003)
    assert found.interval == (0.0, 1.0)
    # A search that failed at one point, and one that is rough at the limit, leave one range.
    failed = np.where(np.isclose(values, 0.5), -5.0, -12.5 * (values - 0.5) ** 2)
    assert len(Profile(values, failed).intervals) == 1
    rough = np.where(np.arange(41) % 2, -1.93, -1.91) * (values > 0.1)
    assert len(Profile(values, rough).intervals) == 1
    flat = Profile(values, np.zeros(41))
    text = " ".join(warnings_of(SPACE, PRIOR_SD, (whole,), (flat, found, flat)))
    assert "The data leave separate ranges of r: 0 to 0.296; 0.704 to 1." in text
    assert "No value of r within" not in text and "No value of s within" in text


def test_words_say_which_pair_is_known_only_together_and_what_a_part_is_blind_to() -> None:
    field, both = part("field", [1.3, 0.1, 0.05]), part("both", [0.05, 0.1, 0.05], 0.98)
    text = " ".join(known(field, both).warnings)
    assert "r and s are known only together, as r - 2 s (correlation +0.98)" in text
    assert "The field alone says nothing of C10 + C01." in text
    assert "is the prior" not in text


def test_tables_and_figure_of_what_is_known() -> None:
    found = known(part("force", [0.02, 0.1, 0.01]), curved=(50.0, 1.0, 50.0))
    contraction, constants, combined = tables("stuck", found)
    assert [row[0] for row in contraction.rows] == ["ln kappa", "r", "s"]
    assert contraction.rows[0][3] == "2"
    assert contraction.rows[1][-1].endswith("(bound)")
    assert len(combined.rows) == 3
    mu = np.exp(-4.0 + 0.5 * 0.02**2) * 2.0  # mean of a lognormal
    assert [row[0] for row in constants.rows] == ["C10", "C01", "C11", "mu"]
    _, unit, prior, force = constants.rows[3]
    assert (unit, prior) == ("MPa", "0.02000 ± 0.040")
    assert float(force.split(" ")[0]) == pytest.approx(mu, rel=2e-3)
    assert float(force.split(" ")[2]) == pytest.approx(0.02 * mu, rel=0.05)
    # Profiles are over the unit interval here: half a kappa of 1 MPa and more.
    low, high = found.profiles[0].interval
    for end in (low, high):
        assert f"{2.0 * np.exp(end):.4g}" in constants.note
    assert facts(found)["parts"]["force"]["sd_over_prior"][0] == pytest.approx(0.02 / 1.3)
    assert len(png_bytes(identify_figure({"stuck": found}))) > 10_000


def standing(name: str, evidence: float, density: list[float], by_nested: float = 0.0) -> Standing:
    n = len(density)
    scores = Scores(
        tuple(f"{i}" for i in range(n)), np.array(density), np.full(n, 0.02), np.full(n, 0.3)
    )
    nested = (evidence + by_nested, 0.1)
    return Standing(name, (evidence, 0.01), "quadrature", nested, scores, None)


def test_ranking_orders_by_evidence_and_every_number_has_its_error() -> None:
    rng = np.random.default_rng(0)
    first = standing("a", 1.0, [0.0, 0.1, -0.2, 0.3])
    second = standing("b", 3.0, [-1.0, 0.0, -0.5, -0.4])
    ranking = rank([first, second], rng)
    assert [found.name for found in ranking.standings] == ["b", "a"]
    for row in ranking_table(ranking).rows:
        assert sum("±" in cell for cell in row) == 5 and "[" in row[-1]
    assert all("±" in cell for row in scores_table(ranking).rows for cell in row[1:])
    text = " ".join(remarks(ranking))
    assert "Evidence prefers b, prediction a" in text
    assert len(png_bytes(evidence_figure(ranking))) > 10_000


def test_nested_sampling_that_disagrees_is_asked_again_with_more_live_points(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It misses some of a posterior now and then, and its own error with it."""
    exact, asked = integrate(FORCE).log_evidence, []

    def missing_some(*_: object, n_live: int) -> SimpleNamespace:
        asked.append(n_live)
        return SimpleNamespace(
            log_evidence=exact + (0.4 if len(asked) == 1 else 0.01), log_evidence_error=0.05
        )

    monkeypatch.setattr("calib.study.evidence.nested", missing_some)
    found = stand("a", FORCE, draws(500, 0), TRAVEL, np.random.default_rng(0))
    assert asked == [N_LIVE, 4 * N_LIVE]
    assert found.nested == (exact + 0.01, 0.05)
    stand("a", FORCE, draws(500, 0), TRAVEL, np.random.default_rng(0))
    assert asked[2:] == [N_LIVE], "the second time it agreed at once"


def test_evidences_that_disagree_are_told_and_scores_that_do_not_separate_too() -> None:
    rng = np.random.default_rng(0)
    first = standing("a", 1.0, [0.0, 0.1, -0.2, 0.3], by_nested=2.0)
    second = standing("b", 0.0, [0.1, -0.1, 0.1, 0.1])
    text = " ".join(remarks(rank([first, second], rng)))
    assert "a: quadrature and nested sampling differ by 2.00" in text
    assert "do not separate a, b" in text
