"""Csv of the tissue-phantom database: cylinders in compression (Dawood et al. 2026, Instron 5900).

Lines of head that end in `;`, then one table `Time (s),Compression (mm),Load (N),...`.
Compression and Load are positive in compression, their strains and stresses negative.
"""

from __future__ import annotations

from calib.data.readers.header import Names, names_in
from calib.data.readers.machine_record import MachineRecord
from calib.data.readers.machine_table import Channels, Said, read_record
from calib.data.readers.number_table import Layout, cells
from calib.data.readers.source import Source

NAME = "phantom cylinder csv"
MAX_HEADER_LINES = 30


def recognises(source: Source) -> bool:
    """Whether the head gives a cylinder's diameter and the table a compression."""
    return _names_line(source) is not None


def _names_line(source: Source) -> int | None:
    head = source.first(MAX_HEADER_LINES)
    if not any(line.startswith("Cylinder Diameter:") for line in head):
        return None
    for index, line in enumerate(head):
        if {"time", "compression", "load"} <= names_in(line, ","):
            return index
    return None


def read(source: Source) -> MachineRecord:
    """The record with the lines of the head as metadata; raises WrongFile for anything else."""
    index = _names_line(source) or 0
    header = cells(source.lines[index], ",")
    names = Names(source, index + 1, header)
    channels = Channels(names.need("Time"), names.need("Load"), names.need("Compression"))
    said = {}
    for number, line in enumerate(source.lines[:index]):
        key, colon, value = line.strip().rstrip(";").partition(":")
        said[key.strip() if colon else ("name" if number == 0 else "test")] = (
            value.strip() if colon else key.strip()
        )
    layout = Layout(index + 1, ",", header)
    return read_record(source, layout, index + 1, channels, Said(NAME, "compression", said))
