"""Force recorded beside the images: the load files of DaVis and of MatchID.

DaVis: `;`, a line of names and one of units (ms, kN); the image index stands in the samples at
which an image was taken.  MatchID 2024: `File;TimeStamp;Force [V]; Force [N]`, one line an image.
MatchID 2023: volts only, which no reader can turn into a force.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from calib.data.readers.header import Column, columns_of, names_in
from calib.data.readers.machine_record import MachineRecord
from calib.data.readers.machine_table import Channels, Said, read_machine_numbers, read_record
from calib.data.readers.number_table import Layout, cells
from calib.data.readers.source import Source
from calib.data.readers.units import FORCE, factor
from calib.data.readers.wrong_file import WrongFile, shown
from fe.response import Array

NAME_DAVIS = "DaVis load csv"
NAME_MATCHID = "MatchID load csv"
NO_TRAVEL = "the file has no travel of the machine"
NO_SIGN = "the file does not say whether positive is tension or compression"
SECONDS = "TimeStamp has no unit; s is taken"
_LONGEST_NAME = 260
_IMAGE = re.compile(r"(\d+)\.\w+$", re.ASCII)
_OF_CAMERA = re.compile(r"(\d+)_(\d)\.\w+$", re.ASCII)


def recognises_davis(source: Source) -> bool:
    """Whether the first line begins with Time and has an image index."""
    head = source.first(1)
    return bool(head) and head[0].startswith("Time;") and ";Image index" in head[0]


def read_davis(source: Source) -> MachineRecord:
    """Time and force, and the image index of samples with an image.

    Raises WrongFile for anything else, and where not exactly one column has a unit of force.
    """
    path = source.path
    header = cells(source.lines[0], ";")
    units = cells(source.lines[1], ";") if len(source.lines) > 1 else []
    if len(units) != len(header):
        raise WrongFile(path, 2, f"{len(header)} units separated by ';'", f"{len(units)}")
    columns = [
        Column(index, name, unit or None, name)
        for index, (name, unit) in enumerate(zip(header, units, strict=True))
    ]
    forces = [column for column in columns if column.unit in FORCE]
    if len(forces) != 1:
        found = f"{len(forces)} in {shown(source.lines[1])}"
        raise WrongFile(path, 2, "one column with a unit of force", found)
    image = next(column for column in columns if column.name.startswith("Image index"))
    channels = Channels(columns[0], forces[0], frame=image)
    said = Said(NAME_DAVIS, notes=(NO_TRAVEL, NO_SIGN))
    return read_record(source, Layout(2, ";", header), 2, channels, said)


def recognises_matchid(source: Source) -> bool:
    """Whether the first line is that of a MatchID load file of either generation."""
    head = source.first(1)
    if not head or ";" not in head[0]:
        return False
    names = names_in(head[0], ";")
    return {"file", "timestamp"} <= names or ("index" in names and "adc" in head[0].lower())


def read_matchid(source: Source) -> MachineRecord:
    """Time and force of each image, `frame` being the number in the image's name.

    Raises WrongFile for anything else, for a file with volts only, and for a column in N that
    repeats the volts.
    """
    header = cells(source.lines[0], ";")
    columns = columns_of(header)
    forces = [column for column in columns if column.unit in FORCE]
    if len(forces) != 1:
        expected = f"one column with a unit of force ({', '.join(FORCE)})"
        raise WrongFile(source.path, 1, expected, shown(source.lines[0]))
    layout = Layout(1, ";", header)
    time = next((column for column in columns if column.name.lower() == "timestamp"), None)
    if time is None:
        raise WrongFile(source.path, 1, "a column 'TimeStamp'", shown(source.lines[0]))
    said = Said(NAME_MATCHID, notes=(NO_TRAVEL, NO_SIGN, SECONDS), time_unit="s")
    record = read_record(source, layout, 1, Channels(time, forces[0]), said)
    _check_volts(source, layout, columns, forces[0])
    return _with_images(source, layout, columns, record)


def _check_volts(source: Source, layout: Layout, columns: list[Column], force: Column) -> None:
    """A channel that was not calibrated is exported as N with the numbers of its volts."""
    volts = [column for column in columns if column.unit == "V"]
    if not volts:
        return
    values = read_machine_numbers(source, layout, [force.index, *(c.index for c in volts)]).values
    by = factor(source.path, 1, force.text, "force", force.unit)
    newton = values[:, 0] * by  # a cell of 10 kN may well give 1 V a kN
    for column, volt in zip(volts, values[:, 1:].T, strict=True):
        if np.any(newton != 0) and np.allclose(newton, volt, rtol=1e-4, atol=0):
            expected = f"a force in {force.text!r}"
            raise WrongFile(source.path, 1, expected, f"the volts of {column.text!r} again")


def _with_images(
    source: Source, layout: Layout, columns: list[Column], record: MachineRecord
) -> MachineRecord:
    """The record with the numbers of its images, NaN where a name has none."""
    image = next((column for column in columns if column.name.lower() == "file"), None)
    if image is None:
        return record
    names = [
        cells(line, ";")[image.index][-_LONGEST_NAME:]
        for line in source.lines[layout.start :]
        if line.strip()
    ]
    return replace(record, frame=_numbers_of(names))


def _numbers_of(names: list[str]) -> Array:
    """(n,) numbers of images by the last number in their names, NaN where there is none.

    A single digit that all with a number have alike after it is that of the camera.
    """
    matches, by_camera = ([p.search(name) for name in names] for p in (_IMAGE, _OF_CAMERA))
    cameras = {match[2] for match in by_camera if match}
    if len(cameras) == 1 and sum(map(bool, by_camera)) == sum(map(bool, matches)):
        matches = by_camera
    return np.array([float(match[1]) if match else np.nan for match in matches])
