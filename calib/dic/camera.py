"""A camera: pinhole, lens distortion and pose; a pair of cameras and its epipolar geometry.

Points are in mm, pixels as (column, row) with the centre of the first pixel at (0, 0). A camera
looks along its z axis, x is that of the columns and y that of the rows (downwards). Source:
R. Hartley, A. Zisserman, "Multiple View Geometry", 2nd ed., 2003, chapters 6 and 9.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from calib.dic.distortion import Array, Distortion, distort, undistort

ROTATION_ERROR = 1e-6


@dataclass(frozen=True)
class Intrinsics:
    """What a camera does whatever it looks at. Raises ValueError for impossible numbers."""

    fx: float
    """focal length in columns, px"""
    fy: float
    """focal length in rows, px"""
    cx: float
    """principal point, px"""
    cy: float
    skew: float = 0.0
    """columns by which x moves per unit of y in the image plane, px"""
    distortion: Distortion = field(default_factory=Distortion)

    def __post_init__(self) -> None:
        values = (self.fx, self.fy, self.cx, self.cy, self.skew)
        if not np.all(np.isfinite(values)) or self.fx <= 0 or self.fy <= 0:
            raise ValueError(f"fx, fy, cx, cy, skew: expected finite, fx, fy above 0, got {values}")

    @property
    def matrix(self) -> Array:
        """(3, 3) K, from the image plane to pixels."""
        return np.array(
            [[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]],
            dtype=np.float64,
        )


@dataclass(frozen=True)
class Camera:
    """Intrinsics and pose: X_camera = rotation X + translation.

    Raises ValueError for a matrix that is no rotation.
    """

    intrinsics: Intrinsics
    rotation: Array = field(default_factory=lambda: np.eye(3))
    """(3, 3)"""
    translation: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) mm"""

    def __post_init__(self) -> None:
        turn = self.rotation
        if turn.shape != (3, 3) or self.translation.shape != (3,):
            raise ValueError(
                f"rotation, translation: expected shapes (3, 3) and (3,), "
                f"found {turn.shape} and {self.translation.shape}"
            )
        if not np.isfinite(self.translation).all():
            raise ValueError(f"translation: expected finite lengths, found {self.translation}")
        off = np.abs(turn @ turn.T - np.eye(3)).max()
        if not off < ROTATION_ERROR or np.linalg.det(turn) < 0:
            raise ValueError(f"rotation: expected an orthogonal matrix, found one off by {off:.2g}")

    @property
    def centre(self) -> Array:
        """(3,) where the camera is, mm."""
        centre: Array = -self.rotation.T @ self.translation
        return centre

    @property
    def axis(self) -> Array:
        """(3,) unit vector along which it looks."""
        return np.array(self.rotation[2])


class Projection(NamedTuple):
    """Pixels of points and what they depend on."""

    pixels: Array
    """(n, 2) px; NaN for points behind the camera"""
    by_point: Array
    """(n, 2, 3) derivative by the point in the camera's frame, px/mm"""
    by_intrinsics: Array
    """(n, 2, 10) derivative by fx, fy, cx, cy, skew, k1, k2, k3, p1, p2"""


def project_in_camera(intrinsics: Intrinsics, points: Array) -> Projection:
    """Pixels of points (n, 3) [mm] given in the camera's own frame, with exact derivatives."""
    depth = np.where(points[:, 2] > 0.0, points[:, 2], np.nan)
    plane = points[:, :2] / depth[:, None]
    shown = distort(intrinsics.distortion, plane)
    two = intrinsics.matrix[:2, :2]
    pixels = shown.points @ two.T + intrinsics.matrix[:2, 2]
    inner = two @ shown.by_point
    by_point = np.concatenate([inner, -(inner @ plane[..., None])], axis=2) / depth[:, None, None]
    by_intrinsics = np.zeros((len(points), 2, 10))
    by_intrinsics[:, 0, 0], by_intrinsics[:, 1, 1] = shown.points[:, 0], shown.points[:, 1]
    by_intrinsics[:, 0, 2] = by_intrinsics[:, 1, 3] = 1.0
    by_intrinsics[:, 0, 4] = shown.points[:, 1]
    by_intrinsics[:, :, 5:] = two @ shown.by_coefficient
    return Projection(pixels, by_point, by_intrinsics)


