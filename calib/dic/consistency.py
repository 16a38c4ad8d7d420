"""Points that correlate well at a wrong place: their neighbours' shape functions say otherwise."""

from __future__ import annotations

import numpy as np

from calib.dic.interpolation import Array
from calib.dic.prepared import BoolArray, IntArray
from fe.compiled import kernel

LEAST_NEIGHBOURS = 3


def stray_points(points: Array, parameters: Array, valid: BoolArray, near: IntArray) -> BoolArray:
    """(n,) valid points far from where their neighbours expect them.

    near (n, 8): indices of neighbours, -1 for none. Expected is the median over the valid
    neighbours of their shape functions carried to the point. Far is more than 1 px and a tenth of
    the distance to the neighbours: a wrong match is off by a speckle, while a true field departs
    from its tangent by half the change of its gradient times that distance.
    """
    departure, distance = departures(points, parameters, valid, near)
    return np.asarray(departure > 1.0 + 0.1 * distance)


@kernel(nogil=True)
def departures(
    points: Array, parameters: Array, valid: BoolArray, near: IntArray
) -> tuple[Array, Array]:
    """(n,) px from where the neighbours expect a point, 0 with too few, and (n,) their distance."""
    n = near.shape[0]
    departure, distance = np.zeros(n), np.zeros(n)
    expected = np.empty((2, near.shape[1]))
    for point in range(n):
        count = 0
        for other in near[point]:
            if other < 0 or not valid[other]:
                continue
            a, b = points[point] - points[other]
            distance[point] = max(distance[point], abs(a), abs(b))
            p = parameters[other]
            for k in range(2):
                bent = p[6 + 3 * k] * a * a + p[8 + 3 * k] * b * b
                straight = p[k] + p[2 + 2 * k] * a + p[3 + 2 * k] * b
                expected[k, count] = straight + 0.5 * bent + p[7 + 3 * k] * a * b
            count += 1
        if valid[point] and count >= LEAST_NEIGHBOURS:
            for k in range(2):
                off = abs(parameters[point, k] - np.median(expected[k, :count]))
                departure[point] = max(departure[point], off)
    return departure, distance
