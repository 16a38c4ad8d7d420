"""Two virtual cameras that look at the front face of a sample: geometry, lens, depth of field."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from calib.dic.camera import Camera, Intrinsics, StereoRig
from calib.dic.distortion import Distortion
from calib.optics.thin_lens import blur_circle, magnification
from fe.response import Array

LENS_BLUR = 0.45
"""px, SD of what a sharp lens spreads: diffraction and aberrations"""


@dataclass(frozen=True)
class CameraPair:
    """Both cameras alike, at half the stereo angle on either side, aimed at the face's middle.

    The frame is x right, y up, z towards the cameras, with `target` in focus on both axes.
    Raises ValueError when a number is impossible.
    """

    columns: int = 1000
    rows: int = 800
    pixel_mm: float = 0.0045
    focal_length_mm: float = 100.0
    distance_mm: float = 350.0
    """from the lens to the target"""
    f_stop: float = 16.0
    half_angle_deg: float = 17.0
    target: tuple[float, float, float] = (0.0, 1.25, 0.0)
    """mm"""
    distortion: Distortion = field(default_factory=lambda: Distortion((-0.2, 0.5, 0.0)))

    def __post_init__(self) -> None:
        positive = (self.columns, self.rows, self.pixel_mm, self.f_stop)
        far = math.inf > self.distance_mm > self.focal_length_mm > 0.0
        if not (far and all(0.0 < value < math.inf for value in positive)):
            raise ValueError(
                f"columns, rows, pixel_mm, f_stop: expected above 0, and distance_mm beyond "
                f"focal_length_mm, found {positive}, {self.distance_mm}, {self.focal_length_mm}"
            )
        if not 0.0 < self.half_angle_deg < 60.0:
            raise ValueError(f"half_angle_deg: expected 0 to 60, found {self.half_angle_deg}")

    @property
    def size(self) -> tuple[int, int]:
        """Columns, rows."""
        return self.columns, self.rows

    @property
    def px_per_mm(self) -> float:
        """In the plane of focus."""
        return float(magnification(self.focal_length_mm, self.distance_mm)) / self.pixel_mm

    @property
    def field_of_view(self) -> float:
        """Width seen in the plane of focus, mm."""
        return self.columns / self.px_per_mm

    @property
    def rig(self) -> StereoRig:
        """The true cameras in the frame of the face."""
        return StereoRig(self._camera(-1.0), self._camera(1.0))

    def _camera(self, side: float) -> Camera:
        angle = side * np.radians(self.half_angle_deg)
        axis = np.array([-np.sin(angle), 0.0, -np.cos(angle)])
        down = np.array([0.0, -1.0, 0.0])
        turn = np.stack([np.cross(down, axis), down, axis])
        centre = np.array(self.target) - self.distance_mm * axis
        focal = self.px_per_mm * self.distance_mm
        lens = Intrinsics(
            focal, focal, 0.5 * (self.columns - 1), 0.5 * (self.rows - 1), 0.0, self.distortion
        )
        return Camera(lens, turn, -turn @ centre)

    def blur(self, depth: Array) -> Array:
        """SD of the spread of a point at depths along the axis, px: pixel, lens and defocus.

        A uniform disc of diameter d has the SD d / 4 along an axis, a square pixel the root of
        1 / 12.
        """
        circle = np.asarray(blur_circle(self.focal_length_mm, self.f_stop, self.distance_mm, depth))
        spread: Array = np.sqrt(1.0 / 12.0 + LENS_BLUR**2 + (circle / self.pixel_mm / 4.0) ** 2)
        return spread
