"""From the files of a laboratory to a data set: `analyse` does all steps, one module each."""

from calib.data.qc.experiment_file import FILE, Experiment, read_experiment
from calib.data.qc.pipeline import QcResult, analyse, face_points
from calib.data.qc.quality import Rejection

__all__ = [
    "FILE",
    "Experiment",
    "QcResult",
    "Rejection",
    "analyse",
    "face_points",
    "read_experiment",
]
