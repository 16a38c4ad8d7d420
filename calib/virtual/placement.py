"""Where each virtual sample stands, and how stiff it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from calib.virtual.laboratory_settings import Placing
from fe.response import Array

Beyond = Literal["", "angle", "x_shift", "both"]


@dataclass(frozen=True)
class Placement:
    """One sample: its place under pin and cameras, and its stiffness."""

    x_shift: float
    """mm, of the pin's axis from the sample's centre along x"""
    angle: float
    """degrees, of the sample's front face about its height (y, upwards) by the right hand: what
    quality control calls the angle, dz/dx seen from above, has the other sign"""
    roll: float
    """degrees, of the sample in the cameras' frame about their line of sight"""
    tilt: float
    """degrees, of the sample in the cameras' frame about its width"""
    origin: tuple[float, float, float]
    """mm, bottom centre of the sample's front face in the cameras' frame"""
    stiffness: float
    """its force over that of the median sample, which the truth's constants are of"""
    beyond: Beyond
    """which limit it was placed beyond"""
    grid_phase: tuple[float, float] = (0.0, 0.0)
    """shares of a spacing by which the grid of points lies beside the middle of the image"""

    @property
    def rotation(self) -> Array:
        """(3, 3) from the sample's axes to those of a frame with y up and z towards the cameras."""
        turns = Rotation.from_euler("yxz", [self.angle, self.tilt, self.roll], degrees=True)
        matrix: Array = turns.as_matrix()
        return matrix


def place(placing: Placing, samples: int, rng: np.random.Generator) -> tuple[Placement, ...]:
    """Draw the samples of a laboratory; which ones are misplaced, and how, is drawn too."""
    kinds: list[Beyond] = ["angle", "x_shift", "both"]
    which: list[Beyond] = [""] * samples
    for index in rng.permutation(samples)[: placing.misplaced]:
        which[index] = kinds[rng.choice(3, p=(0.5, 0.3, 0.2))]
    return tuple(_place(placing, beyond, rng) for beyond in which)


def _place(placing: Placing, beyond: Beyond, rng: np.random.Generator) -> Placement:
    angle = _along(
        placing.max_angle_deg, placing.angle_sd_deg, beyond in ("angle", "both"), placing, rng
    )
    shift = _along(
        placing.max_x_shift_mm, placing.x_shift_sd_mm, beyond in ("x_shift", "both"), placing, rng
    )
    roll, tilt = rng.standard_normal(2) * (placing.camera_roll_deg, placing.camera_tilt_deg)
    x, y, z = rng.normal((0.4, -1.1, 2.0), (0.2, 0.1, 0.3))
    stiffness = np.exp(placing.stiffness_sd * rng.standard_normal())
    right, up = rng.uniform(-0.5, 0.5, 2)
    return Placement(
        float(shift),
        float(angle),
        float(roll),
        float(tilt),
        (float(x), float(y), float(z)),
        float(stiffness),
        beyond,
        (float(right), float(up)),
    )


def _along(
    limit: float, sd: float, is_beyond: bool, placing: Placing, rng: np.random.Generator
) -> float:
    """A deviation of either sign: clearly within the limit or clearly beyond it."""
    if is_beyond:
        size = limit * (1.0 + placing.clear_share + 0.6 * rng.random())
        return float(size * rng.choice((-1.0, 1.0)))
    while True:
        deviation = float(sd * rng.standard_normal())
        if abs(deviation) < placing.safe_share * limit:
            return deviation
