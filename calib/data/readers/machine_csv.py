"""The plain csv of softcal for test-machine records; written and read without loss.

    # softcal machine 1
    # positive: compression
    # samples: 2
    # channel force: Load (N)
    # meta Diameter: 50 mm
    time_s,travel_mm,force_N,frame
    0.0,0.0,0.01,1

travel_mm and frame may be left out; `nan` in frame is a sample without an image.
"""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np

from calib.data.readers.machine_record import Direction, MachineRecord
from calib.data.readers.machine_table import MachineValues, Said, checked_record
from calib.data.readers.number_table import Layout, cells, read_numbers
from calib.data.readers.source import Source
from calib.data.readers.tagged_head import Head, head_lines, read_head, whole_number
from calib.data.readers.wrong_file import WrongFile, shown
from fe.atomic_file import write_text

NAME = "softcal machine csv"
MARK = "# softcal machine 1"
_DIRECTIONS: dict[str, Direction] = {name: name for name in get_args(Direction)}


def recognises(source: Source) -> bool:
    """Whether the first line is the mark of this format."""
    head = source.first(1)
    return bool(head) and head[0].strip() == MARK


def write_machine(path: Path | str, record: MachineRecord) -> None:
    """Write a record so that `read` gives the same bits of time, travel, force and frame."""
    head: dict[str, str | None] = {
        "positive": record.positive,
        "samples": str(record.time.size),
        **{f"channel {key}": value for key, value in record.channels.items()},
        **{f"meta {key}": value for key, value in record.metadata.items()},
    }
    columns = {
        "time_s": record.time,
        "travel_mm": record.travel,
        "force_N": record.force,
        "frame": record.frame,
    }
    present = {name: values for name, values in columns.items() if values is not None}
    rows = np.column_stack(list(present.values())).tolist()
    lines = [*head_lines(MARK, head), ",".join(present)]
    lines += [",".join(map(repr, row)) for row in rows]
    write_text(Path(path), "\n".join(lines) + "\n")


def read(source: Source) -> MachineRecord:
    """The record; raises WrongFile for anything else than what `write_machine` writes."""
    path = source.path
    head, start = read_head(source, MARK, None)
    layout = Layout(start + 1, ",", cells(source.lines[start], ","))
    names = layout.header
    if set(names) - {"travel_mm", "frame"} != {"time_s", "force_N"} or len(set(names)) < len(names):
        expected = "the columns time_s,travel_mm,force_N, and perhaps frame"
        raise WrongFile(path, start + 1, expected, shown(source.lines[start]))
    text, line = head.get("positive", ("", 1))
    if text not in _DIRECTIONS:
        raise WrongFile(path, line, f"positive: {', '.join(_DIRECTIONS)}", shown(text))
    table = read_numbers(source, layout, list(range(len(names))))
    n = whole_number(source, head, "samples")
    if n != len(table.lines):
        found = f"{len(table.lines)}"
        raise WrongFile(path, len(source.lines), f"{n} samples as the head says", found)
    column = {name: table.values[:, index] for index, name in enumerate(names)}
    values = MachineValues(
        column["time_s"], column["force_N"], column.get("travel_mm"), column.get("frame")
    )
    said = Said(NAME, _DIRECTIONS[text], _tagged(head, "meta "))
    return checked_record(table, values, said, _tagged(head, "channel "))


def _tagged(head: Head, tag: str) -> dict[str, str]:
    return {key.removeprefix(tag): value for key, (value, _) in head.items() if key.startswith(tag)}
