"""Measured data: the thesis' tables, plain csv files, and the dataset the inference takes."""

from calib.data.dataset import Dataset, FieldData, read_force_csv
from calib.data.thesis import PUBLISHED_CONSTANTS, thesis_forces, thesis_table

__all__ = [
    "PUBLISHED_CONSTANTS",
    "Dataset",
    "FieldData",
    "read_force_csv",
    "thesis_forces",
    "thesis_table",
]
