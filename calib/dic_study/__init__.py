"""`calib dic`: photographs to point files, pictures and a report of their quality."""

from calib.dic_study.config import DicStudy, load_study
from calib.dic_study.run import run

__all__ = ["DicStudy", "load_study", "run"]
