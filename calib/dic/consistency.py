"""Points that correlate well at a wrong place: their neighbours' shape functions say otherwise."""

from __future__ import annotations

import numpy as np

from calib.dic.interpolation import Array
from calib.dic.prepared import BoolArray, IntArray
from calib.dic.shape import carried

LEAST_NEIGHBOURS = 3


def stray_points(points: Array, parameters: Array, valid: BoolArray, near: IntArray) -> BoolArray:
    """(n,) valid points far from where their neighbours expect them.

    near (n, 8): indices of neighbours, -1 for none. Expected is the median over the valid
    neighbours of their shape functions carried to the point. Far is more than 1 px and a tenth of
    the distance to the neighbours: a wrong match is off by a speckle, while a true field departs
    from its tangent by half the change of its gradient times that distance.
    """
    has = (near >= 0) & valid[near]
    offset = points[:, None] - points[near]
    n, k = near.shape
    there = carried(parameters[near].reshape(n * k, -1), offset.reshape(n * k, 2))
    expected = np.where(has[..., None], there[:, :2].reshape(n, k, 2), np.nan)
    enough = valid & (has.sum(axis=1) >= LEAST_NEIGHBOURS)
    off = np.zeros(n)
    distance = np.where(has, np.abs(offset).max(axis=2), 0.0).max(axis=1)
    middle = np.nanmedian(expected[enough], axis=1)
    off[enough] = np.abs(parameters[enough, :2] - middle).max(axis=1)
    return np.asarray(off > 1.0 + 0.1 * distance)
