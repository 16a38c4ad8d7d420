"""A region of the left image in the right one, by points matched between the two."""

from __future__ import annotations

import numpy as np

from calib.dic.distortion import Array
from calib.dic.prepared import BoolArray

DEGREES = (3, 2, 1)
"""of the polynomial from right to left: as high as the number of points allows"""
POINTS_PER_TERM = 4
BESIDE = 0.4
"""of the points' extent: how far beside them the polynomial is trusted"""


def carried_mask(mask: BoolArray, left: Array, right: Array, shape: tuple[int, int]) -> BoolArray:
    """(rows, columns) of the right image, True where it shows what lies in `mask` of the left.

    `left` and `right` (n, 2) are matched pixels; a smooth polynomial through them says what lies
    between and beside them. Raises ValueError with fewer points than a plane map needs.
    """
    good = np.all(np.isfinite(left) & np.isfinite(right), axis=1)
    low, high = right[good].min(axis=0), right[good].max(axis=0)
    scale = np.maximum(high - low, 1.0)

    def terms(points: Array, degree: int) -> Array:
        x, y = ((points - low) / scale).T
        powers = [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]
        return np.stack([x**i * y**j for i, j in powers], axis=1)

    count = int(np.count_nonzero(good))
    for degree in DEGREES:
        needed = POINTS_PER_TERM * (degree + 1) * (degree + 2) // 2
        if count >= needed:
            break
    else:
        raise ValueError(f"points: found {count} matched between the cameras, expected {needed}")
    fit = np.linalg.lstsq(terms(right[good], degree), left[good], rcond=None)[0]
    row, column = np.mgrid[: shape[0], : shape[1]]
    pixels = np.column_stack([column.ravel(), row.ravel()]).astype(np.float64)
    # far from the points a polynomial is no map: only their surroundings are looked at
    near = np.all((pixels > low - BESIDE * scale) & (pixels < high + BESIDE * scale), axis=1)
    x, y = np.round(terms(pixels[near], degree) @ fit).astype(np.int64).T
    inside = (x >= 0) & (x < mask.shape[1]) & (y >= 0) & (y < mask.shape[0])
    seen = np.zeros(len(x), dtype=np.bool_)
    seen[inside] = mask[y[inside], x[inside]]
    found = np.zeros(len(pixels), dtype=np.bool_)
    found[near] = seen
    return found.reshape(shape)
