"""Campaigns of named parameters: factors beside numbers, files that say all by themselves."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from toy_simulation import FINGERPRINT, RATIOS, Toy, run

from fe.campaign import CampaignFailed, CampaignPlan, run_campaign, run_campaigns
from fe.campaign_parameters import Parameter, checked_theta
from fe.campaign_result import Campaign
from fe.response import Response, Status
from fe.run_files import load_run, run_key, software_versions

PIN = Parameter("pin", "1", "factor", ("bar", "round"))
HEIGHT = Parameter("height", "mm", "geometry")
PARAMETERS = (Parameter("r", "1", "material"), HEIGHT, PIN)
THETA = np.array([[0.1, 2.5, 0.0], [0.1, 2.5, 1.0], [0.8, 2.6, 1.0]])


@dataclass(frozen=True)
class Block:
    """The toy under a pin of either kind."""

    def __call__(self, theta: np.ndarray) -> Response:
        toy = Toy(factor=theta[1] * (2.0 if PIN.level(theta[2]) == "round" else 1.0))
        return toy(np.array([theta[0], 0.0]))


def test_a_factor_and_numbers_vary_in_one_campaign(tmp_path: Path) -> None:
    campaign = run_campaign(Block(), THETA, tmp_path, parameters=PARAMETERS)
    np.testing.assert_allclose(campaign.force[1], 2.0 * campaign.force[0])
    assert [p.text(v) for p, v in zip(PARAMETERS, THETA[2], strict=True)] == ["0.8", "2.6", "round"]


def test_a_run_file_says_by_itself_what_it_is(tmp_path: Path) -> None:
    run_campaign(Block(), THETA, tmp_path, parameters=PARAMETERS)
    run = load_run(sorted(tmp_path.glob("run_0002_*.npz"))[0])
    assert run.parameters == PARAMETERS
    np.testing.assert_array_equal(run.theta, THETA[2])
    assert json.loads(run.fingerprint) == {"model": "Block"}
    assert run.software["numpy"] == np.__version__
    np.testing.assert_array_equal(run.response.force, Block()(THETA[2]).force)


def test_the_manifest_says_parameters_versions_design_and_how_each_run_went(tmp_path: Path) -> None:
    design = {"kind": "Sobol", "seed": 7}
    run(tmp_path, Toy(fails_above=0.9), RATIOS[:5], design=design, max_failure_rate=0.5)
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert manifest["design"] == design and manifest["fingerprint"] == FINGERPRINT
    assert [p["name"] for p in manifest["parameters"]] == ["r", "s"]
    assert manifest["parameters"][0]["role"] == "material"
    assert {"softcal", "numpy", "scipy", "python"} <= set(manifest["software"])
    failed = manifest["runs"][1]
    assert (failed["status"], failed["reached_mm"], failed["n_good_steps"]) == ("stopped", 0.8, 1)
    assert failed["message"] == "step below its limit" and failed["theta"] == [1.0, 0.0]
    assert manifest["runs"][0]["reached"] and manifest["runs"][0]["seconds"] == 0.0


def test_one_more_level_keeps_every_run(tmp_path: Path) -> None:
    run_campaign(Block(), THETA, tmp_path, parameters=PARAMETERS)
    more = replace(PIN, levels=("cone", "bar", "round"))
    shifted = THETA + np.array([0.0, 0.0, 1.0])
    again = run_campaign(Block(), shifted, tmp_path, parameters=(*PARAMETERS[:2], more))
    assert again.n_reused == len(THETA)


@pytest.mark.parametrize("changed", [replace(HEIGHT, unit="m"), replace(HEIGHT, name="depth")])
def test_the_same_numbers_of_another_parameter_are_other_runs(changed: Parameter) -> None:
    others = (PARAMETERS[0], changed, PIN)
    assert run_key(THETA[0], PARAMETERS, {}) != run_key(THETA[0], others, {})


def test_a_role_is_a_word_for_readers_and_changes_no_run() -> None:
    others = (PARAMETERS[0], replace(HEIGHT, role="nuisance"), PIN)
    assert run_key(THETA[0], PARAMETERS, {}) == run_key(THETA[0], others, {})


def test_without_a_fingerprint_the_fields_of_the_model_are_one(tmp_path: Path) -> None:
    run_campaign(Toy(), RATIOS, tmp_path)
    assert run_campaign(Toy(factor=2.0), RATIOS, tmp_path).n_reused == 0
    assert run_campaign(Toy(), RATIOS, tmp_path).n_reused == len(RATIOS)
    with pytest.raises(TypeError, match=r"simulate: expected a dataclass.* give fingerprint="):
        run_campaign(lambda theta: Toy()(theta), RATIOS, tmp_path)


def test_another_version_of_the_code_runs_everything_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(tmp_path)
    now = software_versions()
    monkeypatch.setattr("fe.run_files.software_versions", lambda: {**now, "softcal": "99.0"})
    campaign = run(tmp_path)
    assert campaign.n_reused == 0 and len(campaign.unused) == len(RATIOS)
    assert load_run(campaign.unused[0]).software == now, "a run of another version is still a run"
    monkeypatch.setattr("fe.run_files.software_versions", lambda: {**now, "numpy": "99.0"})
    assert run(tmp_path).n_reused == len(RATIOS)


def test_runs_of_another_model_or_format_are_named_and_left(tmp_path: Path) -> None:
    old = tmp_path / "run_0000_0123456789abcdef.npz"  # of format 1: ratios, no version
    np.savez(old, ratios=RATIOS[0], fingerprint=np.asarray("{}"))
    before = old.read_bytes()
    campaign = run(tmp_path)
    assert campaign.unused == (old,) and campaign.n_reused == 0
    assert json.loads((tmp_path / "manifest.json").read_text())["unused"] == [old.name]
    assert old.read_bytes() == before
    with pytest.raises(ValueError, match=f"{old.name}: damaged run"):
        load_run(old)


class Trap:
    """Something whose pickle, when loaded, makes the file named in it."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (self.path,)


