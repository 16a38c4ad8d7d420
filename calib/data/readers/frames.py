"""Displacements of one DIC measurement, frame by frame, whatever program wrote them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fe.response import Array

BoolArray = npt.NDArray[np.bool_]
STATIC = 1e-9
"""mm: a frame that moves less is the reference frame, whose zeros are measured"""


@dataclass(frozen=True)
class PointFrame:
    """Points of one DIC frame, mm; x, y, z as the program's axes, image rows turned upwards.

    Raises ValueError when shapes disagree or a valid point is not finite.
    """

    name: str
    position: Array
    """(n_point, 3) reference positions, mm; NaN where the file has none"""
    displacement: Array
    """(n_point, 3) displacements, mm; NaN at points that are not valid"""
    valid: BoolArray
    """(n_point,) False at points hidden, outside the sample or failed"""
    sigma: Array | None = None
    """(n_point, 3) standard deviation of each displacement as the program states it, mm, or None"""
    time: float | None = None
    """s, or None where the file has none"""
    grid_shape: tuple[int, int] | None = None
    """(rows, columns) where the points lie row after row on a grid, else None"""
    is_planar: bool = False
    """True for one camera: z and its displacement are zero by assumption, not measured"""
    scale_sd: float | None = None
    """relative SD of all lengths by the calibration, one factor in all frames, or None"""
    correlation_length: float | None = None
    """mm, of exp(-d / length), over which errors of points go together whose subsets overlap, as
    the program states it, or None"""

    def __post_init__(self) -> None:
        n = self.valid.size
        if self.valid.shape != (n,) or self.valid.dtype != np.bool_ or n == 0:
            raise ValueError(f"valid: expected booleans (n_point,), found {self.valid.shape}")
        for name in ("position", "displacement", "sigma"):
            values = getattr(self, name)
            if values is None:
                continue
            if values.shape != (n, 3):
                raise ValueError(f"{name}: expected shape ({n}, 3), found {values.shape}")
            if name != "sigma" and not np.all(np.isfinite(values[self.valid])):
                raise ValueError(f"{name}: expected finite values at valid points, found others")
        if self.grid_shape is not None and self.grid_shape[0] * self.grid_shape[1] != n:
            raise ValueError(f"grid_shape: expected {n} points, found {self.grid_shape}")
        if self.time is not None and not np.isfinite(self.time):
            raise ValueError(f"time: expected a finite value in s, found {self.time}")
        if self.scale_sd is not None and not 0 <= self.scale_sd < 1:
            raise ValueError(f"scale_sd: expected a share in [0, 1), found {self.scale_sd}")
        if self.correlation_length is not None and not 0 < self.correlation_length < np.inf:
            found = self.correlation_length
            raise ValueError(f"correlation_length: expected a finite length above 0, found {found}")

    @property
    def n_valid(self) -> int:
        """Number of points that were measured."""
        return int(np.count_nonzero(self.valid))


@dataclass(frozen=True)
class DicSeries:
    """The frames of one measurement in their order; every frame keeps its own points.

    Raises ValueError without a frame.
    """

    format: str
    """name of the format read, as `DaVis csv`"""
    frames: tuple[PointFrame, ...]
    notes: tuple[str, ...] = ()
    """what the reader assumed or left out, one sentence each"""

    def __post_init__(self) -> None:
        if not self.frames:
            raise ValueError("frames: expected at least one, found none")


def masked_frame(
    name: str,
    position: Array,
    displacement: Array,
    measured: BoolArray | None = None,
    sigma: Array | None = None,
    time: float | None = None,
    grid_shape: tuple[int, int] | None = None,
    is_planar: bool = False,
    zeros_are_holes: bool = False,
) -> PointFrame:
    """A frame whose mask leaves out what is not finite, not `measured`, or a false zero.

    A false zero is a point that has not moved at all, to the last digit, in a frame that has;
    with `zeros_are_holes` in any frame.  So is a position of three zeros that comes twice.
    """
    axes = 2 if is_planar else 3
    valid: BoolArray = np.all(np.isfinite(position) & np.isfinite(displacement), axis=1)
    if measured is not None:
        valid = valid & measured
    still = np.all(displacement[:, :axes] == 0, axis=1)
    has_moved = bool(np.any(np.abs(displacement[valid]) > STATIC)) if valid.any() else False
    if has_moved or zeros_are_holes:
        valid = valid & ~still
    at_origin = np.all(position == 0, axis=1)
    if np.count_nonzero(at_origin) > 1:
        valid = valid & ~(at_origin & still)
    hole = ~valid[:, None]
    position = np.where(np.all(np.isfinite(position), axis=1, keepdims=True), position, np.nan)
    displacement = np.where(hole, np.nan, displacement)
    if sigma is not None:
        sigma = np.where(hole | ~(np.isfinite(sigma) & (sigma >= 0)), np.nan, sigma)
    return PointFrame(
        name, position, displacement, valid, sigma, time, grid_shape, is_planar=is_planar
    )
