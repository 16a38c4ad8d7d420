"""A frame that lies in the measured surface: x right, y up, z towards the cameras."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calib.dic.camera import StereoRig
from calib.dic.distortion import Array

LEAST_POINTS = 4
ROUNDS = 10


class SurfaceFrame(NamedTuple):
    """Turns points out of the frame of the rig."""

    rotation: Array
    """(3, 3) rows are the new axes"""
    origin: Array
    """(3,) mm"""

    def points(self, points: Array) -> Array:
        """(n, 3) in the new frame, mm."""
        turned: Array = (points - self.origin) @ self.rotation.T
        return turned

    def vectors(self, vectors: Array) -> Array:
        """(n, 3) displacements in the new frame, mm."""
        turned: Array = vectors @ self.rotation.T
        return turned


def unturned() -> SurfaceFrame:
    """The frame of the rig itself."""
    return SurfaceFrame(np.eye(3), np.zeros(3))


def surface_frame(rig: StereoRig, points: Array) -> SurfaceFrame:
    """The frame of the plane through points (n, 3) [mm] that most of them lie on.

    Its origin is their median, x the direction of the images' columns. NaN points are left out.
    Raises ValueError with fewer than four points.
    """
    cloud = points[np.all(np.isfinite(points), axis=1)]
    if len(cloud) < LEAST_POINTS:
        raise ValueError(f"points: expected {LEAST_POINTS} or more in space, found {len(cloud)}")
    origin = np.median(cloud, axis=0)
    weight = np.ones(len(cloud))
    normal = np.zeros(3)
    for _ in range(ROUNDS):
        # a plane through weighted points; those far from it count less (Cauchy)
        middle = np.average(cloud, axis=0, weights=weight)
        normal = np.linalg.svd((cloud - middle) * np.sqrt(weight)[:, None], full_matrices=False)[2][
            2
        ]
        off = (cloud - middle) @ normal
        scale = max(1.4826 * float(np.median(np.abs(off))), 1e-12)
        weight = 1.0 / (1.0 + (off / (2.0 * scale)) ** 2)
    if normal @ (rig.left.axis + rig.right.axis) > 0.0:
        normal = -normal
    columns = rig.left.rotation[0] + rig.right.rotation[0]
    right = columns - (columns @ normal) * normal
    right /= np.linalg.norm(right)
    return SurfaceFrame(np.stack([right, np.cross(normal, right), normal]), origin)
