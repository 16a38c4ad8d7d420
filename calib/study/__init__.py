"""Studies: the file that determines a calibration, and the stages that carry it out."""

from calib.study.config import Study, StudyError, embedded_studies, load_study

__all__ = ["Study", "StudyError", "embedded_studies", "load_study"]
