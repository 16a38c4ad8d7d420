"""From px of the image to a frame of points in mm."""

from __future__ import annotations

import numpy as np

from calib.data.readers.frames import PointFrame
from calib.dic import Correlation
from calib.dic_study.config import Scale
from fe.response import Array


def point_frame(
    name: str,
    points: Array,
    found: Correlation,
    scale: Scale,
    grid: tuple[int, int],
    time: float | None = None,
) -> PointFrame:
    """Points (n, 2) px and what was found, as mm with y up; z is zero by assumption."""
    n = len(points)
    factor = scale.mm_per_px * np.array([1.0, -1.0])
    position, displacement, sigma = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    position[:, :2] = (points - np.array(scale.origin_px)) * factor + 0.0
    displacement[:, :2] = found.displacement * factor
    sigma[:, :2] = found.total * scale.mm_per_px
    displacement[~found.valid] = np.nan
    sigma[~found.valid] = np.nan
    return PointFrame(name, position, displacement, found.valid, sigma, time, grid, is_planar=True)
