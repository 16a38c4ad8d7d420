"""A campaign on a Dask cluster gives what it gives in worker processes, whoever is killed."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from toy_simulation import FINGERPRINT, RATIOS, Raises, Toy, assert_same, files, run

from fe import Response, dask_map, dask_workers, process_map, progress_bar, run_campaign
from fe.executors import SINGLE_THREAD, WorkerDied

distributed = pytest.importorskip("distributed")

PATIENCE = 60.0
"""seconds for what takes much less"""


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0"
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as connected,
    ):
        yield connected


def _wait(x: float) -> float:
    time.sleep(x)
    return -x


def test_a_campaign_has_the_bits_of_one_in_worker_processes(client: Any, tmp_path: Path) -> None:
    found = [
        run_campaign(Toy(), RATIOS, tmp_path / name, fingerprint=FINGERPRINT, map_fn=map_fn)
        for name, map_fn in (("dask", dask_map(client)), ("processes", process_map(1)))
    ]
    assert found[0].force.tobytes() == found[1].force.tobytes()
    assert found[0].displacement.tobytes() == found[1].displacement.tobytes()


def test_the_bar_of_a_campaign_ends_with_all_runs(
    client: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with progress_bar("simulate", "run") as progress:
        run_campaign(
            Toy(),
            RATIOS,
            tmp_path,
            fingerprint=FINGERPRINT,
            map_fn=dask_map(client),
            progress=progress,
        )
    assert f"{len(RATIOS)}/{len(RATIOS)} [" in capsys.readouterr().err.split("\r")[-1]


def _wait_for(exists: Callable[[], bool], what: str) -> None:
    end = time.monotonic() + PATIENCE
    while not exists():
        assert time.monotonic() < end, f"not within {PATIENCE} s: {what}"
        time.sleep(0.01)


def _after(awaited: Path | None) -> bool:
    if awaited is not None:
        _wait_for(awaited.exists, "the other result")
    return True


def test_results_come_as_they_are_ready(client: Any, tmp_path: Path) -> None:
    awaited = tmp_path / "second is here"
    results = dask_map(client)(_after, [awaited, None])
    assert next(results) == (1, True)
    awaited.touch()
    assert list(results) == [(0, True)]
    assert list(dask_map(client)(_wait, [])) == []


def test_closing_the_map_cancels_what_has_not_begun(client: Any) -> None:
    results = dask_map(client)(_wait, [0.0] + 50 * [1.0])
    assert next(results) in [(0, -0.0), (1, -1.0)]  # the first may wait for its worker to import
    results.close()  # type: ignore[attr-defined]
    begin = time.monotonic()
    assert list(dask_map(client)(_wait, [0.1])) == [(0, -0.1)]
    assert time.monotonic() - begin < 12.0  # 25 s if the other runs were waited for


def test_an_exception_of_the_simulation_reaches_the_caller(client: Any, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="r must be below 1"):
        run_campaign(
            Raises(), np.ones((1, 2)), tmp_path, fingerprint=FINGERPRINT, map_fn=dask_map(client)
        )


def _fails_after(item: tuple[str, Path]) -> str:
    what, folder = item
    if what == "fails":
        _wait_for((folder / "first is here").exists, "the first result")
    if what == "third":
        _wait_for((folder / "fails").exists, "the item that fails")
        time.sleep(0.5)  # so that it fails first
    (folder / what).touch()
    if what == "fails":
        raise ValueError(what)
    return what


def test_what_others_have_finished_when_one_fails_is_not_lost(client: Any, tmp_path: Path) -> None:
    """The caller writes the first result while the second item fails and the third ends."""
    arrived = []
    items = [(what, tmp_path) for what in ("first", "fails", "third")]
    with pytest.raises(ValueError, match="fails"):
        for index, _ in dask_map(client)(_fails_after, items):
            arrived.append(index)
            if len(arrived) == 1:
                (tmp_path / "first is here").touch()
                _wait_for((tmp_path / "third").exists, "the third item")
                time.sleep(1.0)  # the scheduler is told
    assert sorted(arrived) == [0, 2]


@dataclass(frozen=True)
class Noted:
    """The toy, which notes in a file what it runs and in which process; its fourth run stays."""

    log: str

    def __call__(self, theta: np.ndarray) -> Response:
        with open(self.log, "a") as stream:
            stream.write(f"{os.getpid()} {theta.tolist()}\n")
        if _lines(self.log)[3:4] == [f"{os.getpid()} {theta.tolist()}"]:
            time.sleep(PATIENCE)  # until it is killed
        return Toy(seconds=0.3)(theta)


def _lines(log: str | Path) -> list[str]:
    return Path(log).read_text().splitlines() if Path(log).exists() else []


def _kill_fourth_of(log: Path, killed: list[str]) -> None:
    """Kill the process of the fourth line, which has finished a run before, in its run."""
    _wait_for(lambda: len(_lines(log)) >= 4, "the fourth run")
    killed.append(_lines(log)[3])
    time.sleep(1.0)  # the result before has been handed over by then
    os.kill(int(killed[0].split()[0]), signal.SIGKILL)


def test_a_run_whose_worker_is_killed_is_repeated_elsewhere_with_the_same_bits(
    client: Any, tmp_path: Path
) -> None:
    log, killed = tmp_path / "log", list[str]()
    killer = threading.Thread(target=_kill_fourth_of, args=(log, killed), daemon=True)
    killer.start()
    progress: list[tuple[int, int]] = []
    campaign = run(
        tmp_path / "dask",
        Noted(str(log)),
        map_fn=dask_map(client),
        progress=lambda done, total: progress.append((done, total)),
    )
    killer.join(timeout=10.0)
    [line] = killed
    process, _, theta = line.partition(" ")
    runs = [entry.partition(" ")[::2] for entry in log.read_text().splitlines()]
    first, again = (found for found, what in runs if what == theta)
    assert first == process != again
    assert len(runs) == len(RATIOS) + 1, "nothing but the killed run was repeated"
    undisturbed = run(tmp_path / "undisturbed", Toy())
    assert_same(campaign, undisturbed)
    assert files(tmp_path / "dask") == files(tmp_path / "undisturbed")
    assert progress == [(done, len(RATIOS)) for done in range(len(RATIOS) + 1)]


@dataclass(frozen=True)
class Deadly:
    """A simulation that ends whatever process it runs in."""

    def __call__(self, theta: np.ndarray) -> Response:
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError


def test_a_run_that_kills_every_worker_ends_the_campaign_and_says_so(tmp_path: Path) -> None:
    with (
        dask_workers(n_workers=1) as map_fn,
        pytest.raises(WorkerDied, match="ended in the same item") as caught,
    ):
        run(tmp_path, Deadly(), RATIOS[:1], map_fn=map_fn)
    assert caught.value.__notes__[0].startswith(f"in run 0 of {tmp_path}: r = ")


def _environment(_: int) -> dict[str, str | None]:
    return {name: os.environ.get(name) for name in SINGLE_THREAD}


def test_workers_started_here_have_one_thread_each(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in SINGLE_THREAD:
        monkeypatch.delenv(name, raising=False)
    with dask_workers(n_workers=1) as map_fn:
        [(_, found)] = map_fn(_environment, [0])
    assert found == SINGLE_THREAD


def test_a_running_scheduler_is_used_by_its_address(client: Any) -> None:
    address = client.scheduler.address
    with dask_workers(address) as map_fn:
        assert sorted(map_fn(_wait, [0.0, 0.1])) == [(0, -0.0), (1, -0.1)]
    assert client.run(os.getpid), "the cluster of others goes on"


@pytest.mark.parametrize("scheduler", ["tcp://127.0.0.1:9", "nonsense://x"])
def test_a_scheduler_that_does_not_answer_is_named(
    scheduler: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fe.dask_executor.CONNECT_SECONDS", 0.3)
    with (
        pytest.raises(ValueError, match=f"scheduler: found none that answers at '{scheduler}'"),
        dask_workers(scheduler),
    ):
        pass


@pytest.mark.parametrize("content", [None, "no JSON", "[1]", '{"id": 3}'])
def test_a_scheduler_file_that_is_none_is_refused_at_once(
    content: str | None, tmp_path: Path
) -> None:
    path = tmp_path / "scheduler.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(ValueError, match="expected an address"), dask_workers(str(path)):
        pass


def test_a_cluster_that_is_closed_is_said_with_what_is_left() -> None:
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0"
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
        pytest.raises(WorkerDied, match="the Dask cluster ended with 3 items to go"),
    ):
        for _ in dask_map(client)(_wait, [0.0, 30.0, 30.0, 30.0]):
            cluster.close()
