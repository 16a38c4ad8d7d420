"""Maps over processes: one thread each, every index once, and the truth when one fails."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from toy_simulation import RATIOS, Raises, Toy, run

from fe.executors import SINGLE_THREAD, WorkerDied, process_map, serial_map
from fe.response import Response

PATIENCE = 60.0
"""seconds for what takes much less"""


@dataclass(frozen=True)
class Dies:
    """A simulation whose process is killed."""

    def __call__(self, ratios: np.ndarray) -> Response:
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError


def _thread_environment(_: int) -> dict[str, str | None]:
    return {name: os.environ.get(name) for name in SINGLE_THREAD}


def _square(x: int) -> int:
    time.sleep(0.05 * (x % 2))
    return x * x


def test_an_exception_of_the_simulation_reaches_the_caller_from_a_worker(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="r must be below 1") as caught:
        run(tmp_path, Raises(), map_fn=process_map(1))
    of_run, of_worker = caught.value.__notes__
    assert of_run == f"in run 0 of {tmp_path}: r = 0, s = 0"
    assert "in a worker process" in of_worker and "in __call__" in of_worker


def test_a_killed_worker_is_reported_with_its_signal_and_run(tmp_path: Path) -> None:
    with pytest.raises(WorkerDied, match=r"exit code -9") as caught:
        run(tmp_path, Dies(), RATIOS[2:3], map_fn=process_map(2))
    r, s = RATIOS[2]
    assert caught.value.__notes__ == [f"in run 0 of {tmp_path}: r = {r:g}, s = {s:g}"]


def _wait_for(exists: Callable[[], bool], what: str) -> None:
    end = time.monotonic() + PATIENCE
    while not exists():
        assert time.monotonic() < end, f"not within {PATIENCE} s: {what}"
        time.sleep(0.01)


def _answers_at_length(item: tuple[str, Path]) -> bytes:
    """The long answer is larger than a pipe holds, and its worker is killed while it sends it."""
    what, folder = item
    if what == "long":
        _wait_for((folder / "other is here").exists, "the other answer")
        script = f"sleep 0.7; kill -9 {os.getpid()}; touch '{folder}/killed'"
        subprocess.Popen(["/bin/sh", "-c", script])
        return bytes(50_000_000)
    return b""


def test_a_worker_killed_while_it_answers_is_reported_as_dead(tmp_path: Path) -> None:
    mapped = process_map(2)(_answers_at_length, [("long", tmp_path), ("short", tmp_path)])
    assert next(mapped)[0] == 1
    (tmp_path / "other is here").touch()
    _wait_for((tmp_path / "killed").exists, "the kill")
    with pytest.raises(WorkerDied) as caught:
        list(mapped)
    assert caught.value.index == 0


def _in_turn(item: tuple[str, Path]) -> str:
    what, folder = item
    if what == "dies":
        _wait_for((folder / "third").exists, "the third item")
        os.kill(os.getpid(), signal.SIGKILL)
    (folder / what).touch()
    return what


def test_what_others_have_finished_when_a_worker_dies_is_not_lost(tmp_path: Path) -> None:
    """The caller writes the first result while one worker dies and the other ends the third."""
    before = {process.pid for process in multiprocessing.active_children()}
    arrived = []
    items = [(what, tmp_path) for what in ("dies", "first", "third", "fourth")]
    with pytest.raises(WorkerDied) as caught:
        for index, _ in process_map(2)(_in_turn, items):
            arrived.append(index)
            if len(arrived) == 1:
                _wait_for(lambda: _n_children_but(before) == 1, "the death of a worker")
                time.sleep(1.0)  # the third is on its way: pickled and sent
    assert set(arrived) == {1, 2} and caught.value.index == 0


def _n_children_but(known: set[int | None]) -> int:
    return sum(process.pid not in known for process in multiprocessing.active_children())


def test_a_simulation_that_cannot_be_pickled_is_refused_before_any_process_starts(
    tmp_path: Path,
) -> None:
    with pytest.raises(ValueError, match="simulate: must be picklable"):
        run(tmp_path, lambda ratios: Toy()(ratios), map_fn=process_map(1))


def test_a_worker_sees_one_thread_and_the_parent_keeps_its_environment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    ((_, seen),) = process_map(1)(_thread_environment, [0])
    assert seen == SINGLE_THREAD
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "MKL_NUM_THREADS" not in os.environ


@pytest.mark.parametrize("n_items", [0, 1, 5])
def test_maps_yield_every_index_once(n_items: int) -> None:
    items = list(range(n_items))
    expected = [(i, i * i) for i in items]
    assert list(serial_map(_square, items)) == expected
    assert sorted(process_map(2)(_square, items)) == expected


@pytest.mark.parametrize("n", [-1, 1.5])
def test_what_is_no_number_of_workers_is_refused(n: float) -> None:
    with pytest.raises(ValueError, match=f"n_workers: must be 0 .* got {n}"):
        process_map(n)
