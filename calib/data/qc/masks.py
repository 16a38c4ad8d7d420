"""Rectangular and polygonal masks: which points of the image are the sample's."""

from __future__ import annotations

import numpy as np
from matplotlib.path import Path as Polygon

from calib.data.qc.experiment_file import Box, Mask
from calib.data.readers.frames import BoolArray
from fe.response import Array


def inside(mask: Mask, points: Array) -> BoolArray:
    """(n,) points (n, 2) [mm] within the rectangle and the polygon, and not on the pin."""
    kept = np.ones(len(points), dtype=np.bool_)
    if mask.rectangle_mm is not None:
        kept &= within(mask.rectangle_mm, points)
    if mask.polygon_mm is not None:
        kept &= Polygon(np.array(mask.polygon_mm)).contains_points(points)
    if mask.pin_rectangle_mm is not None:
        kept &= ~within(mask.pin_rectangle_mm, points)
    return kept


def within(box: Box, points: Array) -> BoolArray:
    """(n,) points (n, 2) [mm] within a rectangle (left, bottom, right, top)."""
    left, bottom, right, top = box
    x, y = points[:, 0], points[:, 1]
    return np.asarray((x >= left) & (x <= right) & (y >= bottom) & (y <= top), dtype=np.bool_)
