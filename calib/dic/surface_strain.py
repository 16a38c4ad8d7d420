"""Green-Lagrange strain in a surface from displacements in space, by local planes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from calib.dic.distortion import Array

LEAST_POINTS = 5
LEAST_SPREAD = 1e-3
"""share of the radius that points must spread across: on a line there is no strain across it"""


class SurfaceStrain(NamedTuple):
    """Components in the tangent plane at each point: x along the frame's x, y up at right angles.

    Each (n,); NaN where too few neighbours were measured.
    """

    xx: Array
    yy: Array
    xy: Array
    """of the tensor, not doubled"""


def surface_strain(position: Array, displacement: Array, radius: float) -> SurfaceStrain:
    """Strain at points (n, 3) mm moved by (n, 3) mm, from those within `radius` mm.

    In the tangent plane of the neighbours, places before and after are linear in two coordinates;
    E = (A^T A - 1) / 2 with A the (3, 2) slope of the places after. z of the frame should point out
    of the surface. Raises ValueError for a radius that is not positive.
    """
    if not radius > 0:
        raise ValueError(f"radius: expected a positive length in mm, found {radius}")
    n = len(position)
    strain = np.full((n, 3), np.nan)
    good = np.flatnonzero(np.isfinite(position).all(axis=1) & np.isfinite(displacement).all(axis=1))
    if good.size >= LEAST_POINTS:
        around = cKDTree(position[good]).query_ball_point(position[good], radius)
        for index, found in zip(good, around, strict=True):
            near = np.atleast_1d(found)
            if len(near) >= LEAST_POINTS:
                chosen = good[near]
                strain[index] = _at(position[chosen], displacement[chosen], radius)
    return SurfaceStrain(*strain.T)


def _at(position: Array, displacement: Array, radius: float) -> Array:
    """(3,) xx, yy, xy from the neighbours of one point."""
    before = position - position.mean(axis=0)
    _, spread, axes = np.linalg.svd(before, full_matrices=False)
    if spread[1] < LEAST_SPREAD * radius * np.sqrt(len(position)):
        return np.full(3, np.nan)
    normal = axes[2] * (1.0 if axes[2, 2] >= 0.0 else -1.0)
    across = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
    across /= np.linalg.norm(across)
    tangent = np.stack([across, np.cross(normal, across)])
    flat = before @ tangent.T
    moved = displacement - displacement.mean(axis=0)
    slope = np.linalg.lstsq(flat, moved, rcond=None)[0]
    after = tangent + slope
    tensor = 0.5 * (after @ after.T - np.eye(2))
    return np.array([tensor[0, 0], tensor[1, 1], tensor[0, 1]])
