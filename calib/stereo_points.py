"""Results of stereo correlation as frames of points, as the readers of DIC files give them."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from calib.data.readers.frames import PointFrame
from calib.dic.overlap import correlation_length
from calib.dic.settings import CorrelationSettings
from calib.dic.stereo import StereoFrame, StereoReason, StereoReference
from calib.dic.surface_frame import SurfaceFrame, unturned


def point_frame(
    result: StereoFrame,
    name: str,
    time: float | None = None,
    grid: tuple[int, int] | None = None,
    axes: SurfaceFrame | None = None,
) -> PointFrame:
    """One frame of points, mm, with SDs; `axes` turns it out of the cameras' frame."""
    axes = axes or unturned()
    covariance = axes.rotation @ result.covariance @ axes.rotation.T
    return PointFrame(
        name,
        axes.points(result.position),
        axes.vectors(result.displacement),
        result.valid,
        np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)),
        time,
        grid,
    )


def reference_frame(
    reference: StereoReference,
    name: str,
    time: float | None = None,
    grid: tuple[int, int] | None = None,
    axes: SurfaceFrame | None = None,
) -> PointFrame:
    """The frame of the reference images: nothing has moved, by definition."""
    axes = axes or unturned()
    valid = np.asarray(reference.reason == StereoReason.VALID)
    moved = np.where(valid[:, None], 0.0, np.nan) * np.ones(3)
    return PointFrame(name, axes.points(reference.space.points), moved, valid, None, time, grid)


def error_length(reference: StereoReference, settings: CorrelationSettings) -> float | None:
    """Correlation length of the errors on the surface, mm; None with fewer than two points.

    That of the overlap of subsets, in px of the left image, by the median distance of points to
    their nearest in space over that in the image.
    """
    valid = reference.reason == StereoReason.VALID
    if np.count_nonzero(valid) < 2:
        return None
    pixels, places = reference.left[valid], reference.space.points[valid]
    apart, nearest = (np.asarray(found)[:, 1] for found in cKDTree(pixels).query(pixels, k=2))
    in_space = np.linalg.norm(places - places[nearest], axis=1)
    return correlation_length(settings) * float(np.median(in_space / apart))
