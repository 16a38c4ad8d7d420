"""Campaigns in processes: the same bits for any number of workers, whatever stops them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from toy_simulation import FINGERPRINT, MANY, RATIOS, Toy, assert_same, files, run

from fe.campaign_parameters import RATIOS as R_AND_S
from fe.executors import process_map
from fe.run_files import keep_run


@pytest.mark.lasting
def test_one_and_two_worker_processes_give_the_same_bits(tmp_path: Path) -> None:
    reference = run(tmp_path / "a", map_fn=process_map(1))
    campaign = run(tmp_path / "b", map_fn=process_map(2))
    assert_same(reference, campaign)
    assert files(tmp_path / "a") == files(tmp_path / "b")
    assert (tmp_path / "a/manifest.json").read_text() == (tmp_path / "b/manifest.json").read_text()


SCRIPT = """
import signal
import sys
from pathlib import Path
# Started from a background job, a process inherits that interrupts are ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.path.insert(0, {tests!r})
import toy_simulation as t
from fe.campaign import run_campaign
from fe.campaign_parameters import RATIOS as R_AND_S
from fe.executors import process_map
if __name__ == "__main__":
    simulate = t.Toy(seconds={seconds}, log={log!r})
    print("started", flush=True)
    run_campaign(
        simulate, t.RATIOS, Path(sys.argv[1]), fingerprint=t.FINGERPRINT,
        map_fn=process_map({n_workers}),
    )
"""


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}


def _start_campaign(folder: Path, n_workers: int, seconds: float) -> subprocess.Popen[str]:
    script = folder / "script.py"
    script.write_text(
        SCRIPT.format(
            tests=str(Path(__file__).parent),
            seconds=seconds,
            log=str(folder / "log"),
            n_workers=n_workers,
        )
    )
    return subprocess.Popen(
        [sys.executable, str(script), str(folder / "store")],
        env=_environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def _wait_until(condition: Callable[[], bool], what: str, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"not within {seconds} s: {what}"
        time.sleep(0.01)


def _n_started(folder: Path) -> int:
    log = folder / "log"
    return len(log.read_text().splitlines()) if log.exists() else 0


def _session_is_empty(session: int) -> bool:
    try:
        os.killpg(session, 0)
    except ProcessLookupError:
        return True
    return False


@pytest.mark.lasting
@pytest.mark.parametrize(("n_workers", "n_kills"), [(0, 12), (2, 5)])
def test_a_campaign_killed_again_and_again_ends_with_the_same_bits(
    tmp_path: Path, n_workers: int, n_kills: int
) -> None:
    # Kills fall anywhere: while workers start, within a run, within the writing of a file.
    store = tmp_path / "store"
    program = Path(__file__).parent / "kill_again_and_again.py"
    command = [sys.executable, str(program), str(store), str(n_workers), str(n_kills)]
    result = subprocess.run(
        command, capture_output=True, text=True, timeout=300, check=False, env=_environment()
    )
    assert result.returncode == 0, result.stderr
    n_kept = int(result.stdout)
    assert n_kills - 1 <= n_kept < len(MANY)

    resumed = run(store, theta=MANY)
    undisturbed = run(tmp_path / "undisturbed", theta=MANY)
    assert resumed.n_reused == n_kept
    assert_same(resumed, undisturbed)
    assert files(store) == files(tmp_path / "undisturbed")
    manifests = [path / "manifest.json" for path in (store, tmp_path / "undisturbed")]
    assert manifests[0].read_bytes() == manifests[1].read_bytes()


@pytest.mark.lasting
def test_ctrl_c_ends_the_workers_at_once_and_keeps_the_finished_runs(tmp_path: Path) -> None:
    process = _start_campaign(tmp_path, n_workers=2, seconds=600.0)
    store = tmp_path / "store"
    store.mkdir()
    keep_run(store, 0, RATIOS[0], R_AND_S, FINGERPRINT, Toy()(RATIOS[0]))
    _wait_until(lambda: _n_started(tmp_path) >= 2, "two runs under way")
    os.killpg(process.pid, signal.SIGINT)  # what a terminal does: parent and workers get it
    # On a busy machine this may take a while, but never as long as a run.
    _, errors = process.communicate(timeout=120.0)
    assert errors.count("Traceback") == 1 and errors.rstrip().endswith("KeyboardInterrupt")
    _wait_until(lambda: _session_is_empty(process.pid), "workers gone")
    assert len(files(store)) == 1
    runs = json.loads((store / "manifest.json").read_text())["runs"]
    assert [run["status"] for run in runs] == ["converged"] + ["missing"] * 5
