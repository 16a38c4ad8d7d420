"""Damage files in seeded ways and see that a reader answers with a result or with WrongFile.

Each mutant is read twice: by the reader of its format, and through the door.  Counted are
mutants, those still read, and tracebacks: any exception but WrongFile, any warning, or more than
SECONDS_A_FILE of processor time for one file.  Seeds are the samples of `reader_samples` and,
where they are there, the first lines of the real files.
"""

from __future__ import annotations

import faulthandler
import re
import resource
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import FrameType

import numpy as np

from benchmarks.reader_samples import DIC_SAMPLES, MACHINE_SAMPLES
from benchmarks.sample_field import MM_PER_PX
from calib.data.readers import DIC_FORMATS, MACHINE_FORMATS, WrongFile, read_dic, read_machine

SECONDS_A_FILE = 5.0
MEMORY_BYTES = 2_000_000_000
"""that a reader may take above what the process has when it begins"""
SEED_LINES = 60

Rng = np.random.Generator
_NUMBER = re.compile(rb"[+-]?\d+\.?\d*(?:[eE][+-]?\d+)?")
STRANGE_NUMBERS = (
    b"1e400", b"-1e308", b"9.9e307", b"9" * 400, b"nan", b"-inf", b"1_0", b"0x1F", b"--1", b"1e",
    b"1,234", b"1.234.567", b"", b"N/A", "٣".encode(), b"1d3", b"1e-999", b"True", b"'1'",
)  # fmt: skip
STRANGE_TEXTS = (
    b",", b";", b"\t", b'"', b"'", b"\0", b"\r", b"\n", b"\n\n", b"=", b"[", b"]", b"(V)", b"[V]",
    b"\xb0", b"\xff\xfe", b"\xef\xbb\xbf", b"#", b"***", b"px", b"\x1a", b"\x85", b"%s", b"{}",
)  # fmt: skip


def _lines(data: bytes) -> list[bytes]:
    return data.split(b"\n")


def _flip(data: bytes, rng: Rng) -> bytes:
    changed = bytearray(data)
    for position in rng.integers(len(data), size=rng.integers(1, 20)):
        changed[position] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _set_bytes(data: bytes, rng: Rng) -> bytes:
    changed = bytearray(data)
    for position in rng.integers(len(data), size=rng.integers(1, 6)):
        changed[position] = int(rng.choice([0, 1, 0x7F, 0x80, 0xFF]))
    return bytes(changed)


def _truncate(data: bytes, rng: Rng) -> bytes:
    return data[: rng.integers(len(data))]


def _cut_out(data: bytes, rng: Rng) -> bytes:
    start, end = np.sort(rng.integers(len(data), size=2))
    return data[:start] + data[end:]


def _repeat_part(data: bytes, rng: Rng) -> bytes:
    start, end = np.sort(rng.integers(len(data), size=2))
    return data[:end] + data[start:end] * int(rng.integers(1, 4)) + data[end:]


def _delete_line(data: bytes, rng: Rng) -> bytes:
    lines = _lines(data)
    del lines[rng.integers(len(lines))]
    return b"\n".join(lines)


def _double_line(data: bytes, rng: Rng) -> bytes:
    lines = _lines(data)
    index = rng.integers(len(lines))
    return b"\n".join([*lines[:index], lines[index], *lines[index:]])


def _swap_lines(data: bytes, rng: Rng) -> bytes:
    lines = _lines(data)
    i, j = rng.integers(len(lines), size=2)
    lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


def _strange_number(data: bytes, rng: Rng) -> bytes:
    found = list(_NUMBER.finditer(data))
    if not found:
        return _flip(data, rng)
    # half of them near the start, where counts and factors stand
    n = len(found) if rng.random() < 0.5 else min(len(found), 12)
    match = found[rng.integers(n)]
    number = STRANGE_NUMBERS[rng.integers(len(STRANGE_NUMBERS))]
    return data[: match.start()] + number + data[match.end() :]


def _strange_text(data: bytes, rng: Rng) -> bytes:
    position = rng.integers(len(data))
    text = STRANGE_TEXTS[rng.integers(len(STRANGE_TEXTS))]
    return data[:position] + text * int(rng.integers(1, 4)) + data[position:]


def _deep(data: bytes, rng: Rng) -> bytes:
    """Up to 200,000 commas, quotes or brackets in one place."""
    position = rng.integers(len(data))
    mark = (b",", b";", b'"', b"[", b"\n", b" ", b"9", b"\0")[rng.integers(8)]
    return data[:position] + mark * int(10 ** rng.uniform(1, 5.3)) + data[position:]


def _encoding(data: bytes, rng: Rng) -> bytes:
    text = data.decode("latin-1")
    encoding = ("utf-16", "utf-8-sig", "utf-16-le", "utf-8", "utf-32")[rng.integers(5)]
    return text.encode(encoding)


