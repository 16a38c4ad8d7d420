"""Instron Bluehill csv: raw data of Bluehill 3, exports of Bluehill Universal and WaveMatrix.

Raw: lines `name,"value",unit`, an empty line, a line of names, a line of units in brackets, then
numbers in quotes with commas between the thousands.  Exports: a line of names with their units,
or of names and a line of units.  Extension and Load are positive in tension; Compressive
extension and Compressive load in compression (the meaning of the channels in Bluehill); of
Displacement and Position the file does not say it.
"""

from __future__ import annotations

import csv
from dataclasses import replace

from calib.data.readers.header import Column, Names, columns_of, names_in
from calib.data.readers.machine_record import Direction, MachineRecord
from calib.data.readers.machine_table import Channels, Said, read_record
from calib.data.readers.number_table import Layout, cells
from calib.data.readers.source import Source
from calib.data.readers.wrong_file import WrongFile, shown

NAME = "Instron Bluehill csv"
MAX_HEADER_LINES = 200
TIME = ("Time", "Total Time")
TRAVEL: dict[str, Direction] = {
    "Extension": "tension",
    "Tensile extension": "tension",
    "Compressive extension": "compression",
    "Displacement": "unknown",
    "Position": "unknown",
}
FORCE: dict[str, Direction] = {
    "Load": "tension",
    "Tensile load": "tension",
    "Compressive load": "compression",
    "Force": "unknown",
}
ROTATION = ("Rotation",)
NO_SIGN = "the file does not say whether positive is tension or compression"


def recognises(source: Source) -> bool:
    """Whether a line names a time and a travel or rotation as Bluehill does."""
    return _names_line(source) is not None


def _names_line(source: Source) -> int | None:
    travels = {name.lower() for name in (*TRAVEL, *ROTATION)}
    times = {name.lower() for name in TIME}
    for index, line in enumerate(source.first(MAX_HEADER_LINES)):
        if "," not in line and ";" not in line:
            continue
        names = names_in(line, _separator(line))
        if names & times and names & travels:
            return index
    return None


def _separator(line: str) -> str:
    return ";" if ";" in line else ","


def read(source: Source) -> MachineRecord:
    """The record with the values of its head as metadata.

    Raises WrongFile for anything else, as for a torsion test or a force in volts.
    """
    index = _names_line(source) or 0
    separator = _separator(source.lines[index])
    header = cells(source.lines[index], separator)
    names = Names(source, index + 1, header)
    channels = Channels(names.need(*TIME), _force(names), names.need(*TRAVEL))
    start = index + 1
    if all(column.unit is None for column in channels.all):
        units = _units(source, start, len(header), separator)
        channels = Channels(*(replace(column, unit=units[column.index]) for column in channels.all))
        start += 1
    positive = _positive(channels)
    notes = (NO_SIGN,) if positive == "unknown" else ()
    said = Said(NAME, positive, _metadata(source, index, separator), notes)
    return read_record(source, Layout(start, separator, header), start, channels, said)


def _force(names: Names) -> Column:
    """The column of force; of several the one that Bluehill calls by one of its names."""
    for name in FORCE:
        column = names.get(name)
        if column is not None:
            return column
    return names.need("Load")


def _positive(channels: Channels) -> Direction:
    """What both channels say; nothing where they differ."""
    assert channels.travel is not None
    travel = next(TRAVEL[name] for name in TRAVEL if name.lower() == channels.travel.name.lower())
    force = next(FORCE[name] for name in FORCE if name.lower() == channels.force.name.lower())
    return travel if travel == force else "unknown"


def _units(source: Source, index: int, width: int, separator: str) -> list[str | None]:
    """Units of the line below the names, each in brackets."""
    text = source.lines[index] if index < len(source.lines) else ""
    units = [column.unit for column in columns_of(cells(text, separator))]
    if len(units) < width or all(unit is None for unit in units):
        raise WrongFile(source.path, index + 1, "a line of units as (s),(mm),(N)", shown(text))
    return units


def _metadata(source: Source, end: int, separator: str) -> dict[str, str]:
    """Lines `name,"value",unit` before the names."""
    said = {}
    for line in source.lines[:end]:
        parts = [part.strip() for part in next(csv.reader([line], delimiter=separator), [])]
        if len(parts) > 1 and parts[0]:
            said[parts[0]] = " ".join(part for part in parts[1:] if part)
    return said