@pytest.mark.parametrize("entry", ["theta", "columns", "fingerprint", "software", "force"])
def test_a_pickle_inside_a_run_file_is_refused_by_name_and_never_loaded(
    tmp_path: Path, entry: str
) -> None:
    store, sprung = tmp_path / "store", tmp_path / "sprung"
    run(store, theta=RATIOS[:1])
    [path] = store.glob("run_*.npz")
    with np.load(path) as stored:
        content = {name: stored[name] for name in stored.files}
    np.savez(path, **content | {entry: np.array([Trap(sprung)], dtype=object)})
    with pytest.raises(ValueError, match=f"{path.name}: damaged run"):
        run(store, theta=RATIOS[:1])
    assert not sprung.exists()
    np.load(path, allow_pickle=True)[entry]
    assert sprung.exists(), "the trap works where pickles are loaded"


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ("format", np.asarray(1)),
        ("format", np.asarray("two")),
        ("theta", np.zeros(3)),
        ("theta", np.zeros(2, dtype=np.int64)),
        ("columns", np.asarray("[1, 2]")),
        ("columns", np.asarray("{")),
        ("software", np.asarray("[]")),
        ("status", np.asarray("fine")),
    ],
)
def test_a_run_file_that_is_not_whole_is_refused_by_name(
    tmp_path: Path, entry: str, value: np.ndarray
) -> None:
    run(tmp_path, theta=RATIOS[:1])
    [path] = tmp_path.glob("run_*.npz")
    with np.load(path) as stored:
        content = {name: stored[name] for name in stored.files}
    np.savez(path, **content | {entry: value})
    with pytest.raises(ValueError, match=f"{path.name}: damaged run .* delete it to run it again"):
        run(tmp_path, theta=RATIOS[:1])


def test_results_are_good_up_to_the_travel_reached_and_nan_beyond(tmp_path: Path) -> None:
    campaign = run(tmp_path, Toy(fails_above=0.9), RATIOS[:5], max_failure_rate=0.5)
    good = campaign.good
    np.testing.assert_array_equal(good[[0, 2, 4]], True)
    np.testing.assert_array_equal(good[1], [True, False, False])
    for values in (campaign.force, campaign.displacement, campaign.force_gradient):
        known = np.isfinite(values).reshape(*good.shape, -1)
        np.testing.assert_array_equal(known, np.broadcast_to(good[..., None], known.shape))
    np.testing.assert_array_equal(campaign.force[1, 0], Toy()(RATIOS[1]).force[0])
    assert campaign.n_failed == 2


