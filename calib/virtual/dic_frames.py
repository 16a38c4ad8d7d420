"""What a stereo-DIC program makes of a view: noise, lost points, wrong matches."""

from __future__ import annotations

import numpy as np

from calib.data.readers.frames import BoolArray, PointFrame
from calib.virtual.correlated_noise import correlated_noise, torus_amplitudes
from calib.virtual.front_view import FrontView
from calib.virtual.laboratory_settings import Cameras
from fe.response import Array


def dic_frames(
    view: FrontView,
    cameras: Cameras,
    spacing: tuple[float, float],
    time: Array,
    rng: np.random.Generator,
    *,
    first_is_reference: bool = True,
) -> tuple[PointFrame, ...]:
    """Frames as a program would hold them: NaN and not valid where a point was not found.

    Noise of the reference image is common to all frames and is also in the z of the positions; x
    and y are where the program put its points. The first frame is the reference, all zeros, or,
    without one in the view, as noisy as the others. `time` (n_frame,) s, `spacing` of points, mm.
    """
    noise, reference = _noise(cameras, spacing, len(time), rng)
    measured = view.displacement + noise - reference
    seen = view.seen & (rng.random(view.seen.shape) >= cameras.lost_share)
    wrong = seen & (rng.random(seen.shape) < cameras.outlier_share)
    measured[wrong] += cameras.outlier_mm * rng.standard_normal((np.count_nonzero(wrong), 3))
    if first_is_reference:
        measured[0], seen[0] = 0.0, view.seen[0]
    position = view.position.copy()
    position[:, 2] += reference[:, 2]
    return tuple(
        _frame(number, position, displacement, valid, float(at))
        for number, (displacement, valid, at) in enumerate(
            zip(measured, seen, time, strict=True), start=1
        )
    )


def _frame(
    number: int, position: Array, displacement: Array, valid: BoolArray, time: float
) -> PointFrame:
    moved = np.where(valid[:, None], displacement, np.nan)
    return PointFrame(f"B{number:04d}", position, moved, valid, time=time)


def _noise(
    cameras: Cameras, spacing: tuple[float, float], n_frame: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """(n_frame, n_point, 3) noise of the frames' images and (n_point, 3) of the reference's, mm."""
    amplitudes = torus_amplitudes(cameras.grid, spacing, cameras.correlation_mm)
    fields = correlated_noise(amplitudes, cameras.grid, 3 * (n_frame + 1), rng)
    each = np.moveaxis(fields.reshape(n_frame + 1, 3, -1), 1, 2) * np.array(cameras.noise_mm)
    share = cameras.reference_share
    return np.sqrt(1.0 - share) * each[1:], np.sqrt(share) * each[0]
