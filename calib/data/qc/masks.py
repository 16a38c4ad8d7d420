"""Rectangular and polygonal masks: which points of the image are the sample's."""

from __future__ import annotations

import numpy as np
from matplotlib.path import Path as Polygon

from calib.data.qc.experiment_file import Mask
from calib.data.readers.frames import BoolArray
from fe.response import Array


def inside(mask: Mask, points: Array) -> BoolArray:
    """(n,) points (n, 2) [mm] within the rectangle and the polygon, where there are any."""
    kept = np.ones(len(points), dtype=np.bool_)
    if mask.rectangle_mm is not None:
        left, bottom, right, top = mask.rectangle_mm
        kept &= (points[:, 0] >= left) & (points[:, 0] <= right)
        kept &= (points[:, 1] >= bottom) & (points[:, 1] <= top)
    if mask.polygon_mm is not None:
        kept &= Polygon(np.array(mask.polygon_mm)).contains_points(points)
    return kept
