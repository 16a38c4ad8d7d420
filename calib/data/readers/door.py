"""The one door: a file or folder is recognised by its content and read by the one reader for it."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from calib.data.readers import (
    bluehill,
    cylinder,
    davis_csv,
    davis_tecplot,
    dice,
    duodic,
    image_loads,
    machine_csv,
    matchid,
    ncorr,
    point_csv,
    vic3d,
)
from calib.data.readers.frames import DicSeries
from calib.data.readers.machine_record import MachineRecord
from calib.data.readers.matlab_file import is_matlab, variable_names
from calib.data.readers.natural_order import natural_order
from calib.data.readers.source import Source
from calib.data.readers.wrong_file import WrongFile, check_link, shown

MAX_FILES = 20_000


class DicFormat(NamedTuple):
    """One DIC program's files."""

    name: str
    recognises: Callable[[Source], bool]
    """whether the content is of this format"""
    read: Callable[[Source, float | None], DicSeries]
    """reads a file that is"""

    def read_file(self, path: Path | str, mm_per_px: float | None = None) -> DicSeries:
        """Read a file of this format; raises WrongFile for any other."""
        source = Source(Path(path))
        if not self.recognises(source):
            raise _unknown(source, "DIC points", [self.name])
        return self.read(source, mm_per_px)


class MachineFormat(NamedTuple):
    """One test machine's files."""

    name: str
    recognises: Callable[[Source], bool]
    """whether the content is of this format"""
    read: Callable[[Source], MachineRecord]
    """reads a file that is"""

    def read_file(self, path: Path | str) -> MachineRecord:
        """Read a file of this format; raises WrongFile for any other."""
        source = Source(Path(path))
        if not self.recognises(source):
            raise _unknown(source, "a test-machine file", [self.name])
        return self.read(source)


DIC_FORMATS = (
    DicFormat(davis_tecplot.NAME, davis_tecplot.recognises, davis_tecplot.read),
    DicFormat(davis_csv.NAME, davis_csv.recognises, davis_csv.read),
    DicFormat(matchid.NAME_2023, matchid.recognises_2023, matchid.read_2023),
    DicFormat(matchid.NAME_2024, matchid.recognises_2024, matchid.read_2024),
    DicFormat(dice.NAME, dice.recognises, dice.read),
    DicFormat(vic3d.NAME, vic3d.recognises, vic3d.read),
    DicFormat(ncorr.NAME, ncorr.recognises, ncorr.read),
    DicFormat(duodic.NAME, duodic.recognises, duodic.read),
    DicFormat(point_csv.NAME, point_csv.recognises, point_csv.read),
)
MACHINE_FORMATS = (
    MachineFormat(bluehill.NAME, bluehill.recognises, bluehill.read),
    MachineFormat(cylinder.NAME, cylinder.recognises, cylinder.read),
    MachineFormat(image_loads.NAME_DAVIS, image_loads.recognises_davis, image_loads.read_davis),
    MachineFormat(
        image_loads.NAME_MATCHID, image_loads.recognises_matchid, image_loads.read_matchid
    ),
    MachineFormat(machine_csv.NAME, machine_csv.recognises, machine_csv.read),
)


def read_dic(path: Path | str, mm_per_px: float | None = None) -> DicSeries:
    """Read the DIC result of one measurement: a file, or a folder with one file a frame.

    `mm_per_px` brings results in pixels to mm.  In a folder the frames come in the natural order
    of their names; all have to be of one format, and files that end in another way than they do,
    or are records of a machine, are left out and noted.
    Raises WrongFile with path, line, what was expected and what was found.
    """
    path = Path(path)
    if mm_per_px is not None and not (math.isfinite(mm_per_px) and mm_per_px > 0):
        raise WrongFile(path, None, "mm_per_px as a positive number of mm", f"{mm_per_px}")
    if path.is_dir():
        return _read_folder(path, mm_per_px)
    source = Source(path)
    return _dic_format(source).read(source, mm_per_px)


def read_machine(path: Path | str) -> MachineRecord:
    """Read the record of a test machine; signs stay as in the file, see `positive`.

    Raises WrongFile with path, line, what was expected and what was found.
    """
    source = Source(Path(path))
    for form in MACHINE_FORMATS:
        if form.recognises(source):
            return form.read(source)
    raise _unknown(source, "a test-machine file", [form.name for form in MACHINE_FORMATS])


def _dic_format(source: Source) -> DicFormat:
    for form in DIC_FORMATS:
        if form.recognises(source):
            return form
    raise _unknown(source, "DIC points", [form.name for form in DIC_FORMATS])


def _unknown(source: Source, what: str, names: list[str]) -> WrongFile:
    expected = f"{what} ({', '.join(names)})"
    known = [form.name for form in (*DIC_FORMATS, *MACHINE_FORMATS) if form.recognises(source)]
    if known:
        return WrongFile(source.path, 1, expected, f"a file of {known[0]}")
    if is_matlab(source):
        names_found = ", ".join(sorted(variable_names(source))) or "no variable that can be read"
        return WrongFile(source.path, None, expected, f"a MATLAB file with {shown(names_found)}")
    if source.is_binary:
        return WrongFile(source.path, 1, expected, "a binary file")
    first = source.first(1)
    return WrongFile(source.path, 1, expected, shown(first[0]) if first else "an empty file")


def _read_folder(path: Path, mm_per_px: float | None) -> DicSeries:
    # `._*` are what macOS writes beside files of folders that are not its own
    entries = [entry for entry in path.iterdir() if not entry.name.startswith("._")]
    for entry in entries:
        check_link(entry, "a file")
    files = [entry for entry in entries if entry.is_file()]
    files.sort(key=lambda file: natural_order(file.name))
    if len(files) > MAX_FILES:
        raise WrongFile(path, None, f"at most {MAX_FILES:,} files", f"{len(files):,}")
    formats = {file: _recognised(Source(file)) for file in files}
    found = {form.name for form in formats.values() if form is not None}
    if len(found) != 1:
        names = ", ".join(sorted(found)) or "none"
        raise WrongFile(path, None, "frames of one DIC format", names)
    suffixes = {file.suffix for file, form in formats.items() if form is not None}
    parts, left_out = [], []
    for file, form in formats.items():
        if form is not None:
            parts.append(form.read(Source(file), mm_per_px))
        elif file.suffix not in suffixes or _is_machine(Source(file)):
            left_out.append(file.name)
        else:
            # a damaged frame must not vanish: all frames after it would be one too early
            raise _unknown(Source(file), "DIC points as in the files beside it", [min(found)])
    if len(parts) > 1 and _are_subsets(parts):
        expected = "a file for each frame (DICe: separate_output_file_for_each_subset false)"
        raise WrongFile(path, None, expected, "files of one subset each")
    notes = dict.fromkeys(note for part in parts for note in part.notes)
    if left_out:
        notes[f"left out: {', '.join(left_out)}"] = None
    frames = tuple(frame for part in parts for frame in part.frames)
    return DicSeries(parts[0].format, frames, tuple(notes))


def _are_subsets(parts: list[DicSeries]) -> bool:
    """Whether each file is of one point through all frames: one after the other they are none."""
    single = all(frame.valid.size == 1 for part in parts for frame in part.frames)
    return single and any(len(part.frames) > 1 for part in parts)


def _recognised(source: Source) -> DicFormat | None:
    return next((form for form in DIC_FORMATS if form.recognises(source)), None)


def _is_machine(source: Source) -> bool:
    return any(form.recognises(source) for form in MACHINE_FORMATS)
