"""Small scenes for two virtual cameras, rendered once a session."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_erosion

from calib.dic import CorrelationSettings
from calib.dic.camera import Camera, StereoRig
from calib.dic.stereo import StereoSettings
from calib.virtual.cameras import CameraPair
from calib.virtual.render import render
from calib.virtual.sensor import Sensor, expose
from calib.virtual.speckle import SpeckleSettings, make_speckle
from calib.virtual.surface import Surface, make_surface

CAMERAS = CameraPair(columns=300, rows=150, pixel_mm=0.006, target=(0.0, 1.0, 0.0))
LOW, HIGH = (-2.0, 0.0), (2.0, 2.0)
SPECKLE = make_speckle(LOW, HIGH, SpeckleSettings(0.075, 0.11), np.random.default_rng(3))
STEREO = StereoSettings(CorrelationSettings(subset=25, min_zncc=0.7))
SENSOR = Sensor(read_noise=0.005, gain_drift=0.02, tilt_drift=0.02)


def face(move=(0.0, 0.0, 0.0), stretch=(0.0, 0.0), bulge=0.0) -> Surface:
    """A face 4 mm wide and 2 mm high, stretched, bulged and moved."""
    x, y = np.meshgrid(np.linspace(-2, 2, 41), np.linspace(0, 2, 21), indexing="ij")
    places = np.stack(
        [x * (1 + stretch[0]), y * (1 + stretch[1]), bulge * np.cos(x / 2) * y], axis=-1
    )
    return make_surface(LOW, HIGH, places + np.array(move))


class Shot(NamedTuple):
    left: np.ndarray
    right: np.ndarray
    material: np.ndarray
    """of the left image"""


def shoot(surface: Surface, seed: int | None, cameras: CameraPair = CAMERAS) -> Shot:
    """Both images; without noise when there is no seed."""
    rng = np.random.default_rng(seed)
    pictures = [
        render(surface, SPECKLE, cameras, camera)
        for camera in (cameras.rig.left, cameras.rig.right)
    ]
    images = [
        one.brightness * 4095.0
        if seed is None
        else expose(one.brightness, SENSOR, rng).astype(float)
        for one in pictures
    ]
    return Shot(images[0], images[1], pictures[0].material)


@cache
def still(seed: int | None) -> Shot:
    """The face at rest."""
    return shoot(face(), seed)


def points_on(shot: Shot, step: int = 8, margin: int = 18) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2) whose subsets lie on the face, and their material points (n, 2)."""
    inside = binary_erosion(np.isfinite(shot.material[..., 0]), np.ones((2 * margin,) * 2))
    row, column = (part[::1] for part in np.mgrid[: inside.shape[0], : inside.shape[1]])
    chosen = inside & (row % step == 0) & (column % step == 0)
    pixels = np.column_stack([column[chosen], row[chosen]]).astype(float)
    return pixels, shot.material[chosen]


def turned(rig: StereoRig, degrees: float) -> StereoRig:
    """The rig after the right camera was knocked."""
    angle = np.radians(degrees)
    c, s = np.cos(angle), np.sin(angle)
    by = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    right = rig.right
    return StereoRig(
        rig.left, Camera(right.intrinsics, by @ right.rotation, by @ right.translation)
    )
