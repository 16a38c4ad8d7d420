"""Inner corners of a chessboard in an image, found and refined by OpenCV.

Source: A. Duda, U. Frese, "Accurate detection and localization of checkerboard corners for
calibration", BMVC 2018 (`findChessboardCornersSB`), then W. Foerstner, E. Guelch, "A fast operator
for detection and precise location of distinct points", ISPRS 1987 (`cornerSubPix`).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from calib.dic.distortion import Array
from calib.dic.plate_view import PlateView

WINDOW = 0.3
"""half width of the surroundings of a corner that are looked at, of the distance of corners"""


@dataclass(frozen=True)
class Chessboard:
    """A board. Raises ValueError when it has no one way up, or an impossible number."""

    columns: int
    """inner corners along a row"""
    rows: int
    square: float
    """side of a square, mm"""

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3 or not self.square > 0:
            raise ValueError(
                f"columns, rows, square: expected 3 or more corners each way and a side above 0, "
                f"found {self.columns}, {self.rows}, {self.square}"
            )
        if (self.columns + self.rows) % 2 == 0:
            raise ValueError(
                f"columns, rows: found {self.columns} and {self.rows}, expected one odd and one "
                "even, as otherwise the board looks the same upside down"
            )


def chessboard_view(image: Array, board: Chessboard, name: str) -> PlateView:
    """The corners in an image (rows, columns); the first one stands next to the dark end square.

    Raises ValueError when the board is not seen whole.
    """
    low, high = float(image.min()), float(image.max())
    grey = np.clip(255.0 * (image - low) / max(high - low, 1e-9), 0.0, 255.0).astype(np.uint8)
    size = (board.columns, board.rows)
    flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners = cv2.findChessboardCornersSB(grey, size, flags=flags)
    if not found:
        raise ValueError(
            f"{name}: found no chessboard of {board.columns} x {board.rows} inner corners, "
            "expected one that is seen whole"
        )
    # the detector is off by a tenth of a pixel; where gradients meet a corner's rays is not
    spacing = np.linalg.norm(np.diff(corners.reshape(board.rows, board.columns, 2), axis=1), axis=2)
    window = int(np.clip(WINDOW * spacing.min(), 2, 15))
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
    corners = cv2.cornerSubPix(grey, corners.astype(np.float32), (window, window), (-1, -1), stop)
    pixels = np.asarray(corners, dtype=np.float64).reshape(board.rows, board.columns, 2)
    if not _is_first_dark(grey, pixels):
        pixels = pixels[::-1, ::-1]
    y, x = np.mgrid[: board.rows, : board.columns]
    places = board.square * np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float64)
    return PlateView(name, places, pixels.reshape(-1, 2).copy())


def _is_first_dark(grey: Array | np.ndarray, pixels: Array) -> bool:
    """Whether the square of the first four corners is darker than that of the last four."""
    middles = [pixels[:2, :2].mean(axis=(0, 1)), pixels[-2:, -2:].mean(axis=(0, 1))]
    levels = []
    for x, y in middles:
        column, row = round(float(x)), round(float(y))
        levels.append(float(grey[row - 1 : row + 2, column - 1 : column + 2].mean()))
    return levels[0] < levels[1]
