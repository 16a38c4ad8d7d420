"""Campaigns: every run once, kept in one file, refused when it is not what it was."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from toy_simulation import FINGERPRINT, RATIOS, Raises, Toy, assert_same, files, run

from fe.campaign import CampaignFailed, run_campaign
from fe.campaign_parameters import RATIOS as R_AND_S
from fe.campaign_result import Campaign
from fe.executors import serial_map
from fe.response import Response, Status
from fe.run_files import run_key
from fe.specimens.uniaxial import Bar, UniaxialModel


def test_results_follow_the_design_and_each_run_has_one_file(tmp_path: Path) -> None:
    campaign = run(tmp_path)
    assert len(files(tmp_path)) == len(RATIOS)
    for row, response in zip(RATIOS, campaign.responses, strict=True):
        np.testing.assert_array_equal(response.force, Toy()(row).force)
    assert campaign.reached.all() and campaign.n_reused == 0


def test_a_finished_campaign_is_not_run_again(tmp_path: Path) -> None:
    first = run(tmp_path / "store")
    again = run(tmp_path / "store", Raises())
    assert_same(first, again)
    assert again.n_reused == len(RATIOS)


def test_a_changed_design_runs_only_its_new_points(tmp_path: Path) -> None:
    run(tmp_path / "store", theta=RATIOS[:4])
    log = tmp_path / "log"
    changed = np.vstack([[0.9, 0.4], RATIOS[3], RATIOS[1]])
    campaign = run(tmp_path / "store", Toy(log=str(log)), theta=changed)
    assert log.read_text().splitlines() == ["[0.9, 0.4]"]
    assert campaign.n_reused == 2
    np.testing.assert_array_equal(campaign.responses[1].force, Toy()(RATIOS[3]).force)


def test_a_changed_fingerprint_runs_everything_again(tmp_path: Path) -> None:
    run(tmp_path)
    other = run_campaign(Toy(), RATIOS, tmp_path, fingerprint={**FINGERPRINT, "bulk_ratio": 100.0})
    assert other.n_reused == 0
    assert len(files(tmp_path)) == 2 * len(RATIOS)


def test_equal_points_are_run_once(tmp_path: Path) -> None:
    log = tmp_path / "log"
    ratios = np.array([[0.0, 0.2], [0.5, 0.2], [-0.0, 0.2]])
    campaign = run(tmp_path / "store", Toy(log=str(log)), theta=ratios)
    assert len(log.read_text().splitlines()) == 2
    np.testing.assert_array_equal(campaign.force[0], campaign.force[2])


def test_the_key_depends_on_every_bit_of_the_ratios_and_on_the_fingerprint_alone() -> None:
    here = np.array([0.1, 0.2])
    reordered = dict(reversed(FINGERPRINT.items()))
    key = run_key(here, R_AND_S, FINGERPRINT)
    assert key == run_key(here.copy(), R_AND_S, reordered)
    assert key != run_key(np.nextafter(here, 1.0), R_AND_S, FINGERPRINT)
    assert key != run_key(here[::-1], R_AND_S, FINGERPRINT)
    assert key != run_key(here, R_AND_S[::-1], FINGERPRINT)


def test_an_interrupt_in_the_parent_closes_the_map_and_keeps_what_arrived(tmp_path: Path) -> None:
    closed: list[bool] = []

    def interrupted(f: Callable[[Any], Any], items: Sequence[Any], /) -> Iterator[tuple[int, Any]]:
        try:
            yield 3, f(items[3])
            raise KeyboardInterrupt
        finally:
            closed.append(True)

    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, map_fn=interrupted)
    assert closed == [True]
    assert [name[:8] for name in files(tmp_path)] == ["run_0003"]
    assert run(tmp_path).n_reused == 1


@pytest.mark.parametrize("damage", ["truncate", "flip", "empty"])
def test_a_damaged_run_is_refused_by_name(tmp_path: Path, damage: str) -> None:
    run(tmp_path)
    path = sorted(tmp_path.glob("run_*.npz"))[2]
    content = bytearray(path.read_bytes())
    if damage == "flip":
        content[bytes(content).index(Toy()(RATIOS[2]).force.tobytes())] ^= 4
    path.write_bytes({"truncate": content[:700], "flip": content, "empty": b""}[damage])
    with pytest.raises(ValueError, match=f"{path.name}.*delete it to run it again"):
        run(tmp_path)
    path.unlink()
    assert run(tmp_path).n_reused == len(RATIOS) - 1


def test_any_flipped_byte_of_a_run_is_either_harmless_or_refused_by_name(tmp_path: Path) -> None:
    one = RATIOS[:1]
    reference = run(tmp_path, theta=one)
    path = next(tmp_path.glob("run_*.npz"))
    intact = path.read_bytes()
    n_refused = 0
    for position in np.random.default_rng(0).integers(0, len(intact), size=200):
        content = bytearray(intact)
        content[position] ^= 0xFF
        path.write_bytes(content)
        try:
            campaign = run(tmp_path, theta=one)
        except ValueError as error:
            assert path.name in str(error)
            n_refused += 1
        else:
            assert_same(reference, campaign)
    assert n_refused > 100


def test_a_run_under_the_name_of_another_is_refused_as_foreign(tmp_path: Path) -> None:
    run(tmp_path)
    first, second, *_ = sorted(tmp_path.glob("run_*.npz"))
    second.write_bytes(first.read_bytes())
    with pytest.raises(ValueError, match=f"{second.name}: foreign run"):
        run(tmp_path)


def test_a_file_that_is_not_of_a_campaign_is_refused_by_name(tmp_path: Path) -> None:
    np.savez(tmp_path / "run_best.npz", a=np.ones(2))
    with pytest.raises(ValueError, match=r"run_best\.npz: not a file of a campaign"):
        run(tmp_path)


def test_a_failed_run_is_kept_with_its_status_and_not_repeated(tmp_path: Path) -> None:
    simulate = Toy(fails_above=0.9)
    ratios = np.vstack([RATIOS[1], np.column_stack([np.linspace(0, 0.8, 6), np.full(6, 0.1)])])
    campaign = run(tmp_path, simulate, theta=ratios)
    assert campaign.n_failed == 1
    assert campaign.responses[0].status is Status.STOPPED
    np.testing.assert_array_equal(campaign.reached, [False] + [True] * 6)
    again = run(tmp_path, Raises(), theta=ratios)
    assert again.n_failed == 1 and again.n_reused == 7
    runs = json.loads((tmp_path / "manifest.json").read_text())["runs"]
    assert runs[0]["status"] == "stopped" and runs[0]["reached_mm"] == 0.8


def test_a_converged_run_with_numbers_that_are_not_finite_does_not_count_as_reached() -> None:
    response = Toy()(RATIOS[0])
    broken = replace(response, displacement=response.displacement * np.nan)
    campaign = Campaign(RATIOS[:2], (response, broken), 0)
    assert campaign.reached.tolist() == [True, False]


def test_a_campaign_stops_as_soon_as_too_many_runs_have_failed(tmp_path: Path) -> None:
    ratios = np.column_stack([np.linspace(1.0, 0.0, 10), np.zeros(10)])
    with pytest.raises(CampaignFailed, match="3 of 10 runs failed") as caught:
        run(tmp_path, Toy(fails_above=0.5), theta=ratios)
    assert (caught.value.n_failed, caught.value.n_done, caught.value.n_total) == (3, 3, 10)
    assert len(files(tmp_path)) == 3


def test_a_campaign_with_too_many_failed_runs_is_not_finished_by_asking_again(
    tmp_path: Path,
) -> None:
    ratios = np.column_stack([np.linspace(1.0, 0.0, 10), np.zeros(10)])
    with pytest.raises(CampaignFailed, match="3 of 10 runs failed"):
        run(tmp_path, Toy(fails_above=0.5), theta=ratios)
    run(tmp_path, Toy(fails_above=0.5), theta=ratios, max_failure_rate=1.0)
    with pytest.raises(CampaignFailed, match="failed \\(10 done\\)"):
        run(tmp_path, Toy(fails_above=0.5), theta=ratios)


def test_runs_of_other_fields_are_refused_by_their_row(tmp_path: Path) -> None:
    first = Toy()(RATIOS[0])
    more = np.concatenate([first.displacement, first.displacement], axis=1)
    slopes = np.concatenate([first.displacement_gradient] * 2, axis=1)
    other = replace(first, displacement=more, displacement_gradient=slopes)
    with pytest.raises(ValueError, match=r"responses: expected fields of .* in run 1"):
        Campaign(RATIOS[:2], (first, other), 0)


@pytest.mark.parametrize(
    ("owner", "name", "number"), [(Path, "open", errno.EMFILE), (np, "load", errno.EIO)]
)
def test_a_run_that_cannot_be_opened_or_read_is_not_called_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, owner: Any, name: str, number: int
) -> None:
    run(tmp_path)

    def failing(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patch, pytest.raises(OSError, match=os.strerror(number)):
        patch.setattr(owner, name, failing)
        run(tmp_path)
    assert run(tmp_path).n_reused == len(RATIOS)


def test_forces_that_are_no_real_numbers_are_refused() -> None:
    response = Toy()(RATIOS[0])
    with pytest.raises(ValueError, match="force: expected real numbers, found complex128"):
        replace(response, force=response.force * 1j)


@pytest.mark.parametrize("content", [b"x\n", bytes(2000)])
def test_a_file_that_is_no_npz_is_not_called_a_pickle(tmp_path: Path, content: bytes) -> None:
    run(tmp_path)
    sorted(tmp_path.glob("run_*.npz"))[1].write_bytes(content)
    with pytest.raises(ValueError, match=r"damaged run .*expected an npz file") as caught:
        run(tmp_path)
    assert "pickle" not in str(caught.value)


def test_a_fifth_of_failed_runs_is_still_accepted(tmp_path: Path) -> None:
    ratios = np.column_stack([np.linspace(1.0, 0.0, 10), np.zeros(10)])
    assert run(tmp_path, Toy(fails_above=0.85), theta=ratios).n_failed == 2


def test_progress_counts_from_the_reused_runs_to_all(tmp_path: Path) -> None:
    run(tmp_path, theta=RATIOS[:2])
    calls: list[tuple[int, int]] = []
    run(tmp_path, progress=lambda done, total: calls.append((done, total)))
    assert calls == [(2, 6), (3, 6), (4, 6), (5, 6), (6, 6)]


@pytest.mark.parametrize(
    ("theta", "message"),
    [
        (np.ones(3), r"theta: must be a non-empty \(n, d\) array, got shape \(3,\)"),
        (np.ones((0, 2)), r"got shape \(0, 2\)"),
        (np.array([[0.1, 0.2], [np.nan, 0.2]]), "theta: must be finite, got .* in row 1"),
    ],
)
def test_what_is_no_design_is_refused(tmp_path: Path, theta: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        run(tmp_path, theta=theta)


@pytest.mark.parametrize("value", [np.ones(2), float("nan"), {1, 2}])
def test_a_fingerprint_that_is_not_json_is_refused(tmp_path: Path, value: object) -> None:
    with pytest.raises(ValueError, match="fingerprint: must consist of finite JSON values"):
        run_campaign(Toy(), RATIOS, tmp_path, fingerprint={"mesh": value})


def test_a_model_with_forces_asked_is_refused_before_anything_runs(tmp_path: Path) -> None:
    model = UniaxialModel(Bar(), force=(0.5, 1.0))
    with pytest.raises(ValueError, match=r"expected a model with travels asked, .* found forces"):
        run_campaign(model, np.array([[0.3, 0.1]]), tmp_path / "store")
    assert not (tmp_path / "store").exists()


def test_an_exception_of_a_simulation_says_of_which_run_it_is(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="r must be below 1") as found:
        run(tmp_path / "store", Raises(), map_fn=serial_map)
    assert f"in run 0 of {tmp_path / 'store'}: r = 0, s = 0" in found.value.__notes__


def test_a_result_that_is_no_response_is_refused_and_what_was_done_is_kept(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="expected a Response, found NoneType") as found:
        run(tmp_path, lambda row: Toy()(row) if row[0] < 0.9 else None)
    assert f"in run 1 of {tmp_path}: r = 1, s = 0" in found.value.__notes__
    assert len(files(tmp_path)) == 1


def test_a_store_may_be_a_text_and_a_design_hold_numbers_of_numpy(tmp_path: Path) -> None:
    run_campaign(Toy(), RATIOS, str(tmp_path), fingerprint=FINGERPRINT, design={"n": np.int64(6)})
    assert json.loads((tmp_path / "manifest.json").read_text())["design"] == {"n": 6}
    with pytest.raises(ValueError, match="design: must consist of finite JSON values"):
        run(tmp_path, design={"points": RATIOS})


@dataclass(frozen=True)
class _Linear:
    constant: float

    def factor(self) -> float:
        return self.constant


@dataclass(frozen=True)
class _Square:
    constant: float

    def factor(self) -> float:
        return self.constant**2


@dataclass(frozen=True)
class _OfLaw:
    law: _Linear | _Square

    def __call__(self, ratios: np.ndarray) -> Response:
        found = Toy(factor=self.law.factor())(ratios)
        ratios *= 1000.0  # a model may use its argument as it likes
        return found


def test_runs_under_a_law_of_another_class_with_the_same_fields_are_not_reused(
    tmp_path: Path,
) -> None:
    linear = run_campaign(_OfLaw(_Linear(3.0)), RATIOS[:2], tmp_path)
    square = run_campaign(_OfLaw(_Square(3.0)), RATIOS[:2], tmp_path)
    assert square.n_reused == 0
    np.testing.assert_allclose(square.force, 3.0 * linear.force)


def test_a_model_that_writes_to_its_argument_leaves_design_and_keys_alone(tmp_path: Path) -> None:
    theta = RATIOS[:2].copy()
    first = run_campaign(_OfLaw(_Linear(3.0)), theta, tmp_path)
    np.testing.assert_array_equal(first.theta, RATIOS[:2])
    assert run_campaign(_OfLaw(_Linear(3.0)), RATIOS[:2], tmp_path).n_reused == 2


def test_a_store_that_is_a_file_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("")
    with pytest.raises(ValueError, match=r"store: expected a folder, found the file .*runs"):
        run_campaign(Toy(), RATIOS[:2], tmp_path / "runs", fingerprint=FINGERPRINT)
