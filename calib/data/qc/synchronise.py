"""Which hold each DIC frame was taken in, the camera's clock having been started by hand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calib.data.qc.plateaus import Hold
from calib.data.readers.frames import BoolArray
from fe.response import Array, IntArray

ROUNDING = 1e-9
"""s"""
ENDS = 2
"""holds, the first and the last, that a series need not have seen"""


class Synchronised(NamedTuple):
    """Frames on the clock of the test machine."""

    offset: float
    """s, added to the camera's clock to have the machine's: middle of what is possible"""
    half_width: float
    """s: all offsets within this of it are possible"""
    hold: IntArray
    """(n_frame,) number of the increment whose hold the frame was taken in, -1 in none"""
    time: Array
    """(n_frame,) s by the machine's clock"""
    stays: BoolArray
    """(n_frame,) whether the frame is in that hold at all offsets that are possible"""
    depth: Array
    """(n_frame,) s from the nearer end of its hold, negative in none"""


def synchronise(
    frame_time: Array, holds: list[Hold], max_offset: float, margin: float = 0.0
) -> Synchronised:
    """Find the offset within +-max_offset [s] with which most frames fall into holds of their own.

    frame_time (n_frame,) is in s by the camera's clock. Frames are taken by hand somewhere in a
    hold, so that the offset is known to an interval only; of several the one nearest to zero is
    taken. A series with several frames in most holds is possible wherever it leaves out as few as
    it can of the holds that it went on in. The first frame is the reference, which need not be in a
    hold.
    """
    intervals = np.array([(hold.start + margin, hold.end - margin) for hold in holds])
    intervals = intervals.reshape(-1, 2)
    later = frame_time[1:]
    # what falls into which hold changes only where a frame crosses the end of one
    breaks = np.concatenate([(intervals[:, k][:, None] - later).ravel() for k in (0, 1)])
    inside = breaks[np.abs(breaks) < max_offset]
    edges = np.unique(np.concatenate([[-max_offset, max_offset], inside]))
    numbers = np.array([hold.number for hold in holds], dtype=np.int64)
    possible = _possible(later, 0.5 * (edges[1:] + edges[:-1]), intervals, numbers)
    low, high = _nearest_range(edges, possible)
    offset = 0.5 * (low + high)
    time = frame_time + offset
    depth = _depth(time, intervals)
    stays = depth >= 0.5 * (high - low) - ROUNDING
    hold = _holds(time, intervals, numbers)
    return Synchronised(offset, 0.5 * (high - low), hold, time, stays, depth)


def _possible(later: Array, offsets: Array, intervals: Array, numbers: IntArray) -> BoolArray:
    """(n_offset,) which offsets of the frames after the reference are as good as the best."""
    begun, ended = intervals[:, 0], intervals[:, 1]
    if not later.size:
        return np.ones(offsets.size, dtype=np.bool_)
    scores, filled, missed, several = [], [], [], []
    for offset in offsets:
        time = later + offset
        inside = (time[:, None] >= begun) & (time[:, None] <= ended)
        seen = inside.any(axis=0)
        scores.append(_score(inside, numbers))
        filled.append(int(seen.sum()))
        several.append(int((inside.sum(axis=0) > 1).sum()))
        # A hold before the series began or after it ended is none that it left out.
        missed.append(int(np.count_nonzero(~seen & (time[0] <= ended) & (time[-1] >= begun))))
    best: BoolArray = np.array(scores) == max(scores)
    # One photograph that was taken twice makes no series of those that are taken by hand.
    if np.array(several)[best].max() <= 0.5 * np.array(filled)[best].max():
        return best
    enough = np.array(filled) >= max(filled) - ENDS
    fewest = np.array(missed)[enough].min()
    left: BoolArray = enough & (np.array(missed) == fewest)
    return left


def _nearest_range(edges: Array, possible: BoolArray) -> tuple[float, float]:
    """Ends, s, of that range of possible pieces between `edges` which is nearest to no offset."""
    pieces = np.flatnonzero(possible)
    ranges = np.split(pieces, np.flatnonzero(np.diff(pieces) > 1) + 1)
    ends = np.array([(edges[one[0]], edges[one[-1] + 1]) for one in ranges])
    nearest = np.argmin(np.maximum(ends[:, 0], -ends[:, 1]).clip(min=0.0))
    return float(ends[nearest, 0]), float(ends[nearest, 1])


def _score(inside: BoolArray, numbers: IntArray) -> float:
    """Number of holds that have a frame; between equals, frame i in hold i decides.

    `inside` (n_frame, n_hold) tells which of the frames after the reference is in which hold.
    """
    own = numbers[None, :] == np.arange(1, len(inside) + 1)[:, None]
    in_turn = np.count_nonzero((inside & own).any(axis=1))
    return float(np.count_nonzero(inside.any(axis=0)) + 0.5 * in_turn)


def _depth(time: Array, intervals: Array) -> Array:
    """(n_frame,) s from the nearer end of the hold that each is in, negative in none."""
    if not len(intervals):
        return np.full(time.size, -np.inf)
    after, before = time[:, None] - intervals[:, 0], intervals[:, 1] - time[:, None]
    depth: Array = np.minimum(after, before).max(axis=1)
    return depth


def _holds(time: Array, intervals: Array, numbers: IntArray) -> IntArray:
    found = np.full(time.size, -1, dtype=np.int64)
    for (start, end), number in zip(intervals, numbers, strict=True):
        found[(time >= start) & (time <= end)] = number
    return found
