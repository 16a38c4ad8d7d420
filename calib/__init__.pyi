from .data.dataset import Dataset, FieldData, SampleData, read_force_csv
from .data.qc import analyse, read_experiment
from .data.readers import read_dic, read_machine
from .data.thesis import thesis_forces, thesis_table
from .dic import correlate, read_image
from .inference.likelihood import Likelihood, build_likelihood
from .inference.posterior import Posterior
from .inference.prior import Prior
from .study.config import Study, embedded_studies, load_study
from .study.stages import StudyResult, run_study
from .study.summary import Summary, load_summary
from .study.summary_files import to_frame

__all__ = [
    "Dataset",
    "FieldData",
    "Likelihood",
    "Posterior",
    "Prior",
    "SampleData",
    "Study",
    "StudyResult",
    "Summary",
    "analyse",
    "build_likelihood",
    "correlate",
    "embedded_studies",
    "load_study",
    "load_summary",
    "read_dic",
    "read_experiment",
    "read_force_csv",
    "read_image",
    "read_machine",
    "run_study",
    "thesis_forces",
    "thesis_table",
    "to_frame",
]

__version__: str