def project(camera: Camera, points: Array) -> tuple[Array, Array]:
    """Pixels (n, 2) of points (n, 3) [mm] and their derivative (n, 2, 3) by the points, px/mm."""
    seen = project_in_camera(camera.intrinsics, points @ camera.rotation.T + camera.translation)
    return seen.pixels, seen.by_point @ camera.rotation


def image_plane(intrinsics: Intrinsics, pixels: Array) -> Array:
    """Undistorted points (n, 2) of the image plane at distance 1 that pixels (n, 2) show."""
    shown = np.linalg.solve(intrinsics.matrix[:2, :2], (pixels - intrinsics.matrix[:2, 2]).T).T
    return undistort(intrinsics.distortion, np.ascontiguousarray(shown))


def ideal_pixels(intrinsics: Intrinsics, pixels: Array) -> Array:
    """Pixels (n, 2) where a lens without distortion would show what `pixels` (n, 2) show."""
    plane = image_plane(intrinsics, pixels)
    ideal: Array = plane @ intrinsics.matrix[:2, :2].T + intrinsics.matrix[:2, 2]
    return ideal


def rays(camera: Camera, pixels: Array) -> Array:
    """(n, 3) directions of the lines of sight, of depth 1 along the camera's axis."""
    plane = image_plane(camera.intrinsics, pixels)
    directions: Array = np.column_stack([plane, np.ones(len(plane))]) @ camera.rotation
    return directions


@dataclass(frozen=True)
class StereoRig:
    """Two cameras in one frame; results are in that frame.

    Raises ValueError for cameras at one place, which see no depth.
    """

    left: Camera
    right: Camera

    def __post_init__(self) -> None:
        if not self.baseline > 0.0:
            raise ValueError("translation: expected two cameras apart, found both at one place")

    @property
    def baseline(self) -> float:
        """Distance of the cameras, mm."""
        return float(np.linalg.norm(self.right.centre - self.left.centre))

    @property
    def angle(self) -> float:
        """Stereo angle between the cameras' axes, degrees."""
        cosine = float(np.clip(self.left.axis @ self.right.axis, -1.0, 1.0))
        return float(np.degrees(np.arccos(cosine)))

    @property
    def relative(self) -> tuple[Array, Array]:
        """(3, 3) rotation and (3,) translation [mm] from the left camera's frame to the right's."""
        turn = self.right.rotation @ self.left.rotation.T
        return turn, self.right.translation - turn @ self.left.translation


def cross_matrix(vector: Array) -> Array:
    """(3, 3) matrix of the cross product with `vector` (3,)."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def fundamental_matrix(rig: StereoRig) -> Array:
    """(3, 3) F with x_right^T F x_left = 0 for ideal pixels of one point (Hartley, eq. 9.2)."""
    turn, shift = rig.relative
    left, right = rig.left.intrinsics.matrix, rig.right.intrinsics.matrix
    matrix: Array = np.linalg.inv(right).T @ cross_matrix(shift) @ turn @ np.linalg.inv(left)
    return matrix


def epipolar_distance(rig: StereoRig, left: Array, right: Array) -> Array:
    """(n,) signed distance of pixels (n, 2) of a pair from one line of sight's image, px.

    Sampson's: to first order the length of the smallest correction of the four coordinates that
    makes the two lines of sight meet (Hartley, eq. 11.9); 0 for a perfect match.
    """
    one = np.ones((len(left), 1))
    at_left = np.hstack([ideal_pixels(rig.left.intrinsics, left), one])
    at_right = np.hstack([ideal_pixels(rig.right.intrinsics, right), one])
    matrix = fundamental_matrix(rig)
    line_right, line_left = at_left @ matrix.T, at_right @ matrix
    size = np.sqrt((line_right[:, :2] ** 2).sum(axis=1) + (line_left[:, :2] ** 2).sum(axis=1))
    distance: Array = (at_right * line_right).sum(axis=1) / size
    return distance
