"""Reliability-guided propagation: a point starts from its best neighbour that is done.

Pan (2009, Appl. Opt. 48:1535) takes one point after the other, best correlation first. Here the
better half of all points next to done ones is taken at once, so that threads share the work, and
the order of points, with it the result, does not depend on their number.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from calib.dic.consistency import stray_points
from calib.dic.interpolation import Array
from calib.dic.prepared import N_RESULT, BoolArray, IntArray, Task, refine
from calib.dic.reasons import Reason
from calib.dic.shape import carried
from fe.compiled import kernel

N_NEIGHBOUR = 8
REACH = 2.3
"""neighbours are not farther than this times the usual distance to the fourth nearest"""
USUAL = 4
MOST_TRIES = 3
"""starts of a point from different neighbours"""


def neighbours(points: Array) -> IntArray:
    """(n, 8) indices of the nearest points of each point (n, 2), -1 where there are fewer."""
    n = len(points)
    k = min(N_NEIGHBOUR + 1, n)
    distance, index = cKDTree(points).query(points, k=k)
    found = np.full((n, N_NEIGHBOUR), -1, dtype=np.int64)
    if k < 2:
        return found
    distance, index = np.atleast_2d(distance)[:, 1:], np.atleast_2d(index)[:, 1:]
    near = distance <= REACH * np.median(distance[:, min(USUAL, k - 1) - 1])
    found[:, : k - 1] = np.where(near, index, -1)
    return found


def propagate(task: Task) -> None:
    """From the points of a task that are valid to the others.

    A point that fails is tried again when a neighbour with a better correlation is done. Strays
    are tried once more from their neighbours.
    """
    near = neighbours(task.points)
    _spread(task, near)
    for again in (True, False):
        valid = task.results[:, 3] == Reason.VALID
        stray = stray_points(task.points, task.parameters, valid, near)
        if not stray.any():
            return
        task.results[stray, 3] = Reason.STRAY
        if again:
            _spread(task, near)


def _spread(task: Task, near: IntArray) -> None:
    points, parameters, results = task.points, task.parameters, task.results
    done: BoolArray = results[:, 3] == Reason.VALID
    tries = np.where(done, MOST_TRIES, 0)
    used = np.full((len(points), MOST_TRIES), -1, dtype=np.int64)
    while True:
        starts, quality = best_starts(near, done, results[:, 0], tries, used)
        candidates = np.flatnonzero(starts >= 0)
        if not candidates.size:
            return
        ready = quality[candidates] >= np.median(quality[candidates])
        todo = candidates[ready]
        start = starts[todo]
        used[todo, tries[todo]] = start
        tries[todo] += 1
        parameters[todo] = carried(parameters[start], points[todo] - points[start])
        refine(task, todo)
        done[todo] = results[todo, 3] == Reason.VALID


@kernel(nogil=True)
def best_starts(
    near: IntArray, done: BoolArray, zncc: Array, tries: IntArray, used: IntArray
) -> tuple[IntArray, Array]:
    """For each point that may be tried: its best neighbour that is done and was not used yet.

    near (n, 8), done (n,), zncc (n,), tries (n,), used (n, MOST_TRIES). Returns indices (n,), -1
    where there is none, and the correlation (n,) of these neighbours.
    """
    n = near.shape[0]
    starts, quality = np.full(n, -1), np.full(n, -np.inf)
    for point in range(n):
        if done[point] or tries[point] >= used.shape[1]:
            continue
        for neighbour in near[point]:
            if neighbour < 0 or not done[neighbour] or not zncc[neighbour] > quality[point]:
                continue
            is_new = True
            for old in used[point]:
                is_new = is_new and old != neighbour
            if is_new:
                starts[point], quality[point] = neighbour, zncc[neighbour]
    return starts, quality


def unreached(n: int) -> npt.NDArray[np.float64]:
    """Results (n, 7) before anything is done."""
    results = np.full((n, N_RESULT), np.nan)
    results[:, 3] = Reason.NOT_REACHED
    results[:, 4] = 0
    return results
