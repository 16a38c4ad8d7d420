"""The files of one experiment: which there are, their hash, and the times of the frames.

LAB/experiment.toml  LAB/static/  LAB/S01/machine.csv  LAB/S01/dic/  LAB/S01/frames.csv
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.data.csv_cells import csv_cells
from calib.data.qc.experiment_file import FILE, Experiment
from calib.data.readers import DicSeries, PointFrame, WrongFile
from calib.data.readers.name_numbers import counters, counts_files, shape_of
from calib.data.readers.natural_order import natural_order
from calib.data.readers.wrong_file import check_link
from fe.response import Array, IntArray

STATIC = "static"
MACHINE = "machine.csv"
DIC = "dic"
FRAMES = "frames.csv"
COLUMNS = ["frame", "time_s"]
LONGEST = 10_000_000
"""bytes; a table of frames is short"""


@dataclass(frozen=True)
class SampleFiles:
    """Where the files of one sample are."""

    name: str
    machine: Path
    dic: Path
    """folder of the frames, or a file of all"""
    frames: Path


def sample_files(folder: Path, experiment: Experiment) -> tuple[SampleFiles, ...]:
    """The samples in their order: as listed, else all folders with a file of a sample.

    Raises WrongFile where there is none or a file is missing.
    """
    if experiment.samples is not None:
        names = list(experiment.samples)
    else:
        held = [path for path in folder.iterdir() if path.is_dir() and path.name != STATIC]
        names = sorted((p.name for p in held if _is_sample(p)), key=natural_order)
    if not names:
        raise WrongFile(folder, None, f"folders of samples with {MACHINE}", "none")
    return tuple(_sample(folder, name) for name in names)


def _is_sample(place: Path) -> bool:
    """Whether a folder holds a test-machine record, or frames with their times."""
    return (place / MACHINE).exists() or ((place / FRAMES).exists() and any(place.glob(f"{DIC}*")))


def _dic_paths(place: Path) -> list[Path]:
    """`dic` and `dic.*` in the folder of a sample: what else begins so is something else."""
    return sorted(path for path in place.iterdir() if path.name.partition(".")[0] == DIC)


def _sample(folder: Path, name: str) -> SampleFiles:
    place = folder / name
    if Path(name).name != name or not place.is_dir():
        raise WrongFile(folder / FILE, None, f"samples: folders within {folder}", repr(name))
    files = _dic_paths(place)
    for path in (place / MACHINE, place / FRAMES):
        if not path.is_file():
            found = "a folder" if path.is_dir() else "none"
            raise WrongFile(path, None, "a file of this sample", found)
    if not files:
        raise WrongFile(place / DIC, None, "a folder of DIC frames, or a file of all", "none")
    if files[0].is_dir():  # `dic` sorts before `dic.toml` and the like, which are beside it
        files = files[:1]
    if len(files) > 1:
        found = " and ".join(path.name for path in files)
        raise WrongFile(place, None, f"one of {DIC} and {DIC}.*, the frames of this sample", found)
    return SampleFiles(name, place / MACHINE, files[0], place / FRAMES)


def static_folder(folder: Path) -> Path | None:
    """Folder of the static frames; None where there is none. Raises WrongFile for a file."""
    path = folder / STATIC
    if path.is_file():
        raise WrongFile(path, None, "a folder of frames", "a file")
    check_link(path, "a file or folder")
    return path if path.is_dir() else None


def input_hash(folder: Path, samples: tuple[SampleFiles, ...]) -> str:
    """SHA-256 of names and bytes of all files that the data set follows from."""
    paths = [folder / FILE]
    for place in (static_folder(folder), *(sample.dic for sample in samples)):
        if place is not None:
            paths += (
                sorted(p for p in place.rglob("*") if p.is_file()) if place.is_dir() else [place]
            )
    paths += [path for sample in samples for path in (sample.machine, sample.frames)]
    digest = hashlib.sha256()
    for path in paths:
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0")
        try:
            with path.open("rb") as stream:
                digest.update(hashlib.file_digest(stream, "sha256").digest())
        except OSError as error:
            raise WrongFile(path, None, "a readable file", f"none ({error.strerror})") from error
    return digest.hexdigest()


def frames_in_time(path: Path, series: DicSeries) -> tuple[tuple[PointFrame, ...], Array]:
    """Frames as they were taken, and their times (n_frame,) s by the camera's clock.

    By a csv `frame,time_s`. `frame` is the name of the frame's file without its ending, or a number
    that counts up: names need not sort as frames were taken, as `reference` comes after `B0001`.
    Raises WrongFile with the line.
    """
    times = _frame_times(path, series)
    order = np.argsort(times, kind="stable")
    return tuple(series.frames[index] for index in order), times[order]


def _frame_times(path: Path, series: DicSeries) -> Array:
    """(n_frame,) times of the frames of a series, all different."""
    rows = _rows(path)
    names = [frame.name for frame in series.frames]
    if len(rows) != len(names):
        raise WrongFile(path, None, f"{len(names)} lines, one a frame of {DIC}", f"{len(rows)}")
    by_name = {name: time for _, name, time in rows}
    if set(by_name) == set(names) and len(by_name) == len(names):
        _check_different(path, rows)
        return np.array([by_name[name] for name in names])
    previous = -np.inf
    for line, name, _ in rows:
        if not re.fullmatch(r"\d{1,9}(\.0*)?", name, re.ASCII) or float(name) <= previous:
            raise WrongFile(path, line, "names of the frames or numbers that count up", repr(name))
        previous = float(name)
    _check_numbers(path, rows, names)
    times = np.array([time for _, _, time in rows])
    if np.any(np.diff(times) <= 0):
        row = int(np.argmax(np.diff(times) <= 0)) + 1
        raise WrongFile(path, rows[row][0], "times that increase", f"{times[row]:g}")
    still = [
        frame.valid.any() and not np.any(frame.displacement[frame.valid]) for frame in series.frames
    ]
    if any(still) and not still[0]:
        expected = f"names of frames: {names[still.index(True)]} has not moved, {names[0]} has"
        raise WrongFile(path, rows[0][0], expected, repr(rows[0][1]))
    return times


def _check_numbers(path: Path, rows: list[tuple[int, str, float]], names: list[str]) -> None:
    """Raise WrongFile where numbers, in order, stand for files of other numbers.

    As where the table lacks another frame than the folder does: frames between would get the times
    of their neighbours. Names of one file of all frames count places. A number in the names that
    goes with the table's, in steps of any size, says that all is well; one that counts in the same
    steps but for some says that it is not, others say nothing.
    """
    if all(re.search(r" frame \d+$", name) for name in names):
        return
    usual = Counter(map(shape_of, names)).most_common(1)[0][0]  # a reference may have its own
    alike = [
        (line, round(float(number)), name)
        for (line, number, _), name in zip(rows, names, strict=True)
        if shape_of(name) == usual
    ]
    by_table = np.diff([number for _, number, _ in alike])
    if not by_table.size:
        return
    doubtful: IntArray | None = None
    for numbers in counters([name for *_, name in alike]):
        steps: IntArray = np.diff(numbers)
        if np.all(steps * by_table[0] == by_table * steps[0]):
            return
        if counts_files(numbers) and np.median(steps) == np.median(by_table):
            doubtful = steps
    if doubtful is not None:
        line, number, name = alike[1 + int(np.argmax(doubtful != by_table))]
        expected = f"the name of the frame, or a number that goes on as that of {name} does"
        raise WrongFile(path, line, expected, f"{number}")


def _check_different(path: Path, rows: list[tuple[int, str, float]]) -> None:
    """Raise WrongFile where two frames have one time: which was taken first is not known."""
    seen: dict[float, str] = {}
    for line, name, time in rows:
        first = seen.setdefault(time, name)
        if first != name:
            raise WrongFile(path, line, f"another time than that of {first}", f"{time:g}")


def _rows(path: Path) -> list[tuple[int, str, float]]:
    """Line, frame and time of every row."""
    try:
        if path.stat().st_size > LONGEST:
            raise WrongFile(path, None, f"at most {LONGEST:,} bytes", "more")
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise WrongFile(path, None, "a readable text file", f"none ({error})") from error
    rows: list[tuple[int, str, float]] = []
    header_seen = False
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells = csv_cells(path, number, line)
        if not header_seen:
            if cells != COLUMNS:
                raise WrongFile(path, number, f"columns {','.join(COLUMNS)}", ",".join(cells)[:80])
            header_seen = True
            continue
        rows.append((number, cells[0], _time(path, number, cells)))
    if not rows:
        raise WrongFile(path, None, "a line for each frame", "none")
    return rows


def _time(path: Path, number: int, cells: list[str]) -> float:
    try:
        [_, text] = cells
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise WrongFile(path, number, "a frame and its time in s", ",".join(cells)[:80])
    return value
