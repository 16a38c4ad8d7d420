"""Files of DIC programs and test machines, one reader each, behind one door."""

from calib.data.readers.door import (
    DIC_FORMATS,
    MACHINE_FORMATS,
    read_dic,
    read_machine,
)
from calib.data.readers.frames import DicSeries, PointFrame
from calib.data.readers.machine_csv import write_machine
from calib.data.readers.machine_record import MachineRecord
from calib.data.readers.point_csv import write_points
from calib.data.readers.wrong_file import WrongFile

__all__ = [
    "DIC_FORMATS",
    "MACHINE_FORMATS",
    "DicSeries",
    "MachineRecord",
    "PointFrame",
    "WrongFile",
    "read_dic",
    "read_machine",
    "write_machine",
    "write_points",
]
