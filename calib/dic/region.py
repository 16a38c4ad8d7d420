"""Region of interest and the grid of points in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from skimage.draw import polygon2mask

from calib.dic.interpolation import Array
from calib.dic.prepared import BoolArray


def polygon_mask(shape: tuple[int, int], corners: Sequence[tuple[float, float]]) -> BoolArray:
    """(h, w) True at pixels inside the polygon of corners x, y, px.

    Raises ValueError for fewer than three corners, or when no pixel of the image is inside.
    """
    if len(corners) < 3:
        raise ValueError(f"polygon: expected three or more corners, found {len(corners)}")
    rows_first = np.array([(y, x) for x, y in corners], dtype=np.float64)
    inside = polygon2mask(shape, rows_first)
    return _not_empty(np.asarray(inside, dtype=np.bool_), "polygon")


def rectangle_mask(shape: tuple[int, int], box: tuple[float, float, float, float]) -> BoolArray:
    """(h, w) True at pixels with left <= x < right and top <= y < bottom, px.

    Raises ValueError when no pixel of the image is inside.
    """
    left, top, right, bottom = box
    y, x = np.arange(shape[0])[:, None], np.arange(shape[1])
    return _not_empty((x >= left) & (x < right) & (y >= top) & (y < bottom), "rectangle")


def _not_empty(mask: BoolArray, name: str) -> BoolArray:
    if not mask.any():
        h, w = mask.shape
        raise ValueError(f"{name}: expected a region in the image of {w} x {h} px, found none")
    return mask


def grid_points(mask: BoolArray, step: int) -> tuple[Array, tuple[int, int]]:
    """Pixels every `step` px over the bounding box of a mask (h, w), row after row.

    Returns points (n, 2), x and y, and the grid's (rows, columns). Points outside the mask are in
    it, so that the grid is whole; `correlate` names them as outside the region.
    Raises ValueError for a mask without a pixel, or a step that is not 1 or more.
    """
    if not mask.any():
        raise ValueError("mask: expected one pixel or more, found none")
    if step < 1:
        raise ValueError(f"step: expected 1 px or more, found {step}")
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    # half of what is left over on either side
    ys, xs = (
        np.arange(low + (high - low) % step // 2, high + 1, step)
        for low, high in ((rows[0], rows[-1]), (columns[0], columns[-1]))
    )
    x, y = np.meshgrid(xs, ys)
    return np.column_stack([x.ravel(), y.ravel()]).astype(np.float64), (ys.size, xs.size)
