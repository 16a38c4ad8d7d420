"""Parts of a region that no neighbour leads to: gaps of a mask, a tear, a rod across the face."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from calib.dic.interpolation import Array
from calib.dic.prepared import BoolArray, IntArray, Task, refine
from calib.dic.propagate import neighbours, propagate
from calib.dic.reasons import Reason
from calib.dic.seeds import ENOUGH, WINDOWS, in_region, phase_shift, seed_points
from calib.dic.shape import carried

LEAST = 4
"""points of a part that is looked for"""


def reach_parts(task: Task, deformed_image: Array) -> None:
    """Correlate parts of the region, of `LEAST` points or more, of which no point is valid yet.

    From the valid point that is nearest to each, and from windows of phase correlation.
    """
    valid: BoolArray = task.results[:, 3] == Reason.VALID
    if not valid.any():
        return
    inside = in_region(task)
    if valid[inside].all():
        return
    parts = [one for one in _parts(task.points, inside) if not valid[one].any()]
    if any([_seeded(task, part, valid, deformed_image) for part in parts]):
        propagate(task)


def _parts(points: Array, inside: BoolArray) -> Iterator[IntArray]:
    """Indices of the points of each part: those that neighbours lead to from one another."""
    near = neighbours(points)
    start, place = np.nonzero(near >= 0)
    end = near[start, place]
    both = inside[start] & inside[end]
    n = len(points)
    links = sp.coo_matrix((np.ones(both.sum()), (start[both], end[both])), (n, n))
    _, label = connected_components(links, directed=False)
    for one in np.unique(label[inside]):
        part = np.flatnonzero(inside & (label == one))
        if part.size >= LEAST:
            yield part


def _seeded(task: Task, part: IntArray, valid: BoolArray, deformed_image: Array) -> bool:
    """Whether some points of a part were found, of a few that are far from each other."""
    points, found = task.points, np.flatnonzero(valid)
    good = False
    for seed in seed_points(points, part, ENOUGH):
        apart = np.sum((points[found] - points[seed]) ** 2, axis=1)
        nearest = found[int(np.argmin(apart))]
        step = (points[seed] - points[nearest])[None]
        starts = [carried(task.parameters[nearest][None], step)[0]]
        for window in WINDOWS:
            shift = phase_shift(
                task.reference.image, deformed_image, points[seed], window * task.settings.subset
            )
            if shift is not None:
                starts.append(np.concatenate([shift, np.zeros(starts[0].size - 2)]))
        for start in starts:
            task.parameters[seed] = start
            refine(task, np.array([seed]))
            if task.results[seed, 3] in (Reason.VALID, Reason.OUTSIDE_REGION):
                break
        good = good or bool(task.results[seed, 3] == Reason.VALID)
    return good
