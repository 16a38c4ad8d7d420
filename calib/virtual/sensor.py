"""What a sensor makes of a picture: lighting, noise after sampling, quantisation, saturation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fe.response import Array


@dataclass(frozen=True)
class Sensor:
    """A sensor and its light. Raises ValueError when a number is impossible."""

    bits: int = 12
    read_noise: float = 0.003
    """SD, share of full scale"""
    full_well: float = 12_000.0
    """electrons at full scale: the shot noise is the root of their number"""
    gain_drift: float = 0.01
    """SD of the light's change from image to image, share"""
    tilt_drift: float = 0.01
    """SD of how much brighter one side of an image becomes, share"""

    def __post_init__(self) -> None:
        if not 8 <= self.bits <= 16 or not 0.0 < self.full_well < math.inf:
            raise ValueError(
                f"bits, full_well: expected 8 to 16 and above 0, "
                f"found {self.bits}, {self.full_well}"
            )
        if not all(
            0.0 <= n < math.inf for n in (self.read_noise, self.gain_drift, self.tilt_drift)
        ):
            raise ValueError(
                f"read_noise, gain_drift, tilt_drift: expected 0 or more, found "
                f"{self.read_noise}, {self.gain_drift}, {self.tilt_drift}"
            )

    @property
    def full_scale(self) -> int:
        """Largest count."""
        return int(2**self.bits - 1)

    def noise_sd(self, brightness: Array) -> Array:
        """SD of the noise at a brightness, share of full scale."""
        sd: Array = np.sqrt(self.read_noise**2 + np.maximum(brightness, 0.0) / self.full_well)
        return sd


@dataclass(frozen=True)
class Glare:
    """Highlights, which stay where they are in the image when the surface moves under them."""

    spots: tuple[tuple[float, float, float, float], ...] = ()
    """column, row, radius (of exp(-d^2 / radius^2)) in px, and brightness added in the middle"""

    def added(self, shape: tuple[int, int]) -> Array:
        """(rows, columns) brightness, share of full scale."""
        row, column = np.mgrid[: shape[0], : shape[1]]
        total = np.zeros(shape)
        for x, y, radius, peak in self.spots:
            total += peak * np.exp(-((column - x) ** 2 + (row - y) ** 2) / radius**2)
        return total


def expose(
    brightness: Array, sensor: Sensor, rng: np.random.Generator, glare: Glare | None = None
) -> npt.NDArray[np.uint16]:
    """An image (rows, columns) of counts from a picture (rows, columns), share of full scale.

    Noise comes after sampling; counts beyond full scale are cut off, as a sensor does.
    """
    gain = 1.0 + sensor.gain_drift * rng.standard_normal()
    side = sensor.tilt_drift * rng.standard_normal(2)
    rows, columns = brightness.shape
    tilt = 1.0 + side[0] * np.linspace(-0.5, 0.5, columns)
    light = gain * (tilt[None, :] + side[1] * np.linspace(-0.5, 0.5, rows)[:, None])
    seen = brightness * light
    if glare is not None:
        seen = seen + glare.added(brightness.shape)
    noisy = seen + sensor.noise_sd(seen) * rng.standard_normal(seen.shape)
    counts = np.clip(np.round(noisy * sensor.full_scale), 0, sensor.full_scale)
    image: npt.NDArray[np.uint16] = counts.astype(np.uint16)
    return image
