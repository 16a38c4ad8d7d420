"""What a sample's field looks like when it is taken from slightly wrong places or travels.

The base of a sample is found to a spacing of its DIC points, its contact to some 0.01 mm. A small
error of the place (a_x, a_y) and of the travel a_d adds (a . grad) u to the field. The shapes come
from the mean field itself, in which they are hardly noisy; from the samples only the sizes are
taken. Estimated from the samples' scatter as free patterns they bring the noise of all points.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from calib.data.readers.frames import BoolArray
from fe.response import Array

NEIGHBOURS = 13
"""points of a local parabola in x and y, with six coefficients"""


class Placed(NamedTuple):
    """Samples' deviations from their mean, split in errors of place and travel and the rest."""

    shapes: Array
    """(3, n_step, n, 3) slopes in x, y and travel, mm/mm"""
    sizes: Array
    """(n_sample, 3) errors of place and travel of each sample, mm"""
    rest: Array
    """(n_sample, n_step, n, 3) mm"""


def field_slopes(field: Array, points: Array, travel: Array) -> Array:
    """(3, n_step, n, 3) derivatives with respect to x, y and travel of field (n_step, n, 3), mm/mm.

    Over points (n, 2) [mm] by parabolas through the nearest ones (moving least squares), over
    travel (n_step,) [mm] by central differences. Where there are too few of either, zero.
    """
    slopes = np.zeros((3, *field.shape))
    if len(points) >= NEIGHBOURS:
        near = cKDTree(points).query(points, k=NEIGHBOURS)[1]
        x, y = np.moveaxis(points[near] - points[:, None], 2, 0)
        columns = np.stack([np.ones_like(x), x, y, 0.5 * x**2, x * y, 0.5 * y**2], axis=2)
        weights = np.linalg.pinv(columns)[:, 1:3]
        slopes[:2] = np.einsum("pak,ipkc->aipc", weights, field[:, near])
    if len(travel) >= 3:
        slopes[2] = np.gradient(field, travel, axis=0)
    return slopes


def placed(deviations: Array, has: BoolArray, slopes: Array, scale: Array) -> Placed:
    """Split deviations (n_sample, n_step, n, 3) [mm], which are zero where not `has` (n_sample, n).

    The sizes of the errors are fitted to each sample by least squares, with components in units of
    `scale` (3,) [mm]. The size along slopes that are zero is zero.
    """
    weighted = slopes / scale
    # normal equations of every sample: points that it lacks do not count
    per_point = np.einsum("aipc,bipc->abp", weighted, weighted)
    matrix = np.einsum("abp,sp->sab", per_point, has.astype(np.float64))
    right = np.einsum("aipc,sipc->sa", weighted / scale, deviations)
    sizes = np.einsum("sab,sb->sa", np.linalg.pinv(matrix, hermitian=True), right)
    rest = deviations - np.einsum("sa,aipc->sipc", sizes, slopes)
    return Placed(slopes, sizes, np.where(has[:, None, :, None], rest, 0.0))
