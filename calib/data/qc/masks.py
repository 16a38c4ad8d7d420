"""Rectangular and polygonal masks: which points of the image are the sample's."""

from __future__ import annotations

import numpy as np
from matplotlib.path import Path as Polygon

from calib.data.qc.experiment_file import Box, Mask
from calib.data.readers.frames import BoolArray
from fe.response import Array

ON_EDGE = 1e-9
"""mm, by which rounding may take a point off an edge"""


def inside(mask: Mask, points: Array) -> BoolArray:
    """(n,) points (n, 2) [mm] within the rectangle and the polygon, and not on the pin."""
    kept = np.ones(len(points), dtype=np.bool_)
    if mask.rectangle_mm is not None:
        kept &= within(mask.rectangle_mm, points)
    if mask.polygon_mm is not None:
        kept &= _within_polygon(np.array(mask.polygon_mm, dtype=np.float64), points)
    if mask.pin_rectangle_mm is not None:
        kept &= ~within(mask.pin_rectangle_mm, points)
    return kept


def _within_polygon(corners: Array, points: Array) -> BoolArray:
    """(n,) points (n, 2) [mm] within a polygon of corners (m, 2) [mm] or on its edge."""
    x, y = corners.T
    turns_left = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0.0
    # matplotlib widens what turns left, and narrows what turns right
    around = Polygon(corners if turns_left else corners[::-1])
    return np.asarray(around.contains_points(points, radius=ON_EDGE), dtype=np.bool_)


def within(box: Box, points: Array) -> BoolArray:
    """(n,) points (n, 2) [mm] within a rectangle (left, bottom, right, top)."""
    left, bottom, right, top = box
    x, y = points[:, 0], points[:, 1]
    return np.asarray((x >= left) & (x <= right) & (y >= bottom) & (y <= top), dtype=np.bool_)
