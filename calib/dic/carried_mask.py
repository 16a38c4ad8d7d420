"""A region of one image in another, by points that were found in both."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter
from scipy.spatial import cKDTree

from calib.dic.distortion import Array
from calib.dic.prepared import BoolArray, IntArray


def carried_mask(
    mask: BoolArray,
    before: Array,
    after: Array,
    gradient: Array,
    wanted: IntArray,
    radius: int,
    shape: tuple[int, int],
) -> BoolArray:
    """(rows, columns) of another image, True where it shows what lies in `mask`.

    `before` and `after` (n, 2): pixels in the image of the mask and in the other, `gradient`
    (n, 2, 2) of the displacement there. Pixels go by the tangent of the nearest point; False where
    no subset (`radius` px) of the `wanted` (m,) among the points has them. These keep what the
    mask says of them.
    """
    found = np.zeros(shape, dtype=np.bool_)
    here, there = (np.round(points[wanted]).astype(np.int64) for points in (after, before))
    inside = _within(here, shape)
    here, there = here[inside], there[inside]
    if not len(here):
        return found
    found[here[:, 1], here[:, 0]] = True
    row, column = np.nonzero(maximum_filter(found, 2 * radius + 1))
    pixels = np.column_stack([column, row]).astype(np.float64)
    _, nearest = cKDTree(after).query(pixels)
    back = np.linalg.inv(np.eye(2) + gradient)[nearest]
    source = before[nearest] + np.einsum("nij,nj->ni", back, pixels - after[nearest])
    found[row, column] = _looked_up(mask, np.round(source).astype(np.int64))
    found[here[:, 1], here[:, 0]] = _looked_up(mask, there)
    return found


def _within(pixels: np.ndarray, shape: tuple[int, int]) -> BoolArray:
    """(n,) whether pixels (n, 2), x and y, are in an image of this shape."""
    return np.asarray(np.all((pixels >= 0) & (pixels < np.array(shape[::-1])), axis=1))


def _looked_up(mask: BoolArray, pixels: np.ndarray) -> BoolArray:
    """(n,) of the mask at pixels (n, 2), x and y, False beside it."""
    inside = _within(pixels, (mask.shape[0], mask.shape[1]))
    seen = np.zeros(len(pixels), dtype=np.bool_)
    x, y = pixels[inside].T
    seen[inside] = mask[y, x]
    return seen
