"""The data set that a study names: of the package, a csv file, or made of a laboratory's files."""

from __future__ import annotations

from calib.data import Dataset, read_force_csv, thesis_forces
from calib.study.sections import DataSource


def measured_dataset(data: DataSource) -> Dataset:
    """The measured data set, at all travels that were measured.

    Raises ValueError of one sentence for files that cannot be read.
    """
    if data.folder is not None:
        # plots and readers are loaded where they are needed only
        from calib.study.experiment_data import experiment_dataset

        return experiment_dataset(data.folder, data.quality)
    return read_force_csv(data.source) if data.is_file else thesis_forces()