def _separators(data: bytes, rng: Rng) -> bytes:
    marks = (b",", b";", b"\t", b" ", b".", b"|")
    i, j = rng.choice(len(marks), size=2, replace=False)
    return data.replace(marks[i], marks[j])


def _units(data: bytes, rng: Rng) -> bytes:
    units = (b"mm", b"N", b"s", b"kN", b"V", b"px", b"ms", b"", b"S", b"bar")
    return data.replace(units[rng.integers(3)], units[rng.integers(len(units))], 1)


def _other_file(data: bytes, rng: Rng) -> bytes:
    """Nothing, noise, or the head of this file with noise behind it."""
    noise = rng.bytes(int(rng.integers(1, 2000)))
    return (b"", noise, data[: rng.integers(1, 200)] + noise)[rng.integers(3)]


MUTATIONS: tuple[Callable[[bytes, Rng], bytes], ...] = (
    _flip, _flip, _set_bytes, _truncate, _cut_out, _repeat_part, _delete_line, _double_line,
    _swap_lines, _strange_number, _strange_number, _strange_text, _strange_text, _deep, _encoding,
    _separators, _units, _other_file,
)  # fmt: skip


def mutant(data: bytes, rng: Rng) -> bytes:
    """One to three mutations after one another."""
    for _ in range(rng.integers(1, 4)):
        if data:
            data = MUTATIONS[rng.integers(len(MUTATIONS))](data, rng)
    return data


class _TooSlowError(Exception):
    """A file took longer than it may."""


@contextmanager
def _time_limit(seconds: float) -> Iterator[None]:
    """Interrupts Python code after `seconds` of work, and ends a process that hangs in C."""

    def stop(signum: int, frame: FrameType | None) -> None:
        raise _TooSlowError(f"more than {seconds:g} s")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    faulthandler.dump_traceback_later(20 * seconds, exit=True, file=sys.__stderr__)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


@contextmanager
def _memory_limit() -> Iterator[None]:
    """More than MEMORY_BYTES above the present size is a MemoryError, which is a traceback."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(
        resource.RLIMIT_AS, (pages * resource.getpagesize() + MEMORY_BYTES, before[1])
    )
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


@dataclass
class Outcome:
    """What became of the mutants of one reader."""

    mutants_tried: int = 0
    still_read: int = 0
    """mutants that the format's own reader read"""
    tracebacks: int = 0
    slowest_s: float = 0.0
    failures: list[str] = field(default_factory=list)
    """of the first tracebacks"""


def try_mutants(
    name: str, seeds: list[tuple[str, bytes]], n: int, folder: Path, seed: int = 0
) -> Outcome:
    """Read n mutants of the files of one format, in `folder`."""
    rng = np.random.default_rng([seed, *name.encode()])
    outcome = Outcome()
    readers = _readers(name)
    with _memory_limit(), warnings.catch_warnings():
        warnings.simplefilter("error")
        for index in range(n):
            file_name, data = seeds[index % len(seeds)]
            path = folder / file_name
            path.write_bytes(mutant(data, rng))
            _try_file(path, readers, outcome)
            if outcome.tracebacks and len(outcome.failures) == outcome.tracebacks:
                path.replace(folder / f"failed {outcome.tracebacks} {file_name}")
    return outcome


def _readers(name: str) -> tuple[Callable[[Path], object], Callable[[Path], object]]:
    """The reader of a format, and the door."""
    dic = {form.name: form for form in DIC_FORMATS}
    if name in dic:
        own = partial(dic[name].read_file, mm_per_px=MM_PER_PX)
        return own, partial(read_dic, mm_per_px=MM_PER_PX)
    machine = next(form for form in MACHINE_FORMATS if form.name == name)
    return machine.read_file, read_machine


def _try_file(path: Path, readers: tuple[Callable[[Path], object], ...], outcome: Outcome) -> None:
    outcome.mutants_tried += 1
    for position, reader in enumerate(readers):
        start = time.process_time()
        try:
            with _time_limit(SECONDS_A_FILE):
                reader(path)
            outcome.still_read += position == 0
        except WrongFile as error:
            if "\n" in str(error):
                _note(outcome, f"a sentence of several lines: {error}")
        except Exception:
            _note(outcome, traceback.format_exc())
        outcome.slowest_s = max(outcome.slowest_s, time.process_time() - start)


def _note(outcome: Outcome, text: str) -> None:
    outcome.tracebacks += 1
    if len(outcome.failures) < 20:
        outcome.failures.append(text)


def seeds_of(name: str, real_files: list[Path]) -> list[tuple[str, bytes]]:
    """Files to damage: the samples of a format, and the heads of real files."""
    samples = (DIC_SAMPLES | MACHINE_SAMPLES)[name]
    seeds = [(file_name, content()) for file_name, content in samples]
    for path in real_files:
        data = path.read_bytes()
        if b"\0" not in data[:1024]:
            data = b"\n".join(data.split(b"\n")[:SEED_LINES]) + b"\n"
        seeds.append((path.name, data))
    return seeds
