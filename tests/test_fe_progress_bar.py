"""The bar says how long it will take, whatever was found finished."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from toy_simulation import MANY, Toy, run

from fe.executors import MapFn, process_map, serial_map
from fe.progress_bar import progress_bar, told_one_by_one
from fe.response import Response


class Clock:
    """A clock that only moves when told to."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr("tqdm.std.time", found)
    return found


def _seconds_left(bar: str) -> list[int]:
    found = re.findall(r"\[\d\d:\d\d<(\d\d):(\d\d)", bar)
    return [60 * int(minutes) + int(seconds) for minutes, seconds in found]


def test_the_time_left_is_that_of_the_runs_left(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    with progress_bar("simulate", "run") as progress:
        for done in range(11):
            progress(done, 10)
            clock.now += 8.0
    # Ten runs, one each 8 s: after each, 8 s times those left.
    assert _seconds_left(capsys.readouterr().err)[:10] == [8 * left for left in range(9, -1, -1)]


@pytest.mark.parametrize("n_reused", [0, 50])
def test_reused_runs_do_not_count_as_speed(
    clock: Clock,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    n_reused: int,
) -> None:
    design = MANY[:60]
    if n_reused:
        run(tmp_path, theta=design[:n_reused])

    def slow(theta: Any) -> Response:
        clock.now += 5.0
        return Toy()(theta)

    with progress_bar("simulate", "run") as progress:
        run(tmp_path, slow, design, progress=progress)
    left = _seconds_left(capsys.readouterr().err)
    n_to_do = len(design) - n_reused
    assert left[0] == 5 * (n_to_do - 1), "after the first run"
    assert left[-1] == 0


def test_a_hidden_bar_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    report: Callable[[int, int], None]
    with progress_bar("simulate", "run", shown=False) as report:
        report(0, 2)
        report(2, 2)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("map_fn", [serial_map, process_map(2)], ids=["serial", "processes"])
def test_the_bar_of_a_campaign_ends_with_all_runs(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, map_fn: MapFn
) -> None:
    with progress_bar("simulate", "run") as progress:
        run(tmp_path, theta=MANY[:5], progress=progress, map_fn=map_fn)
    last = capsys.readouterr().err.split("\r")[-1]
    assert "5/5" in last and _seconds_left(last) == [0]


def test_pieces_of_a_long_work_are_told_before_the_first_is_done(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    pieces = told_one_by_one("evidence", ["stuck", "sliding"])
    assert next(pieces) == "stuck"
    assert "evidence:   0%" in capsys.readouterr().err
    assert list(pieces) == ["sliding"]
    assert "2/2" in capsys.readouterr().err
