"""Which hold each DIC frame was taken in, the camera's clock having been started by hand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calib.data.qc.plateaus import Hold
from fe.response import Array, IntArray


class Synchronised(NamedTuple):
    """Frames on the clock of the test machine."""

    offset: float
    """s, added to the camera's clock to have the machine's: middle of what is possible"""
    half_width: float
    """s: all offsets within this of it put the same frames into the same holds"""
    hold: IntArray
    """(n_frame,) number of the increment whose hold the frame was taken in, -1 in none"""
    time: Array
    """(n_frame,) s by the machine's clock"""


def synchronise(
    frame_time: Array, holds: list[Hold], max_offset: float, margin: float = 0.0
) -> Synchronised:
    """Find the offset within +-max_offset [s] with which most frames fall into holds of their own.

    frame_time (n_frame,) is in s by the camera's clock. Frames are taken by hand somewhere in a
    hold, so that the offset is known to an interval only; of several the one nearest to zero is
    taken. The first frame is the reference, which need not be in a hold.
    """
    intervals = np.array([(hold.start + margin, hold.end - margin) for hold in holds])
    intervals = intervals.reshape(-1, 2)
    later = frame_time[1:]
    # the assignment changes only where a frame crosses the end of a hold
    breaks = np.concatenate([(intervals[:, k][:, None] - later).ravel() for k in (0, 1)])
    inside = breaks[np.abs(breaks) < max_offset]
    edges = np.unique(np.concatenate([[-max_offset, max_offset], inside]))
    middles = 0.5 * (edges[1:] + edges[:-1])
    numbers = np.array([hold.number for hold in holds], dtype=np.int64)
    scores = np.array([_score(later + middle, intervals, numbers) for middle in middles])
    best = np.flatnonzero(scores == scores.max())
    # of the pieces of the best score the one nearest to no offset
    nearest = best[np.argmin(np.maximum(edges[best], -edges[best + 1]).clip(min=0.0))]
    low, high = edges[nearest], edges[nearest + 1]
    offset = float(0.5 * (low + high))
    time = frame_time + offset
    return Synchronised(offset, float(0.5 * (high - low)), _holds(time, intervals, numbers), time)


def _score(time: Array, intervals: Array, numbers: IntArray) -> float:
    """Number of holds that have a frame; between equals, frame i in hold i decides."""
    inside = (time[:, None] >= intervals[:, 0]) & (time[:, None] <= intervals[:, 1])
    own = numbers[None, :] == np.arange(1, time.size + 1)[:, None]
    in_turn = np.count_nonzero((inside & own).any(axis=1))
    return float(np.count_nonzero(inside.any(axis=0)) + 0.5 * in_turn)


def _holds(time: Array, intervals: Array, numbers: IntArray) -> IntArray:
    found = np.full(time.size, -1, dtype=np.int64)
    for (start, end), number in zip(intervals, numbers, strict=True):
        found[(time >= start) & (time <= end)] = number
    return found
