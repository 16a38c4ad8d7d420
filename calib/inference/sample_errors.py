"""Errors of one sample that are its own: of its placing and of its measurement.

Not of its material: what the constants of a sample explain is no error. The directions in which the
data set says that samples differ (`FieldData.patterns`) are therefore not used here; of them only
the place of a sample on its lattice is, whose shapes are known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.data.dataset import Dataset, FieldData, SampleData
from calib.data.qc.placing_errors import field_slopes, placed
from calib.data.readers.frames import BoolArray
from calib.inference.field_scales import rigid_patterns
from calib.inference.noise import NoiseSettings
from fe.response import Array


@dataclass(frozen=True)
class SampleErrors:
    """What is assumed of one sample's own errors beside the noise of load cell and field.

    Raises ValueError when a value is impossible.
    """

    travel_zero_sd: float = 0.015
    """SD of the zero of one sample's travel about that of all, mm"""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.travel_zero_sd) and self.travel_zero_sd >= 0):
            raise ValueError(
                f"travel_zero_sd: expected zero or a positive number, got {self.travel_zero_sd}"
            )


def own_field_patterns(
    dataset: Dataset, field: FieldData, samples: SampleData, noise: NoiseSettings
) -> Array:
    """(q, n_step, n_point, 3) errors of one sample's field of known shape, one SD each, mm.

    Its place along x and y, by the slopes of the mean field with the SDs that the samples show, and
    the rigid motions of `noise`. The travel's zero, which the force shares, is not among them.
    """
    rigid = rigid_patterns(
        field.points, dataset.travel.size, noise.translation_sd, noise.rotation_sd
    )
    has: BoolArray = np.asarray(np.isfinite(samples.displacement).all(axis=(1, 3)))
    seen = has[:, None, :, None]
    off = np.where(seen, np.nan_to_num(samples.displacement) - field.displacement, 0.0)
    slopes = field_slopes(field.displacement, field.points, dataset.travel)
    one_sample = field.noise_std * np.sqrt(dataset.n_samples)
    sizes = placed(off, has, slopes, one_sample).sizes
    # the first two shapes are those of the place, where there are enough points for them
    n_place = int(np.any(slopes[:2] != 0, axis=(1, 2, 3)).sum()) if sizes.shape[1] else 0
    if not n_place:
        return rigid
    # The others' place is not known to be zero, and that of few points is that of their noise.
    n_points = has.sum(axis=1)
    with_field = sizes[n_points >= max(0.5 * n_points.max(), 1.0), :n_place]
    if len(with_field) < 2:
        return rigid
    sd = with_field.std(axis=0, ddof=1)
    return np.concatenate([sd[:, None, None, None] * slopes[:n_place], rigid])
