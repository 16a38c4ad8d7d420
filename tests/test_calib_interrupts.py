"""Ctrl-C ends what it should, also where Python ignores exceptions, and prints no traceback."""

from __future__ import annotations

import errno
import signal
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from test_calib_inference_identify import posterior

import calib.inference.nested
from calib import asking_verbs
from calib.cli import _sentence
from calib.inference.ensemble import ensemble_sampler
from calib.inference.nested import nested
from calib.interrupts import interrupts_kept
from fe.progress_bar import progress_bar
from surrogate import sobol


class Ends:
    """Raises where nothing can be raised."""

    def __init__(self, error: type[BaseException]) -> None:
        self.error = error

    def __del__(self) -> None:
        raise self.error


def test_an_interrupt_that_is_ignored_comes_again(request: pytest.FixtureRequest) -> None:
    # Processes of pytest-xdist ignore the signal.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, before))
    with pytest.raises(KeyboardInterrupt), interrupts_kept():
        Ends(KeyboardInterrupt)
        time.sleep(10.0)


def test_other_exceptions_that_are_ignored_stay_so(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[type[BaseException] | None] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda found: seen.append(found.exc_type))
    with interrupts_kept():
        Ends(ValueError)
    assert seen == [ValueError]


def test_sobol_points_that_are_all_the_same_are_an_interrupt(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What SciPy gives whose direction numbers were not read."""
    same = SimpleNamespace(random_base2=lambda power: np.full((2**power, 3), 0.3))
    assert sobol.sobol_points(3, 0, 1).shape == (1, 3)
    monkeypatch.setattr(sobol.qmc, "Sobol", lambda *args, **more: same)
    with pytest.raises(KeyboardInterrupt):
        sobol.sobol_points(3, 4, 1)


def test_a_bar_starts_no_thread() -> None:
    """It would be given the Ctrl-C that is blocked while workers start."""
    before = set(threading.enumerate())
    with progress_bar("work", "piece") as report:
        report(0, 2)
        report(1, 2)
        assert set(threading.enumerate()) <= before


def _interrupted(*_: object) -> np.ndarray:
    raise KeyboardInterrupt


def test_samplers_print_nothing_at_an_interrupt(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    sampler = ensemble_sampler(8, 2, _interrupted)
    with pytest.raises(KeyboardInterrupt):
        sampler.run_mcmc(np.random.default_rng(0).random((8, 2)), 2)
    found, calls = calib.inference.nested.log_likelihood, []

    def later(of: object, x: np.ndarray) -> np.ndarray:
        calls.append(0)
        return found(of, x) if len(calls) < 500 else _interrupted()  # type: ignore[arg-type]

    monkeypatch.setattr(calib.inference.nested, "log_likelihood", later)
    with pytest.raises(KeyboardInterrupt):
        nested(posterior(), np.random.default_rng(0), n_live=100)
    said = capsys.readouterr()
    assert said.out == "" and said.err == ""


def test_a_file_where_a_folder_should_be_is_told() -> None:
    found = _sentence(FileExistsError(errno.EEXIST, "File exists", "runs/a/campaign"))
    assert found == "runs/a/campaign: found a file, expected a folder or nothing"
    under = _sentence(NotADirectoryError(errno.ENOTDIR, "Not a directory", "runs/a/campaign/x"))
    assert under == "runs/a/campaign/x: found a file on the way there, expected folders"


def test_answers_name_what_failed_in_the_posterior_that_they_are_of(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    summary = SimpleNamespace(hypothesis="stuck", failures=("r: R-hat is 1.02, above 1.01",))
    monkeypatch.setattr("calib.study.summary.load_summary", lambda path: [summary])
    asking_verbs._say_answer(tmp_path, ["an answer"], [])
    assert "LOOK AT" not in capsys.readouterr().out  # no posterior, nothing asked of it
    (tmp_path / "posterior.nc").touch()
    asking_verbs._say_answer(tmp_path, ["an answer"], [])
    told = capsys.readouterr().out
    assert "LOOK AT  stuck, whose posterior this is of: r: R-hat is 1.02, above 1.01" in told
