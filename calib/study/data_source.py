"""The data set that a study names: of the package, a csv file, or made of a laboratory's files."""

from __future__ import annotations

from dataclasses import replace

from calib.data import Dataset, read_force_csv, thesis_forces
from calib.data.sample_forces import has_samples, read_sample_forces
from calib.study.sections import DataSource


def measured_dataset(data: DataSource) -> Dataset:
    """The measured data set, at all travels that were measured, as far as its level uses it.

    Raises ValueError of one sentence for files that cannot be read.
    """
    return at_level(_whole(data), data)


def at_level(dataset: Dataset, data: DataSource) -> Dataset:
    """What the level uses of a data set: of "summary" mean and SD of the forces alone."""
    if data.level != "summary":
        return dataset
    return replace(dataset, field=None, force_covariance=None, samples=None)


def _whole(data: DataSource) -> Dataset:
    if data.folder is not None:
        # plots and readers are loaded where they are needed only
        from calib.study.experiment_data import experiment_dataset

        return experiment_dataset(data.folder, data.quality)
    if not data.is_file:
        return thesis_forces()
    if has_samples(data.source):
        return read_sample_forces(data.source)
    return read_force_csv(data.source)
