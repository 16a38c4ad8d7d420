"""Points in space from their pixels in two cameras, with covariance.

Source: Hartley and Zisserman, "Multiple View Geometry", 2nd ed., 2003, chapter 12: the point whose
projections are nearest to the pixels (maximum likelihood); covariance by section 5.2.3.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calib.dic.camera import StereoRig, project, rays
from calib.dic.distortion import Array

STEPS = 4
"""of Gauss-Newton from the middle of the shortest line between the rays: it gains digits fast"""


class Triangulated(NamedTuple):
    """Points and what they depend on."""

    points: Array
    """(n, 3) mm; NaN where a pixel is NaN or the lines of sight do not meet before the cameras"""
    by_pixels: Array
    """(n, 3, 4) derivative by the pixels (left x, y, right x, y), mm/px"""
    residual: Array
    """(n, 4) pixels less projections of the point, px"""

    def covariance(self, of_pixels: Array) -> Array:
        """(n, 3, 3) mm^2, from the pixels' covariance (n, 4, 4) px^2."""
        covariance: Array = self.by_pixels @ of_pixels @ self.by_pixels.transpose(0, 2, 1)
        return covariance


def triangulate(rig: StereoRig, left: Array, right: Array) -> Triangulated:
    """Points seen at pixels (n, 2) of the left and (n, 2) of the right camera.

    Minimises the squared distances of pixels and projections, all four coordinates alike. Raises
    ValueError when the numbers of pixels differ.
    """
    if left.shape != right.shape or left.ndim != 2 or left.shape[1:] != (2,):
        raise ValueError(
            f"left, right: expected equal shapes (n, 2), found {left.shape} and {right.shape}"
        )
    points = _middle(rig, left, right)
    jacobian, residual = _linear(rig, points, left, right)
    for _ in range(STEPS):
        points = points + _pseudo_inverse(jacobian, residual)
        jacobian, residual = _linear(rig, points, left, right)
    found = np.all(np.isfinite(points), axis=1) & np.all(np.isfinite(residual), axis=1)
    points[~found] = np.nan
    by_pixels = np.full((len(points), 3, 4), np.nan)
    good = jacobian[found]
    by_pixels[found] = np.linalg.solve(good.transpose(0, 2, 1) @ good, good.transpose(0, 2, 1))
    return Triangulated(points, by_pixels, residual)


def _middle(rig: StereoRig, left: Array, right: Array) -> Array:
    """(n, 3) middles of the shortest lines between the lines of sight, mm."""
    a, b = rays(rig.left, left), rays(rig.right, right)
    between = rig.right.centre - rig.left.centre
    aa, ab, bb = (a * a).sum(axis=1), (a * b).sum(axis=1), (b * b).sum(axis=1)
    at, bt = a @ between, b @ between
    determinant = aa * bb - ab * ab
    with np.errstate(divide="ignore", invalid="ignore"):
        along_a = (bb * at - ab * bt) / determinant
        along_b = (ab * at - aa * bt) / determinant
    on_a = rig.left.centre + along_a[:, None] * a
    on_b = rig.right.centre + along_b[:, None] * b
    middle: Array = 0.5 * (on_a + on_b)
    middle[~((along_a > 0.0) & (along_b > 0.0))] = np.nan
    return middle


def _linear(rig: StereoRig, points: Array, left: Array, right: Array) -> tuple[Array, Array]:
    """(n, 4, 3) derivative of the four coordinates by the point, and (n, 4) what is missing, px."""
    (at_left, by_left), (at_right, by_right) = project(rig.left, points), project(rig.right, points)
    jacobian = np.concatenate([by_left, by_right], axis=1)
    return jacobian, np.hstack([left - at_left, right - at_right])


def _pseudo_inverse(jacobian: Array, residual: Array) -> Array:
    """(n, 3) least-squares steps; NaN where there is nothing."""
    step = np.full((len(jacobian), 3), np.nan)
    good = np.all(np.isfinite(residual), axis=1) & np.all(np.isfinite(jacobian), axis=(1, 2))
    transposed = jacobian[good].transpose(0, 2, 1)
    right = transposed @ residual[good][..., None]
    step[good] = np.linalg.solve(transposed @ jacobian[good], right)[..., 0]
    return step
