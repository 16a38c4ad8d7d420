"""A test-machine run written as Bluehill writes it: compression is negative extension and load."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from calib.data.readers import MachineRecord, write_machine
from calib.virtual.laboratory_settings import MachineFormat
from calib.virtual.machine_run import MachineRun
from calib.virtual.point_files import SYNTHETIC


def _rows(run: MachineRun, row: str) -> list[str]:
    values = np.column_stack([run.time, -run.position, -run.force])
    return [row.format(*numbers) for numbers in values.tolist()]


def _bluehill_raw(path: Path, run: MachineRun, label: str) -> None:
    """Lines `name,"value",unit`, then numbers in quotes (Bluehill 3, raw data)."""
    head = [f'Specimen label,"{label}"', f'Note,"{SYNTHETIC}"', "", "Time,Extension,Load"]
    rows = _rows(run, '"{:,.5f}","{:,.5f}","{:,.5f}"')
    path.write_text("\r\n".join([*head, "(s),(mm),(N)", *rows]) + "\r\n", encoding="utf-8")


def _bluehill_export(path: Path, run: MachineRun, label: str) -> None:
    """A note, a line of names with units, then plain numbers, the load in kN."""
    head = [f"Note,{SYNTHETIC}", f"Specimen label,{label}", "Time (s),Extension (mm),Load (kN)"]
    values = np.column_stack([run.time, -run.position, -run.force / 1000.0])
    rows = [f"{time:.3f},{place:.5f},{load:.8f}" for time, place, load in values.tolist()]
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")


def _softcal(path: Path, run: MachineRun, label: str) -> None:
    """Our own csv, without loss, compression positive."""
    record = MachineRecord(
        "softcal machine csv",
        run.time,
        run.force,
        run.position,
        "compression",
        metadata={"Specimen label": label, "Note": SYNTHETIC},
    )
    write_machine(path, record)


MACHINE_WRITERS: dict[MachineFormat, Callable[[Path, MachineRun, str], None]] = {
    "bluehill-raw": _bluehill_raw,
    "bluehill-export": _bluehill_export,
    "softcal": _softcal,
}
