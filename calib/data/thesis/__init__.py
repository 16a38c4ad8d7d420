"""The thesis' printed results: its tables with their source, and what they amount to."""

from calib.data.thesis.forces import (
    PUBLISHED_CONSTANTS,
    OptimizationRuns,
    optimization_runs,
    published_constants,
    stated_average,
    thesis_forces,
)
from calib.data.thesis.tables import PublishedTable, thesis_labels, thesis_table

__all__ = [
    "PUBLISHED_CONSTANTS",
    "OptimizationRuns",
    "PublishedTable",
    "optimization_runs",
    "published_constants",
    "stated_average",
    "thesis_forces",
    "thesis_labels",
    "thesis_table",
]
