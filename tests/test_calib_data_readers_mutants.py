"""Damaged files: a reader answers with a result or with one sentence, soon and in little memory.

`make verify-data` tries 10,000 a reader and the heads of the real files too.
"""

from __future__ import annotations

import pytest

from benchmarks.reader_mutants import Outcome, _try_file, seeds_of, try_mutants
from benchmarks.reader_samples import DIC_SAMPLES, MACHINE_SAMPLES
from calib.data.readers import WrongFile, read_dic

N_MUTANTS = 200


@pytest.mark.lasting
@pytest.mark.parametrize("name", [*DIC_SAMPLES, *MACHINE_SAMPLES])
def test_damaged_files_are_read_or_refused_with_a_sentence(name, tmp_path):
    outcome = try_mutants(name, seeds_of(name, []), N_MUTANTS, tmp_path, seed=1)
    assert outcome.failures == []
    assert outcome.tracebacks == 0
    assert outcome.mutants_tried == N_MUTANTS
    # damage that leaves nothing to read would try the first line of a reader only
    assert outcome.still_read >= 3


def test_mutants_are_the_same_on_every_run(tmp_path):
    name = "DaVis csv"
    first, second = (
        try_mutants(name, seeds_of(name, []), 40, tmp_path, seed=2).still_read for _ in range(2)
    )
    assert first == second


@pytest.mark.parametrize("wrong", [KeyError, RecursionError, MemoryError])
def test_a_traceback_is_counted(wrong, tmp_path):
    def careless(path):
        raise wrong("oops")

    def careful(path):
        raise WrongFile(path, 1, "this", "that")

    outcome = Outcome()
    _try_file(tmp_path / "x", (careless, careful), outcome)
    assert (outcome.mutants_tried, outcome.tracebacks, outcome.still_read) == (1, 1, 0)


def test_a_reader_that_hangs_is_counted(tmp_path, monkeypatch):
    monkeypatch.setattr("benchmarks.reader_mutants.SECONDS_A_FILE", 0.1)

    def slow(path):
        while True:
            pass

    outcome = Outcome()
    _try_file(tmp_path / "x", (slow,), outcome)
    assert outcome.tracebacks == 1
    assert "_TooSlowError" in outcome.failures[0]


@pytest.mark.parametrize(
    "cell", ["1" * 400_000 + "x", " " * 400_000 + "x", "(" * 400_000, "[ " * 40_000 + "]"]
)
def test_a_line_made_to_slow_a_parser_down_does_not(cell, tmp_path):
    """Patterns of numbers and units must be linear in the length of a cell.

    Linear ones take 0.01 s, and 0.5 s for 40,000 columns; quadratic ones many times the
    limit of a file, which tells them apart on a slow machine too.
    """
    head = "x [mm];y [mm];X-displacement [mm];Y-displacement [mm]"
    outcome = Outcome()
    for text in (f"{head}\n1;2;3;{cell}\n", f"{head};{cell}\n1;2;3;4;5\n", f"{cell}\n{head}\n"):
        path = tmp_path / "x.csv"
        path.write_text(text)
        _try_file(path, (read_dic,), outcome)
    assert outcome.failures == []
