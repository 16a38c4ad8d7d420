"""Studies: the file that determines a calibration; `calib.study.stages` carries it out."""

from calib.study.config import Study, StudyError, embedded_studies, load_study

__all__ = ["Study", "StudyError", "embedded_studies", "load_study"]