def test_numbers_beyond_the_travel_reached_are_never_handed_on() -> None:
    response = Toy()(RATIOS[0])
    stopped = replace(response, reached=1.0, status=Status.STOPPED)
    campaign = Campaign(RATIOS[:1], (stopped,), 0)
    np.testing.assert_array_equal(campaign.good, [[True, True, False]])
    assert np.isnan(campaign.force[0, 2]) and np.isfinite(stopped.force[2])
    hole = replace(response, force=np.array([0.6, np.nan, 1.4]))
    assert Campaign(RATIOS[:1], (hole,), 0).good.tolist() == [[True, False, False]]


def test_an_unstable_equilibrium_is_good_but_not_stable() -> None:
    buckled = replace(Toy()(RATIOS[0]), negative_pivots=np.array([0, 1, 0]))
    campaign = Campaign(RATIOS[:2], (buckled, Toy()(RATIOS[1])), 0)
    assert campaign.good.all()
    assert campaign.stable.tolist() == [[True, False, True], [True] * 3]


def test_gradients_are_lined_up_by_name_and_unknown_where_a_run_has_none() -> None:
    first, second = Toy()(RATIOS[0]), Toy()(RATIOS[1])
    second = replace(second, parameters=("s", "friction"))
    campaign = Campaign(RATIOS[:2], (first, second), 0)
    assert campaign.gradient_parameters == ("r", "s", "friction")
    np.testing.assert_array_equal(campaign.force_gradient[0, :, :2], first.force_gradient)
    np.testing.assert_array_equal(campaign.force_gradient[1, :, 1:], second.force_gradient)
    assert np.isnan(campaign.force_gradient[0, :, 2]).all()
    assert np.isnan(campaign.displacement_gradient[1, ..., 0]).all()


def test_runs_at_other_travels_are_no_campaign() -> None:
    first = Toy()(RATIOS[0])
    other = replace(first, travel=np.array([0.6, 1.0, 1.2]))
    with pytest.raises(ValueError, match=r"expected the travels \[0.6, 1.0, 1.4\] mm in all runs"):
        Campaign(RATIOS[:2], (first, other), 0)


def test_a_failed_campaign_names_its_parameters(tmp_path: Path) -> None:
    plan = CampaignPlan(Toy(fails_above=-1.0), RATIOS, tmp_path / "stuck")
    with pytest.raises(
        CampaignFailed, match=r"stuck: 2 of 6 runs failed .* narrow the range of r, s"
    ):
        run_campaigns([plan])


@pytest.mark.parametrize(
    ("theta", "parameters", "message"),
    [
        ([[0.1, 0.2]], PARAMETERS, r"theta: expected 3 columns \(r, height, pin\), found 2"),
        ([[0.1, 2.5, 2.0]], PARAMETERS, "pin: expected the index of one of bar, round .* found 2"),
        ([[0.1, 2.5, 0.5]], PARAMETERS, "pin: expected the index .* found 0.5"),
        ([[0.1, 2.5, -1.0]], PARAMETERS, "pin: expected the index .* found -1"),
        ([[0.1, 2.5]], (HEIGHT, HEIGHT), "parameters: expected different names"),
        ([[]], (), r"parameters: expected different names, found None"),
    ],
)
def test_a_design_that_does_not_fit_its_parameters_is_refused(
    theta: list[list[float]], parameters: tuple[Parameter, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        checked_theta(theta, parameters)


@pytest.mark.parametrize("levels", [("bar",), ("bar", "bar")])
def test_levels_that_do_not_differ_are_refused(levels: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="levels: expected two or more different levels of pin"):
        Parameter("pin", "1", "factor", levels)


@pytest.mark.parametrize("rate", [float("nan"), 20.0, -1.0])
def test_a_failure_rate_that_is_no_share_is_refused(tmp_path: Path, rate: float) -> None:
    with pytest.raises(ValueError, match="max_failure_rate: expected a share from 0 to 1"):
        run(tmp_path, Toy(), RATIOS[:2], max_failure_rate=rate)


@pytest.mark.parametrize("theta", ["x", [[0.1, 0.2], [0.3]], [[1j, 0.2]], [[True, 0.2]], None])
def test_a_design_of_anything_but_numbers_is_refused_in_a_sentence(theta: object) -> None:
    with pytest.raises(ValueError, match="theta: expected an \\(n, d\\) array of real numbers"):
        checked_theta(theta, PARAMETERS)  # type: ignore[arg-type]
